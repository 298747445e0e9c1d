"""A line-up: the datasets, configurations, metrics and settings of a run, as one YAML file that others can run.

    datasets: [demo, {name: colmap, root: dive, label: reef}]
    methods:
      - underwater
      - {name: sucre, label: sucre_physical, physical: true}
    metrics: [psnr, uciqe:all]
    sweep: {degrade.noise: [0, 0.02]}
    baseline: underwater
    every: 4

`sweep` has values of other options, all of which are run. Every other key is an option of `sucre-bench run`.
Experiments are the line-ups of conf/experiment/. Paths in a line-up are relative to its folder; only `out` is relative
to the folder where the command runs. Its values are taken as they are: nothing in them is interpolated. Errors name the
file, the key, and what to write instead.
"""

from __future__ import annotations

import itertools
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from sucre_bench import plugins, results
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError, SucreBenchError, did_you_mean, unknown_name
from sucre_bench.jobs.catalogue import is_path, moved_paths, named, option_names, presets, recognised, unknown_option
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.run_options import CONF_FOLDER, RunConfig, Study
from sucre_bench.jobs.words import Word, given, undegraded_label
from sucre_bench.machine.files import expanded, fault_of, reading, write_atomically
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import Choice, options_of
from sucre_bench.plugins.plugin import fits

Kind = Literal["dataset", "method"]
KINDS: tuple[Kind, ...] = ("dataset", "method")

_LISTS = ("datasets", "methods", "metrics", "sweep")
_SETTINGS = tuple(o.name for o in options_of(RunConfig) if o.name not in ("dataset", "method", "metrics", "tracking"))
_NOT_SWEPT = ("dataset", "method", "metrics", "hydra", "out", "plugins", "study", "baseline")


@dataclass(frozen=True)
class Entry:
    """A dataset, method or metric with options of its own.

    name: of a plugin or a preset; options: also its label and, for a method, its display; for a dataset `degrade`, what
    is done to it first.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The given label, empty where none is given."""
        return str(self.options.get("label") or "")

    def words(self, group: str) -> Iterator[Word]:
        """Yield its options as settings. group: where they stand, "method" or "metrics.psnr" say."""
        for name, value in self.options.items():
            yield from _flat("degrade", value) if name == "degrade" else [Word.written(f"{group}.{name}", value)]

    @property
    def as_data(self) -> str | dict[str, Any]:
        """As a line-up file has it."""
        return {"name": self.name, **self.options} if self.options else self.name


@dataclass(frozen=True)
class LineUp:
    """What a line-up file says. An empty field says nothing: the command's words or the defaults hold.

    metrics: each named "name" or "name:variant"; sweep: option -> values; settings: other options of a run; place: the
    file, as the user named it.
    """

    datasets: tuple[Entry, ...] = ()
    methods: tuple[Entry, ...] = ()
    metrics: tuple[Entry, ...] = ()
    sweep: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    place: str = ""

    def entries(self, kind: Kind) -> tuple[Entry, ...]:
        """Its datasets or its methods."""
        return self.datasets if kind == "dataset" else self.methods

    def words(self) -> Iterator[Word]:
        """Yield the settings of all but datasets and methods."""
        if self.metrics:
            yield Word.written("metrics", list(dict.fromkeys(metric.name for metric in self.metrics)))
        for metric in self.metrics:
            yield from metric.words(f"metrics.{metric.name.partition(':')[0]}")
        for name, value in self.settings.items():
            yield from _flat(name, value)
        for key, values in self.sweep.items():
            yield Word.written(key, *values)

    def moved(self, seen: Callable[[str], str]) -> LineUp:
        """Return the line-up with each path in it as another folder sees it."""

        def watered(degrade: Any) -> Any:
            is_path = isinstance(degrade, dict) and isinstance(degrade.get("add_water"), str)
            return {**degrade, "add_water": seen(degrade["add_water"])} if is_path else degrade

        def entries(kind: Kind) -> tuple[Entry, ...]:
            made = []
            for entry in self.entries(kind):
                options = {**entry.options, **moved_paths(kind, entry.name, entry.options, seen)}
                options |= {"degrade": watered(options["degrade"])} if "degrade" in options else {}
                made.append(replace(entry, options=options))
            return tuple(made)

        settings = {key: watered(value) if key == "degrade" else value for key, value in self.settings.items()}
        settings |= {"plugins": [seen(file) for file in settings["plugins"]]} if "plugins" in settings else {}
        if str(settings.get("views", "")).endswith(".txt"):
            settings["views"] = seen(settings["views"])
        return replace(self, datasets=entries("dataset"), methods=entries("method"), settings=settings)

    def as_yaml(self, comment: str = "") -> str:
        """Return the text of its file: an entry a line. comment: its first lines."""
        lines = [f"# {line}" for line in comment.splitlines()]
        for key, entries in (("datasets", self.datasets), ("methods", self.methods)):
            lines += [f"{key}:", *(f"  - {_in_line(entry.as_data)}" for entry in entries)] if entries else []
        if self.metrics:
            lines.append(f"metrics: {_in_line([metric.as_data for metric in self.metrics])}")
        if self.sweep:
            lines += ["sweep:", *(f"  {key}: {_in_line(list(values))}" for key, values in self.sweep.items())]
        lines += [f"{key}: {_in_line(value)}" for key, value in self.settings.items()]
        return "\n".join([*lines, ""])


