"""The bench from Python: load scenes, restore a view, score the result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins, results
from sucre_bench.engine.restore import measured_restore
from sucre_bench.engine.score import score_rows
from sucre_bench.errors import InputError
from sucre_bench.imaging.display import display
from sucre_bench.jobs.job import metric_choices
from sucre_bench.plugins.code_hash import source_hash
from sucre_bench.plugins.options import create
from sucre_bench.results.restorations import Measured
from sucre_bench.scene import Restoration, Scene, View

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["load_scenes", "restore", "score"]


def load_scenes(name: str, **options: Any) -> Iterator[Scene]:
    """Yield the scenes of a dataset. options: as in Hydra, e.g. root="dive/".

    Raises InputError for an unknown name or option, and for data that are not as expected.
    """
    yield from create(plugins.find("dataset", name), options).scenes()


def restore(method: str | Any, scene: Scene, view: View, **options: Any) -> Restoration:
    """Restore a view. method: a name with its options, or a method object.

    `info` of the result also says how it came about: method, options, display, seconds, peak_mb.
    Raises InputError where the scene lacks what the method needs, PluginError for a result that breaks the contract,
    SolveError where an estimation has no answer, of that NotApplicableError where the method has nothing to say.
    """
    if isinstance(method, str):
        method = create(plugins.find("method", method), options)
    elif options:
        raise InputError(f"{type(method).__name__}: options given beside a method object; give them when making it")
    plugin: plugins.Plugin = method.__plugin__
    if absent := plugins.missing_needs(plugin, scene.has):
        raise InputError(f"{plugin.name}: {absent}; choose another method or dataset")
    measured = measured_restore(method, scene, view)
    about = {
        "method": plugin.name,
        "options": {"name": plugin.name, "display": plugin.display, **asdict(method)},
        "display": plugin.display,
        "seconds": measured.seconds,
        "peak_mb": measured.peak_mb,
        "scene": scene.name,
        "data_id": scene.data_id,
        "code": source_hash(plugin),
    }
    restoration = measured.restoration
    return replace(restoration, info={**restoration.info, **about})


def score(
    result: Restoration, view: View, metrics: str | Sequence[str], how: str | None = None, dataset: str = ""
) -> pd.DataFrame:
    """Score a restoration: the long table's columns (`sucre_bench.results.rows.Row`), a row a score.

    metrics: "name", "name:variant" or "name:all"; how: the display normalisation, default the method's own.
    A metric the view cannot give is a row with status "skipped" and the reason.
    """
    info, metrics = result.info, [metrics] if isinstance(metrics, str) else metrics
    how = how or info.get("display", "none")
    options, options_id = results.fingerprint({**info.get("options", {}), "display": how})
    shown = display(result.image, how, view.encoding)
    base = results.Row(
        dataset=dataset,
        scene=info.get("scene", ""),
        view=view.name,
        method=info.get("method", ""),
        options=options,
        options_id=options_id,
        n_pixels=int(result.valid.sum()),
        coverage=float(result.valid.mean()),
        seconds=info.get("seconds", float("nan")),
        peak_mb=info.get("peak_mb", float("nan")),
        device=str(info.get("device", "cpu")),
        seed=int(info.get("options", {}).get("seed", 0)),
        code=info.get("code", ""),
        data_id=info.get("data_id", ""),
    )
    measured = Measured(result, base.seconds, base.peak_mb)
    return results.frame(score_rows(measured, shown, view, metric_choices(metrics), base))
