"""Functions for Python scripts: load scenes, restore a view, score the restoration, list plugins and experiments."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins, results
from sucre_bench.arguments import checked, checked_fields
from sucre_bench.arrays import Array, DataFrame
from sucre_bench.engine.job import make_ready, measured_restore
from sucre_bench.engine.score import score_rows, scorers
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.imaging.colour_profiles import restoration_in_srgb
from sucre_bench.imaging.display import displayed, is_of_scene
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.imaging.image_files import SUFFIXES, write_image
from sucre_bench.jobs import catalogue
from sucre_bench.jobs.catalogue import method_choice, metric_choices
from sucre_bench.plugins.call_method import shown_with
from sucre_bench.plugins.options import Choice, create, source_hash
from sucre_bench.results.restorations import write_arrays
from sucre_bench.results.rows import COSTS
from sucre_bench.scene import Encoding, Restoration, Scene, View
from sucre_bench.thumbnails import as_html

# Methods with their options that have imported and compiled what they need.
_ready: set[str] = set()
# What rows have as `info` of a restoration has it.
_SAME = {"scene", "method", "code", "data_id", "seconds", "peak_mb"}


@dataclass(frozen=True, eq=False, repr=False)
@checked_fields
class Restored(Restoration):
    """The result of `restore`: a restoration, and the restored image that is made of it.

    >>> scene = load_scene("demo", views=2, width=160, height=120)
    >>> result = restore("stitching", scene, 0)
    >>> bool(np.nanmin(result.shown) >= 0 and np.nanmax(result.shown) <= 1)
    True
    """

    display: str = "none"
    """Name of the normalisation that makes the restored image."""

    encoding: Encoding = "gamma"
    """Of the view, "gamma" or "linear"."""

    @property
    def shown(self) -> Array:
        """(H, W, 3) float32 in [0, 1], gamma-encoded, NaN = a hole: the restored image, which metrics score."""
        return displayed(self, self.display, self.encoding)[0]

    @property
    def picture(self) -> Array:
        """(H, W, 3) like `shown`, but with filled pixels: the picture that `save` writes."""
        shown, filled = displayed(self, self.display, self.encoding)
        return shown if filled is None else np.asarray(np.where(np.isnan(shown), filled, shown))

    def _repr_html_(self) -> str:
        return as_html(repr(self), {str(self.info.get("method", "")): self.picture})

    @checked
    def save(self, path: str | Path) -> None:
        """Write the restored image with 8 bits and black holes. With the suffix .npz, write J, B, beta and gamma.

        Raises InputError if the suffix is neither .npz nor that of an image, and OutputError if the file cannot be
        written.
        """
        path = Path(path)
        if path.suffix.lower() == ".npz":
            write_arrays(path, self)
        elif path.suffix.lower() in SUFFIXES:
            write_image(path, to_8bit(self.picture)[..., ::-1])
        else:
            raise InputError(
                f"cannot be written as '{path.suffix}'",
                path,
                f"end it in .npz or {', '.join(SUFFIXES)}",
            )


@checked
def load_scenes(name: str, **options: Any) -> Iterator[Scene]:
    """Return the scenes of a dataset. The first is opened at once, each other when its turn comes.

    - name: the dataset's name, see `list_datasets`;
    - options: its options, for example root="dive/".

    Raises InputError for an unknown name or option, and for data that are not as expected.

    >>> [len(scene) for scene in load_scenes("demo", views=2, width=160, height=120)]
    [2]
    """
    scenes = iter(create(plugins.find("dataset", name), options).scenes())
    first = itertools.islice(scenes, 1)
    return (replace(scene, dataset=name) for scene in itertools.chain(list(first), scenes))


@checked
def load_scene(name: str, scene: str = "", **options: Any) -> Scene:
    """Return the scene of a dataset: the only one, or that with a name.

    - name: the dataset's name, see `list_datasets`;
    - scene: the scene's name; it may be left out if the dataset has one scene;
    - options: options of the dataset, for example root="dive/".

    Raises what `load_scenes` raises, and InputError if no scene has the name, or if there are several and no name.

    >>> load_scene("demo", views=2, width=160, height=120)["view_001.png"].rgb.shape
    (120, 160, 3)
    """
    scenes = dict[str, Scene]()
    for found in load_scenes(name, **options):
        if found.name == scene:
            return found
        scenes[found.name] = found
    if len(scenes) == 1 and not scene:
        return found
    fault = f"has no scene '{scene}'" if scene else f"has {len(scenes)} scenes"
    raise InputError(fault, f"dataset '{name}'", did_you_mean(scene, scenes))


@checked
def restore(
    method: str | Any, scene: Scene, view: View | str | int, **options: Any
) -> Restored:
    """Restore one view with a method.

    - method: the method's name, that of a preset ("sucre_exact", say), or a method object;
    - scene: the scene of the view; methods of several views use its other views;
    - view: a view, its name, or its place in the scene (from 0);
    - options: the options of a method that is given by name, and `display`, the normalisation that makes the
      restored image (default: the method's own).

    `info` of the result also has method, options, display, seconds and peak_mb (MB of memory).

    Raises InputError if the scene has no such view or lacks what the method needs. PluginError if the result breaks the
    contract; SolveError if the estimation has no answer. NotApplicableError (a SolveError) if the method is not made
    for the view.

    >>> scene = load_scene("demo", views=2, width=160, height=120)
    >>> result = restore("gray_world", scene, 0)
    >>> result.shown.shape
    (120, 160, 3)
    """
    label = how = ""
    if isinstance(method, str):
        method = method_choice(method, options)
        options = {}
    if isinstance(method, Choice):
        label = method.label
        how = method.display
        method = method.make()
    if options:
        raise InputError(
            "options given beside a method object",
            type(method).__name__,
            "give them when making it",
        )
    plugin = plugins.plugin_of(method)
    if absent := plugins.missing_needs(plugin, scene.has):
        raise InputError(absent, plugin.name, "choose another method or dataset")
    how = how or plugin.display
    if is_of_scene(how):
        raise InputError(
            f"display '{how}': needs all views; leave out @scene, or use `sucre-bench run ... save=full`"
        )
    view = view if isinstance(view, View) else scene[view]
    if not any(
        one is view or (one.name == view.name and one.pixels is view.pixels)
        for one in scene.views
    ):
        raise InputError(
            f"'{view.name}' is a view of another scene",
            scene.name,
            "pass a view of this one, or its name",
        )
    if repr(method) not in _ready:
        make_ready(method)
        _ready.add(repr(method))
    with shown_with(how):
        measured = measured_restore(method, scene, view)
    about = {
        "method": label or plugin.name,
        "options": {"name": plugin.name, "display": how, **asdict(method)},
        "display": how,
        "seconds": measured.seconds,
        "peak_mb": measured.peak_mb,
        "dataset": scene.dataset or scene.name,
        "scene": scene.name,
        "view": view.name,
        "data_id": scene.data_id,
        "code": source_hash(plugin),
    }
    restoration = measured.restoration
    known = {field.name: getattr(restoration, field.name) for field in fields(Restoration)}
    known["info"] = {**restoration.info, **about}
    return Restored(**known, display=how, encoding=view.encoding)


@checked
def score(
    result: Restoration,
    view: View,
    metrics: str | Sequence[Any] = (),
    how: str | None = None,
    dataset: str = "",
) -> DataFrame:
    """Score a restoration. Return a table with one row for each score (columns: `sucre_bench.results.rows.Row`).

    - result: what `restore` returned;
    - view: the restored view;
    - metrics: "name", "name:variant" or "name:all", or a list of these and of metric objects; default those of
      `sucre-bench run`;
    - how: the display normalisation; default the method's own;
    - dataset: the dataset's name in the rows; default that of the scene.

    If a metric cannot score the view, its row has the status "skipped" and the reason. `sucre_bench.wide` turns the
    rows into a table with one column for each metric. Raises InputError for a restoration of another view or size,
    and for an unknown metric.

    >>> scene = load_scene("demo", views=2, width=160, height=120)
    >>> rows = score(restore("gray_world", scene, 0), scene[0], metrics=["psnr", "uciqe"])
    >>> sorted(set(rows["metric"]) & {"psnr", "uciqe"})
    ['psnr', 'uciqe']
    """
    if result.image.shape != view.rgb.shape:
        sizes = f"is {result.image.shape}, the view {view.rgb.shape}"
        raise InputError(sizes, "score(result)", "restore the view at its own size")
    metrics = [metrics] if isinstance(metrics, str) else metrics
    result = restoration_in_srgb(result, view)
    # None: not measured, not known
    info = {name: value for name, value in result.info.items() if value is not None}
    restored = info.get("view", view.name)
    if restored != view.name:
        remedy = "pass the view that was restored"
        raise InputError(f"is of {restored}, the view is {view.name}", "score(result)", remedy)
    how = how or info.get("display", "none")
    given = {**info.get("options", {}), "display": how}
    options, options_id = results.fingerprint(given)
    shown = displayed(result, how, view.encoding)[0]
    base = results.Row(
        dataset=dataset or info.get("dataset", ""),
        view=view.name,
        options=options,
        options_id=options_id,
        seed=given.get("seed", 0),
        **{name: info[name] for name in info.keys() & _SAME},
    )
    rows = score_rows(
        result, shown, view, scorers(metric_choices(metrics or ["default"])), base
    )
    return results.frame(sorted(rows, key=lambda row: row.metric in COSTS))


@checked
def list_methods() -> DataFrame:
    """Return a table of methods and presets by name: what each does, what it needs, and whether it can run here.

    >>> list_methods().loc["gray_world", "needs"]
    []
    """
    return _table("method", "needs")


@checked
def list_datasets() -> DataFrame:
    """Return a table of the datasets by name: what each holds, what its scenes may have, and where to get it.

    >>> "depth" in list_datasets().loc["demo", "has"]
    True
    """
    return _table("dataset", "has", "source")


@checked
def list_metrics() -> DataFrame:
    """Return a table of the metrics by name: what each measures, its unit, its better direction, and its variants.

    >>> list_metrics().loc["psnr", "better"]
    'higher'
    """
    return _table("metric", "needs", "unit", "better", "variants")


@checked
def list_experiments() -> DataFrame:
    """Return a table of the experiments by name, with what each does.

    >>> "demo" in list_experiments().index
    True
    """
    import pandas as pd

    return pd.DataFrame(catalogue.preset_entries("experiment")).set_index("name")


def _table(kind: plugins.Kind, *columns: str) -> DataFrame:
    import pandas as pd

    every = map(catalogue.entry, plugins.discover(kind).values())
    known = [entry for entry in every if "installed" in entry]
    if kind == "method":
        known += catalogue.configured_entries(kind)
    table = pd.DataFrame(known).set_index("name")
    table["variants"] = [list(variants) for variants in table["variants"]]
    return table[["description", *columns, "installed"]]