def _flat(key: str, value: Any) -> Iterator[Word]:
    """The settings of a value: those of a mapping one by one."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{key}.{name}", inner)
    else:
        yield Word.written(key, value)


def _in_line(value: Any) -> str:
    import yaml

    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10**6)
    return str(text).removesuffix("\n").removesuffix("\n...")


def read_experiment(name: str) -> LineUp:
    """Return an experiment of conf/. Raises InputError for a name that none has, with the nearest."""
    known = [preset.name for preset in presets("experiment")]
    if name not in known:
        raise InputError(f"no experiment is called '{name}'; {did_you_mean(name, known)}")
    return replace(read_line_up(CONF_FOLDER / "experiment" / f"{name}.yaml"), place=f"experiment={name}")


def read_line_up(path: Path) -> LineUp:
    """Return a line-up, with the plugin files it names loaded. Raises InputError for what is wrong with it."""
    line_up = line_up_in(path)

    def seen(place: str) -> str:
        return os.path.normpath(path.parent / expanded(place)) if place else place

    try:
        files = [str(Path(seen(file)).resolve()) for file in line_up.settings.get("plugins", [])]
        for file in files:
            plugins.load_file(file)
        for key, value in line_up.settings.items():
            if key != "plugins":
                _check_setting(key, value)
        datasets = tuple(
            Entry(recognised(Path(seen(one.name))), {"root": one.name, **one.options}) if is_path(one.name) else one
            for one in line_up.datasets
        )
        for kind, entries in (("dataset", datasets), ("method", line_up.methods)):
            for entry in entries:
                _check_entry("dataset" if kind == "dataset" else "method", entry)
        settings = {**line_up.settings, **({"plugins": files} if files else {})}
        return replace(line_up, datasets=datasets, settings=settings).moved(seen)
    except SucreBenchError as fault:
        raise fault.within(path) from fault


def line_up_in(path: Path) -> LineUp:
    """Return the line-up of a file as it stands there: names and options are not checked, no plugin file is loaded."""
    content = read_content(path)
    try:
        entries = {key: tuple(_entries(key, content)) for key in ("datasets", "methods", "metrics")}
        sweep = _sweep(content.get("sweep") or {})
        files = content.get("plugins")
        if isinstance(files, str):
            content["plugins"] = [files]
        elif files is not None and not fits(list[str], files):
            raise InputError(f"{files!r} is no list of files", "plugins", "write plugins: [FILE, ...]")
    except InputError as fault:
        raise fault.within(path) from fault
    settings = {key: content[key] for key in _SETTINGS if content.get(key) is not None}
    return LineUp(**entries, sweep=sweep, settings=settings, place=str(path))


def read_content(path: Path) -> dict[str, Any]:
    """What a line-up holds, by key. Raises InputError, naming the file, for what is no line-up or an unknown key."""
    import yaml

    if fault := fault_of(path):
        raise InputError(fault, path, "give a line-up, `sucre-bench lineup RESULTS` writes one")
    with reading(path, "save it as YAML in UTF-8"):
        try:
            content = read_yaml(path.read_text(encoding="utf-8-sig"))
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            raise InputError(f"line {line}: is no plain YAML, {error.problem}", path, "mend the line") from error
    if content is None:
        raise InputError("is empty", path, "list methods: [NAME, ...]")
    if not isinstance(content, dict):
        raise InputError("holds no keys", path, "write methods: [NAME, ...]")
    for key in content:
        if key not in (*_LISTS, *_SETTINGS):
            raise unknown_name(str(path), str(key), (*_LISTS, *_SETTINGS), "key")
    return content


def _entries(key: str, content: Mapping[str, Any]) -> Iterator[Entry]:
    """The entries of a list as they stand in the file: a name, or a name with options."""
    given = content.get(key, ())
    given = [given] if isinstance(given, (str, dict)) else given
    if key in content and not (isinstance(given, list) and given):
        raise InputError("is no list of names", key, f"write {key}: [NAME, ...]")
    labels: Counter[tuple[str, str]] = Counter()
    for one in given:
        options = {"name": one} if isinstance(one, str) else one
        if not (isinstance(options, dict) and isinstance(options.get("name"), str)):
            raise InputError(f"{one!r} has no name", key, "write NAME, or {name: NAME, OPTION: VALUE}")
        entry = Entry(options["name"], {str(name): value for name, value in options.items() if name != "name"})
        label = entry.label or ("" if key == "metrics" or entry.options else entry.name)
        labels[label, repr((entry.label, entry.options.get("degrade")))] += 1
        yield entry
    for (label, _), times in labels.items():
        if label and times > 1:
            raise InputError(f"{times} have the label '{label}'", key, "give each a label of its own")


def _check_entry(kind: Kind, entry: Entry) -> None:
    """Raise InputError for an unknown name or option."""
    named(kind, entry.name)
    names = [*option_names(kind, entry.name), *(["degrade"] if kind == "dataset" else [])]
    for option, value in entry.options.items():
        if option not in names:
            raise unknown_option(f"{entry.name}.{option}", option, [entry.name], names)
        if option == "degrade":
            _check_setting(option, value)


def _sweep(given: Any) -> dict[str, list[Any]]:
    if not isinstance(given, dict):
        raise InputError("is no mapping", "sweep", "write sweep: {OPTION: [VALUE, ...]}")
    for key, values in given.items():
        head, dot, _ = str(key).partition(".")
        is_word = re.fullmatch(r"[A-Za-z_][\w-]*(\.\w+)*", str(key))
        if not is_word or (head in _NOT_SWEPT and not (head in KINDS and dot)):
            raise InputError("cannot be swept", f"sweep.{key}", "list datasets and methods, sweep their options")
        if not isinstance(values, list) or not values:
            raise InputError("is no list of values", f"sweep.{key}", f"write {key}: [VALUE, ...]")
    return {str(key): values for key, values in given.items()}


def _check_setting(key: str, value: Any) -> None:
    """Raise InputError for several values where there is one, and for one where there are options."""
    is_nested = key in ("degrade", "study", "shard")
    if is_nested != isinstance(value, dict):
        expected = f"{{OPTION: VALUE}} below {key}:" if is_nested else "one value"
        raise InputError(f"{value!r} does not fit", key, f"write {expected}")
    if isinstance(value, list) and key != "views":
        raise InputError(f"{value} are several values", key, f"write one, or sweep: {{{key}: {value}}}")


# -- `lineup.yaml` of a results folder: each run adds its datasets, configurations and metrics to it -------------

# Settings of a command that a line-up has where they are not as by default.
_RECORDED: dict[str, Any] = {"views": None, "every": 1, "first": None, "seed": 0, "save": "display", "baseline": ""}


LINE_UP = "lineup.yaml"


def record_line_up(jobs: Sequence[Job]) -> None:
    """Add the jobs of a command to the line-up of their results folder. Raises OutputError if it cannot be written.

    Settings such as views and study are those of the last command. A file that is no line-up is replaced.
    """
    first, out = jobs[0], jobs[0].out
    try:
        older = _stored(out)
    except InputError:
        older = LineUp()
    datasets = {_full_label(entry): entry for entry in older.datasets}
    methods = {entry.label or entry.name: entry for entry in older.methods}
    metrics: dict[str, list[Entry]] = {}
    for job in jobs:
        label = undegraded_label(job.dataset.label, job.degrade.record, job.dataset.plugin.name)
        options = {"label": label, **given("dataset", job.dataset.record, job.seed)}
        options |= {"degrade": job.degrade.record} if job.degrade.record else {}
        datasets[job.dataset.label] = Entry(job.dataset.plugin.name, options)
        options = {"label": job.method.label, **given("method", job.method.record, job.seed)}
        methods[job.method.label] = Entry(job.method.plugin.name, options)
        metrics |= {metric.plugin.name: list(_metric(metric)) for metric in job.metrics}
    replicates = {job.replicate for job in jobs}
    replicates |= set(older.sweep.get("replicate", [0] if older.methods else []))
    settings = {name: getattr(first, name) for name, default in _RECORDED.items() if getattr(first, name) != default}
    settings |= {"views": list(first.views)} if first.views is not None else {}
    settings |= {"plugins": list(first.plugins)} if first.plugins else {}
    if first.study:
        values = {name: list(v) if isinstance(v, tuple) else v for name, v in vars(first.study).items()}
        settings["study"] = {name: value for name, value in values.items() if value != Study.defaults()[name]}
    line_up = LineUp(
        _labelled(datasets),
        _labelled(methods),
        (*itertools.chain(*metrics.values()), *(e for e in older.metrics if e.name.partition(":")[0] not in metrics)),
        {"replicate": sorted(replicates)} if replicates != {0} else {},
        settings,
    )
    line_up = line_up.moved(lambda path: _relative(path, out))
    text = line_up.as_yaml(f"The line-up that made {out}. To run it: sucre-bench run {LINE_UP}")
    write_atomically(out / LINE_UP, text.encode())


def _full_label(entry: Entry) -> str:
    """The label of a dataset's rows."""
    return Degradation.of(entry.options.get("degrade") or {}).labelled(entry.label or entry.name)


