"""A job: one dataset, one method and metrics, each with its options, read from a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError, one_line, unknown_name
from sucre_bench.imaging.display import check_display, is_of_scene
from sucre_bench.imaging.resizing import split_variant
from sucre_bench.jobs.labels import swept_label
from sucre_bench.jobs.presets import plugin_of, preset_of
from sucre_bench.jobs.run_options import Overwrite, RunConfig, Save, Tracking
from sucre_bench.jobs.shard import Shard
from sucre_bench.jobs.study_block import Study
from sucre_bench.machine.files import expanded, regular
from sucre_bench.plugins.options import Choice, check_options, options_of, plain_value, typed
from sucre_bench.plugins.plugin import Kind, Plugin
from sucre_bench.plugins.seeds import seed_of

if TYPE_CHECKING:
    from omegaconf import DictConfig


@dataclass(frozen=True)
class MetricChoice:
    """A metric and the variants of it to compute."""

    choice: Choice
    variants: tuple[str, ...]

    @property
    def plugin(self) -> Plugin:
        return self.choice.plugin


@dataclass(frozen=True)
class Job:
    """One dataset, one method, some metrics: what one Hydra job does.

    degrade: what is done to the dataset first; shard: which part of the views it does; config: all of this as YAML, see
    `read`; shared_pairs: the folder where the jobs of its command share pairs, empty if they share none; method_word:
    what stands before an option of this method alone in the command, "sucre" in a sweep over methods.
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
    config: str
    shared_pairs: str = ""
    method_word: str = "method"

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
            raise InputError(f"{str(fault).splitlines()[0]}; mend the ${{...}} in an override") from fault
        return cls.of(values, swept)

    @classmethod
    def read(cls, config: str) -> Job:
        """Read `config` of a job again, in another process say; its plugin files are loaded first."""
        import yaml

        values: dict[str, Any] = yaml.safe_load(config)
        for file in values["plugins"]:
            plugins.load_file(file)
        return cls.of(values)

    @classmethod
    def of(cls, values: Mapping[str, Any], swept: Sequence[str] = ()) -> Job:
        """Read a configuration. swept: the keys that a sweep varies; labels name their values.

        Raises InputError for what its types alone cannot tell.
        """
        import yaml

        run = RunConfig.of(values)
        dataset, method = _choice("dataset", run.dataset, swept), _choice("method", run.method, swept)
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
            metrics=_metrics(run.metrics),
            out=expanded(run.out),
            views=_view_names(run.views),
            every=run.every,
            first=run.first,
            overwrite=run.overwrite,
            view_timeout_s=run.view_timeout_s,
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
            config=yaml.safe_dump(_plain_tree(values), sort_keys=False, allow_unicode=True),
        )


def _resolved(node: Any) -> Any:
    from omegaconf import OmegaConf

    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node


def _choice(kind: Kind, values: Any, swept: Sequence[str] = ()) -> Choice:
    values = dict(values or {})
    if "name" not in values:
        raise InputError(f"no {kind} is chosen; add {kind}=NAME, `sucre-bench list {kind}s` shows what there is")
    plugin = plugins.find(kind, values.pop("name"))
    label, display = values.pop("label", None), values.pop("display", "")
    if kind == "method":
        check_display(display)
    if label and not str(label).strip():
        raise InputError("is blank", f"{kind}.label", "write a name, or leave it out")
    types = {o.name: o.type for o in options_of(plugin.cls)}
    given = {name: value for name, value in values.items() if value != "???"}  # OmegaConf's sign for "not given"
    options = {name: typed(types[name], value) if name in types else value for name, value in given.items()}
    check_options(plugin, options)
    named = swept_label(plugin, str(label or ""), {**options, "display": display}, swept)
    return Choice(plugin, named, options, display)


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


def _metrics(values: Mapping[str, Any]) -> tuple[MetricChoice, ...]:
    chosen = []
    for given in values.values():
        variants = tuple(given["variants"])
        choice = _choice("metric", {k: v for k, v in given.items() if k != "variants"})
        chosen.append(MetricChoice(choice, _variants(choice.plugin, variants)))
    if not chosen:
        raise InputError("no metric is chosen; add metrics=[NAME,...], `sucre-bench list metrics` shows what there is")
    return tuple(chosen)


def method_choice(name: str, options: Mapping[str, Any]) -> Choice:
    """Return a method or a preset of conf/ with options (label and display too), as Python takes them."""
    plugin = plugin_of("method", name) or plugins.find("method", name)  # which says why there is none
    preset = preset_of("method", name)
    values = preset.sets if preset else {}
    return _choice("method", {"display": plugin.display, **values, **options, "name": plugin.name})


def metric_choices(names: Sequence[str]) -> tuple[MetricChoice, ...]:
    """Read "name", "name:variant" and "name:all", as Python and `sucre-bench score` take them."""
    chosen: dict[str, list[str]] = {}
    for text in names:
        name, _, variant = text.partition(":")
        plugin = plugins.find("metric", name)
        chosen.setdefault(name, []).extend([variant] if variant else plugin.default)
    return _metrics({name: {"name": name, "variants": variants} for name, variants in chosen.items()})


def _variants(plugin: Plugin, names: Sequence[str]) -> tuple[str, ...]:
    """Return the variants that names stand for: each "NAME" or "all", perhaps with a size behind @."""
    chosen: list[str] = []
    for text in names:
        name, resizing = split_variant(text)
        if name != "all" and name not in plugin.variants:
            raise unknown_name(plugin.name, name, ("all", *plugin.variants), "variant")
        if resizing and not plugin.needs <= {"reference"}:
            needs = " and ".join(sorted(plugin.needs))
            raise InputError(
                f"{plugin.name}:{text}: has no score at another size, it needs {needs}; leave @ and size out"
            )
        chosen += [variant + text[len(name) :] for variant in (plugin.variants if name == "all" else [name])]
    return tuple(dict.fromkeys(chosen))


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
            raise InputError("no such list of views", path, "give a text file with one view name a line") from None
        except (OSError, UnicodeDecodeError) as fault:
            raise InputError(f"not a list of views, {one_line(fault)}", path, "save it as UTF-8 text") from fault
    if not names:
        raise InputError("an empty list", "views", "name some views, or leave views= out for all of them")
    return tuple(names)
