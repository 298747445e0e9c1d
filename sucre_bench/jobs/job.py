"""A job: one dataset, one method and metrics, each with its options, read from a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError, MissingFileError, one_line
from sucre_bench.imaging.display import is_of_scene
from sucre_bench.jobs.metric_words import MetricChoice, chosen_metrics
from sucre_bench.jobs.run_options import Overwrite, RunConfig, Save, Shard, Study, Tracking
from sucre_bench.machine.files import expanded, regular
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import Choice, plain_value, plugin_choice, seed_of

if TYPE_CHECKING:
    from omegaconf import DictConfig


@dataclass(frozen=True)
class Job:
    """One dataset, one method, some metrics: what one Hydra job does.

    degrade: what is done to the dataset first; shard: which part of the views it does; values: all of this as plain
    data; shared_pairs: the folder where the jobs of its command share pairs, empty if they share none; method_word:
    what stands before an option of this method alone in the command, "sucre" say.
    """

    dataset: Choice
    degrade: Degradation
    replicate: int
    shard: Shard
    method: Choice
    metrics: tuple[MetricChoice, ...]
    out: Path
    views: tuple[str, ...] | None
    every: int
    first: int | None
    overwrite: Overwrite
    view_timeout_s: float | None
    workers: int
    save: Save
    seed: int
    report: bool
    study: Study | None
    baseline: str
    plugin_files: tuple[str, ...]
    pairs_gb: float
    cache_gb: float
    cache_keep: bool
    tracking: Tracking
    values: Mapping[str, Any]
    shared_pairs: str = ""
    method_word: str = "method"

    @property
    def config(self) -> str:
        """The job as YAML, see `read`."""
        import yaml

        return str(yaml.safe_dump(self.values, sort_keys=False, allow_unicode=True))

    @property
    def drawn(self) -> Degradation:
        """The degradation with the draws of this replicate."""
        return replace(self.degrade, seed=seed_of(self.degrade.seed, "degrade", self.replicate))

    def of_all_views(self) -> Job:
        """Return the job with all views of its dataset instead of those that the command chose."""
        return replace(self, views=None, every=1, first=None, shard=Shard())

    @classmethod
    def composed(cls, config: DictConfig, swept: Sequence[str] = ()) -> Job:
        """Read a configuration that Hydra composed. swept: the keys that a sweep varies, see `of`."""
        from omegaconf.errors import OmegaConfBaseException

        try:
            values = {str(key): _resolved(config[key]) for key in config if key != "hydra"}
        except OmegaConfBaseException as fault:
            raise InputError(str(fault).splitlines()[0], fault.full_key or "", "mend the ${...} in it") from fault
        return cls.of(values, swept)

    @classmethod
    def read(cls, config: str) -> Job:
        """Read `config` of a job again, in another process say; its plugin files are loaded first."""
        values: dict[str, Any] = read_yaml(config)
        for file in values["plugins"]:
            plugins.load_file(file)
        return cls.of(values)

    @classmethod
    def of(cls, values: Mapping[str, Any], swept: Sequence[str] = ()) -> Job:
        """Read a configuration. swept: the keys that a sweep varies; labels name their values.

        Raises InputError for what its types alone cannot tell.
        """
        run = RunConfig.of(values)
        chosen = plugin_choice("dataset", run.dataset), plugin_choice("method", run.method)
        dataset, method = (replace(choice, label=_swept_label(choice, swept)) for choice in chosen)
        _check_scene_display(method.display, run)
        for kind, choice in (("dataset", dataset), ("method", method)):
            if choice.label != choice.plugin.name:  # `read` knows no sweep
                values = {**values, kind: {**values[kind], "label": choice.label}}
        return cls(
            dataset=replace(dataset, label=run.degrade.labelled(dataset.label), replicate=run.replicate),
            degrade=run.degrade,
            replicate=run.replicate,
            shard=run.shard,
            method=replace(method, replicate=run.replicate),
            metrics=chosen_metrics(run.metrics),
            out=expanded(run.out),
            views=_view_names(run.views),
            every=run.every,
            first=run.first,
            overwrite=run.overwrite,
            view_timeout_s=run.view_timeout_s,
            workers=run.workers,
            save=run.save,
            seed=run.seed,
            report=run.report,
            study=run.study and replace(run.study, baseline=run.study.baseline or run.baseline),
            baseline=run.baseline,
            plugin_files=tuple(map(str, run.plugins)),
            pairs_gb=run.pairs_gb,
            cache_gb=run.cache_gb,
            cache_keep=run.cache_keep,
            tracking=run.tracking,
            values=_plain_tree(values),
        )


def _swept_label(choice: Choice, swept: Sequence[str]) -> str:
    """The label of a choice with the swept options: "sucre,pairing=depth". A path counts by its last part."""
    options, kind = {**choice.options, "display": choice.display}, choice.plugin.kind
    named = [name for name in options if f"{kind}.{name}" in swept or (name == "seed" and "seed" in swept)]
    shown = ((name, options[name]) for name in named)
    parts = [f"{name}={value.name if isinstance(value, Path) else plain_value(value)}" for name, value in shown]
    return ",".join([choice.label, *(part.replace(" ", "") for part in parts)])


def _resolved(node: Any) -> Any:
    from omegaconf import OmegaConf

    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node


def _check_scene_display(display: str, run: RunConfig) -> None:
    """Raise InputError where views are to be shown alike, and not all restorations will be there."""
    if is_of_scene(display) and run.save != "full":
        raise InputError(f"{display} reads all stored restorations of a scene", "method.display", "add save=full")
    if is_of_scene(display) and run.shard.count > 1:
        raise InputError(f"{display} needs all views of a scene in one job", "method.display", "leave out shard.count")


def _plain_tree(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain_tree(inner) for key, inner in value.items()}
    return [_plain_tree(inner) for inner in value] if isinstance(value, (list, tuple)) else plain_value(value)


def _view_names(given: Any) -> tuple[str, ...] | None:
    """A list of names, one name, or the path of a text file with one name a line."""
    if given is None:
        return None
    names = [str(n) for n in given] if isinstance(given, list) else [str(given)]
    if len(names) == 1 and names[0].endswith(".txt"):
        path = expanded(names[0])
        try:
            lines = regular(path).read_text(encoding="utf-8-sig").splitlines()
            names = [line.strip() for line in lines if line.strip()]
        except FileNotFoundError:
            raise MissingFileError(
                "no such list of views", path, "give a text file with one view name a line"
            ) from None
        except (OSError, UnicodeDecodeError) as fault:
            raise InputError(f"not a list of views, {one_line(fault)}", path, "save it as UTF-8 text") from fault
    if not names:
        raise InputError("an empty list", "views", "name some views, or leave views= out for all of them")
    return tuple(names)