def _labelled(entries: Mapping[str, Entry]) -> tuple[Entry, ...]:
    """The entries, each with a label unless it has the same without: several of one name would name their options."""
    names = Counter(entry.name for entry in entries.values())
    every = []
    for entry in entries.values():
        options = {"label": entry.label or entry.name, **entry.options}
        if options["label"] == entry.name and names[entry.name] == 1:
            del options["label"]
        every.append(replace(entry, options=options))
    return tuple(every)


def _metric(choice: Choice) -> Iterator[Entry]:
    name, variants = choice.plugin.name, choice.variants
    options = given("metric", choice.record)
    if variants == choice.plugin.default or options:
        yield Entry(name, {**({} if variants == choice.plugin.default else {"variants": list(variants)}), **options})
    elif variants == tuple(choice.plugin.variants):
        yield Entry(f"{name}:all")
    else:
        yield from (Entry(f"{name}:{variant}") for variant in variants)


def _relative(path: str, folder: Path) -> str:
    """A path as seen from a folder; absolute where it is absolute and leads out of the folder where we are."""
    is_here = Path(path).is_relative_to(Path.cwd())
    return os.path.relpath(path, folder) if is_here or not Path(path).is_absolute() else path


def _stored(out: Path) -> LineUp:
    """The line-up of a results folder, with paths as seen from here."""
    return line_up_in(out / LINE_UP).moved(lambda path: os.path.normpath(out / path))


def line_up_of(out: Path, folder: Path) -> tuple[LineUp, list[str]]:
    """Return the line-up of a results folder, and notes on where a run of it would do other than the folder holds.

    folder: where its file will be, to which relative paths are rewritten.
    Raises InputError when the folder has no results, or its runs did not record a line-up.
    """
    rows = results.restoration_rows(results.read(out))
    if not (out / LINE_UP).is_file():
        raise InputError("records no line-up", out, "repeat the run's command, which computes nothing again")
    line_up, notes = _stored(out), list[str]()
    there = set(rows[["dataset", "method"]].itertuples(index=False, name=None))
    labels = [entry.label or entry.name for entry in line_up.methods]
    for dataset, method in itertools.product(map(_full_label, line_up.datasets), labels):
        if (dataset, method) not in there:
            notes.append(f"the folder has no results of {method} on {dataset}; the line-up runs it too")
    views = rows.groupby(["dataset", "method"])["view"].agg(frozenset)
    for dataset, by_method in views.groupby("dataset"):
        if by_method.nunique() > 1:
            text = "the line-up takes those of the last command"
            notes.append(f"not every method has the same views of {dataset}; {text}")
    return line_up.moved(lambda path: _relative(path, folder)), notes
