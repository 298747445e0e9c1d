"""From the words of a command to its jobs.

Every dataset meets every method. A word that begins with the name or label of one of them, `sucre.physical=true`, is
for it alone. A word for methods or datasets in general, `method.physical=true`, is for those that have the option.
A job begins with what its dataset, method and metrics start from, as plain data. The words' values take their places,
and the types of the plugins' own fields check them (`Job.of`), before any work.
"""

from __future__ import annotations

import difflib
import itertools
import os
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import Any, get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, UnknownPluginError, in_one_line, unknown_name
from sucre_bench.jobs.catalogue import (
    SEED,
    configuration,
    default_choice,
    is_path,
    metrics_of,
    named,
    option_names,
    plugin_of,
    presets,
    recognised,
    unknown_option,
)
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.lineup import KINDS, Entry, Kind, LineUp, read_experiment, read_line_up
from sucre_bench.jobs.run_options import Launcher, RunConfig, launcher_of
from sucre_bench.jobs.words import QUOTED, Word, first_line, parse, quoted
from sucre_bench.machine.files import expanded
from sucre_bench.machine.progress import say
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import options_of
from sucre_bench.results.layout import as_one_file
from sucre_bench.results.rows import fingerprint


@dataclass(frozen=True)
class Command:
    """What the words of a command ask for.

    words: the overrides, with ~ expanded; is_sweep: whether it may have several jobs: by -m, or a line-up; only then is
    there a launcher of jobs; shared_pairs: the folder where its jobs share pairs, the same for the same words, empty if
    they share none.
    """

    jobs: tuple[Job, ...]
    words: tuple[str, ...]
    is_sweep: bool
    launcher: Launcher
    shared_pairs: str


_SWEEPER = "hydra.sweeper.params."  # before words that Hydra sweeps over


def jobs(words: Sequence[str], multirun: bool) -> Command:
    """Read overrides and perhaps a line-up file, expand their sweeps, and check every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    or a dataset's option without a dataset. Also for two jobs with one label, or a line-up that cannot be read.
    """
    # A leading ~ of a value is expanded here; the shell does so only at the start of a word.
    parts = [(word, word.partition("=")[0], word.partition("=")[2].strip("'\"")) for word in words]
    words = [f"{key}='{expanded(value)}'" if value.startswith("~/") else word for word, key, value in parts]
    files = [word for word in words if is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")]
    if len(files) > 1:
        raise InputError("a second line-up", files[1], "run one at a time")
    overrides = [word for word in words if word not in files]
    for word in overrides:
        if len(re.sub(QUOTED, "", f"{word}.").splitlines()) > 1:  # in quotes it is part of a name
            raise InputError(f"{in_one_line(word)!r}: holds a line break; give each word in one line")
        if is_bare(word):
            raise bare_word(word, overrides)
    line_up, typed = _with_line_up(expanded(files[0]) if files else None, parse(overrides))
    of_hydra = [word for word in typed if "/" in word.key or "@" in word.key or word.head == "hydra"]
    swept = [word for word in of_hydra if word.key.startswith(_SWEEPER)]
    params = parse(f"{word.key.removeprefix(_SWEEPER)}={','.join(map(str, word.values))}" for word in swept)
    modes = [word.values[0] for word in of_hydra if word.key == "hydra.mode"]
    if unknown := set(map(str, modes)) - {"RUN", "MULTIRUN"}:
        raise InputError(f"'{unknown.pop()}' is no mode", "hydra.mode", "give RUN or MULTIRUN")
    launcher = launcher_of(word for word in of_hydra if word not in swept and word.key != "hydra.mode")
    is_sweep = multirun or bool(line_up.place) or "MULTIRUN" in modes
    _refuse(typed, line_up, is_sweep)
    made = _jobs([*params, *(word for word in typed if word not in of_hydra)], line_up)
    _refuse_same_place(made)
    pairing = [job for job in made if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = {(job.dataset.label, job.replicate, job.shard.index, job.shard.count) for job in pairing}
    # Jobs with methods of several views share pairs where they work on the same views.
    shared_pairs = f"x{fingerprint({'command': words})[1]}" if len(views) < len(pairing) else ""
    made = [replace(job, shared_pairs=shared_pairs) for job in made] if shared_pairs else made
    return Command(tuple(made), tuple(words), is_sweep, launcher, shared_pairs)


def _with_line_up(file: Path | None, typed: Sequence[Word]) -> tuple[LineUp, list[Word]]:
    """Read the line-up or the experiment that the words name, with all plugins loaded; and the other words."""
    experiments = [word for word in typed if word.key == "experiment"]
    given = (word.values[0] for word in typed if word.key == "plugins")
    plugin_files = [str(one) for value in given for one in (value if isinstance(value, list) else [value])]
    for plugin_file in plugin_files:  # before its plugins can be chosen
        plugins.load_file(plugin_file)
    if len(experiments) + (file is not None) > 1:
        raise InputError("beside another experiment or line-up", experiments[-1].text, "run one at a time")
    line_up = LineUp()
    if file is not None:
        line_up = read_line_up(file)
    elif experiments:
        name = experiments[0].values[0]
        if len(experiments[0].values) > 1 or not isinstance(name, str):
            raise InputError("one experiment at a time", experiments[0].text, "give experiment=NAME")
        line_up, kept = read_experiment(name), []
        for entry in line_up.methods:  # a study needs all of its own; others go without what lacks an extra
            plugin = plugin_of("method", entry.name) if "study" not in line_up.settings else None
            if plugin and (lacking := absent(*plugin.requires)) and lacking.is_extra:
                say(f"{entry.label or entry.name} is left out: {lacking}")
            else:
                kept.append(entry)
        line_up = replace(line_up, methods=tuple(kept))
    if plugin_files:
        every = list(dict.fromkeys([*line_up.settings.get("plugins", []), *plugin_files]))
        line_up = replace(line_up, settings={**line_up.settings, "plugins": every})
    return line_up, [word for word in typed if word.key not in ("experiment", "plugins")]


# -- words and line-ups: which word is for which job -----------------------------------------------------------


@dataclass(frozen=True)
class _Option:
    """What a word sets. owner: name or label of the datasets or methods; empty for all that have the option."""

    kind: Kind
    owner: str
    name: str

    def is_for(self, entry: Entry) -> bool:
        """Whether a dataset or method has the option, and the word means it."""
        is_meant = self.owner in ("", entry.name, entry.label)
        return is_meant and self.name.partition(".")[0] in option_names(self.kind, entry.name)


def _jobs(typed: Sequence[Word], line_up: LineUp) -> list[Job]:
    """What the words and the line-up ask for, a job each. A word prevails over the line-up.

    Raises InputError at the word that is wrong, or at the line-up.
    """
    keys: dict[str, str] = {}  # how the user typed a key that a plugin knows by another name
    try:
        entries = {kind: _entries(kind, typed, line_up) for kind in KINDS}
        replaced = {word.key for word in typed}
        words = [word for word in line_up.words() if not _is_replaced(word, replaced, entries, line_up)]
        options = [(word, _option(word, entries, line_up)) for word in (*words, *typed) if word.key not in KINDS]
        unlabelled = {kind: Counter(one.name for one in entries[kind] if not one.label) for kind in KINDS}
        made: list[Job] = []
        for dataset, method in itertools.product(entries["dataset"], entries["method"]):
            keys.clear()
            made += _of_pair({"dataset": dataset, "method": method}, options, unlabelled, keys)
    except SucreBenchError as fault:
        place = keys.get(fault.place, fault.place)
        texts = {text for word in typed for text in (word.text, word.key, word.head)}
        values = (word.text.partition("=")[2] for word in typed if word.key in (*KINDS, "metrics", "views"))
        chosen = {name for value in values for name in re.findall(r"[^][,'\":]+", value)}
        is_typed = place in texts | chosen or place.partition("=")[0] in texts or re.split("[.:]", place)[0] in chosen
        # The names in a line-up were checked when it was read.
        is_name = isinstance(fault, UnknownPluginError) and (fault.kind != "metric" or "metrics" in texts)
        fault = InputError(fault.fault, place, fault.remedy)
        raise (fault if is_typed or is_name or not line_up.place else fault.within(line_up.place)) from None
    return made


def _of_pair(
    pair: Mapping[Kind, Entry],
    words: Sequence[tuple[Word, _Option | None]],
    unlabelled: Mapping[Kind, Counter[str]],
    keys: dict[str, str],
) -> Iterator[Job]:
    """The jobs of one dataset and one method: of every combination of the words' values.

    unlabelled: how many entries of a name have no label.
    """
    chosen: dict[str, Word] = {}
    swept: list[str] = []
    for kind, entry in pair.items():
        chosen |= {word.key: word for word in entry.words(kind)}
        # Without a label of its own, its label names the options that tell it from the others.
        if not entry.label and unlabelled[kind][entry.name] > 1:
            swept += [f"{kind}.{option}" for option in entry.options if option != "degrade"]
    for word, option in words:
        key = word.key
        if option:
            entry = pair[option.kind]
            if not option.is_for(entry):
                continue
            key = f"{option.kind}.{option.name}"
            plugin = plugin_of(option.kind, entry.name)
            keys |= {key: word.key} | ({f"{plugin.name}.{option.name}": word.key} if plugin else {})
        chosen.pop(key, None)  # the last word counts, in its place
        chosen[key] = word
        swept += [key] if word.is_swept else []
    has_references = any("${" in word.text for word in chosen.values())
    start = RunConfig.defaults()
    start |= {str(kind): configuration(kind, entry.name) for kind, entry in pair.items()}
    method = pair["method"]
    own_word = method.label if method.label.replace("-", "_").isidentifier() else method.name
    if not method.label and unlabelled["method"].total() == 1:
        own_word = "method"
    for given in itertools.product(*(word.values for word in chosen.values())):
        values = {key: dict(value) if isinstance(value, dict) else value for key, value in start.items()}
        settings = dict(zip(chosen, given, strict=True))
        metrics = settings.pop("metrics", [default_choice("metrics")])
        values["metrics"] = metrics_of(map(str, metrics if isinstance(metrics, list) else [metrics]))
        for key, value in settings.items():
            _put(values, key, value)
        job = Job.of(_filled(values, has_references), swept)
        yield replace(job, method=replace(job.method, word=own_word))


def _put(values: dict[str, Any], key: str, value: Any) -> None:
    """Set a value of a configuration. Raises InputError for an unknown key; types are checked later."""
    *groups, name = key.split(".")
    node = values
    for group in groups:
        if not isinstance(node.get(group), dict):
            raise unknown_name(key, group, node)
        node = node[group]
    if name not in node and groups not in (["dataset"], ["method"]):  # whose options were checked
        raise unknown_name(key, name, node)
    if isinstance(options := node.get(name), dict) and (key != "study" or value is not None):
        if not isinstance(value, dict):
            raise InputError("is a group of options", key, f"set one of them: {', '.join(options)}")
        value = {**options, **value}
    node[name] = value


def _filled(values: dict[str, Any], has_references: bool) -> dict[str, Any]:
    """A configuration with the run's seed where a plugin has none of its own, and with each ${...} resolved."""
    for part in (values["dataset"], values["method"], *values["metrics"].values()):
        if part.get("seed") == SEED:
            part["seed"] = values["seed"]
    uri = values["tracking"]["uri"]
    values["tracking"]["uri"] = uri.replace("${out}", str(values["out"])) if isinstance(uri, str) else uri
    if not has_references:
        return values
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        resolved = OmegaConf.to_container(OmegaConf.create(values), resolve=True)
    except OmegaConfBaseException as fault:
        raise InputError(first_line(fault), fault.full_key or "", "mend the ${...} in it") from fault
    assert isinstance(resolved, dict)
    return {str(key): value for key, value in resolved.items()}


def _entries(kind: Kind, typed: Sequence[Word], line_up: LineUp) -> tuple[Entry, ...]:
    """The datasets or methods: those of the last word that names some, of the line-up, or the default."""
    words = [word for word in typed if word.key == kind]
    if not words:
        return line_up.entries(kind) or (Entry(default_choice(kind)),)
    entries = []
    for name in words[-1].values:
        if isinstance(name, list) or name is None:
            raise InputError("one name at a time", f"{kind}={name}", f"-m {kind}=a,b runs several")
        name = str(name)
        plugin = plugin_of(kind, name)
        needs_root = any(o.name == "root" and o.default is MISSING for o in options_of(plugin.cls)) if plugin else False
        # A folder with the name of a dataset is meant where nothing else names the data.
        lacks_root = needs_root and not any(word.key.endswith(".root") for word in typed)
        if kind == "dataset" and (is_path(name) or (lacks_root and Path(name).is_dir())):
            entries.append(Entry(recognised(Path(name)), {"root": str(Path(name))}))
        else:
            named(kind, name)
            entries.append(Entry(name))
    return tuple(entries)


def _option(word: Word, entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> _Option | None:
    """The option that a word is, None for a word for the whole run. InputError for a word that is neither."""
    meant = _meant(word, entries)
    fitting = [option for option in meant if any(map(option.is_for, entries[option.kind]))]
    if len(fitting) > 1:
        either = " or ".join(f"{option.kind}.{option.name}=" for option in fitting)
        raise InputError(f"'{word.head}' is a dataset and a method here", word.text, f"write {either}")
    if fitting:
        return fitting[0]
    for option in meant:
        owners = [entry.name for entry in entries[option.kind] if option.owner in ("", entry.name, entry.label)]
        known = {name for owner in owners for name in option_names(option.kind, owner)}
        raise unknown_option(word.key, option.name, owners, known)
    if word.head not in _OF_RUN:
        raise unknown_word(word, entries, line_up)
    return None


def _meant(word: Word, entries: Mapping[Kind, Sequence[Entry]]) -> list[_Option]:
    """The options that a word may be: of all datasets or methods, or of those that its first part names."""
    head, dot, rest = word.key.partition(".")
    if dot and head in KINDS:
        return [_Option("dataset" if head == "dataset" else "method", "", rest)]
    named_so = {kind: any(head in (entry.name, entry.label) for entry in entries[kind]) for kind in KINDS}
    return [_Option(kind, head, rest) for kind in KINDS if dot and named_so[kind]]


def _is_replaced(word: Word, keys: set[str], entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> bool:
    """Whether typed words replace a line-up's word: its metrics, or the datasets or methods that have the option."""
    if word.head == "metrics":
        return "metrics" in keys
    meant = [option for option in _meant(word, {kind: line_up.entries(kind) for kind in KINDS}) if option.kind in keys]
    return bool(meant) and not any(map(meant[0].is_for, entries[meant[0].kind]))


def _refuse_same_place(planned: Sequence[Job]) -> None:
    """Raise InputError if two jobs would write to one place."""
    seen: dict[tuple[str, str, int, int, int], Job] = {}
    for job in planned:
        part = (job.replicate, job.shard.index, job.shard.count)
        other = seen.setdefault((as_one_file(job.dataset.label), as_one_file(job.method.label), *part), job)
        if other is not job:
            name = f"{job.dataset.label} / {job.method.label}"
            if (other.method, other.dataset) != (job.method, job.dataset):
                of = "method" if other.dataset == job.dataset else "dataset"
                raise InputError(f"two jobs of this sweep would both be '{name}'; tell them apart with {of}.label=...")
            raise InputError(f"two jobs of this sweep are the same, '{name}'; sweep over datasets, methods or options")


# -- mistakes in the words, with the words that were probably meant -----------------------------------------------


def is_bare(word: str) -> bool:
    """Whether a word has no key: neither key=value nor ~key."""
    return "=" not in word and not word.startswith("~")


def bare_word(word: str, words: Sequence[str]) -> InputError:
    """Return the fault of a word that has no key, with the command that was probably meant. words: of the command."""
    if "." in word and word.partition(".")[0] in (*KINDS, "metrics", "degrade", "study"):
        return InputError("has no value", word, f"an override reads key=value, write {word}=VALUE")
    names = {
        "dataset": [*plugins.discover("dataset")],
        "method": [*plugins.discover("method"), *(preset.name for preset in presets("method"))],
        "metrics": [*plugins.discover("metric")],
        "experiment": [preset.name for preset in presets("experiment")],
    }
    keyed: dict[str, list[str]] = {}
    for name in filter(is_bare, words):
        (near, *_) = difflib.get_close_matches(name, itertools.chain(*names.values()), n=1, cutoff=0.7) or [""]
        key = next((key for key, known in names.items() if near in known), "")
        if near != name and expanded(name).is_dir():
            key, near = "dataset", quoted(name if "/" in name else f"./{name}")
        keyed.setdefault(key, []).append(near)
    remedy = "`sucre-bench list methods` and `list datasets` show the names"
    if "" not in keyed:
        several = "-m " if any(len(names) > 1 for key, names in keyed.items() if key != "metrics") else ""
        meant = [f"{key}=[{','.join(n)}]" if key == "metrics" else f"{key}={','.join(n)}" for key, n in keyed.items()]
        remedy = f"write sucre-bench run {several}{shlex.join([*meant, *(w for w in words if not is_bare(w))])}"
    return InputError("an override reads key=value", word, remedy)


def _refuse(typed: Sequence[Word], line_up: LineUp, is_sweep: bool) -> None:
    """Raise InputError for several values where no sweep was asked for, for a path with a comma, and for a dataset's
    option where no dataset is named: the built-in one would take it.

    A line-up may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    plugin, has_dataset = plugin_of("dataset", default_choice("dataset")), any(word.key == "dataset" for word in typed)
    paths = {o.name for o in options_of(plugin.cls) if Path in (o.type, *get_args(o.type))} if plugin else set()
    for word in typed:
        key, value = word.key, word.text.partition("=")[2]
        quotes = f'"{key}={quoted(value)}"'
        if word.head == "dataset" and not has_dataset and (key.partition(".")[2] in paths or not line_up.place):
            remedy = f"add dataset=NAME, for example dataset=colmap {word.text}"
            raise InputError("no dataset is named", word.text, remedy)
        if word.is_swept and os.path.exists(value):  # noqa: PTH110 - pathlib's raises OSError for a long list of values
            raise InputError("is one path with a comma", word.text, f"write {quotes} with both kinds of quotes")
        if word.is_swept and key in ("metrics", "views") and not value.startswith("["):
            raise InputError("several values", word.text, f"write {key}=[{value}]")
        if word.is_swept and not is_sweep:
            raise InputError("several values", word.text, f"add -m to run them all, or write {quotes} for a comma")
        if key == "hydra/launcher" and not is_sweep:
            raise InputError("hands out the jobs of a sweep", word.text, "add -m")


_OF_RUN = frozenset(option.name for option in options_of(RunConfig))


def unknown_word(word: Word, chosen: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> InputError:
    """Return the fault of a word that is no option of the run, or of a chosen dataset or method.

    line_up: words may have replaced its datasets or methods.
    """
    text, key, head, dot = word.text, word.key, word.head, "." in word.key
    for kind, entries in chosen.items():
        names = ",".join(dict.fromkeys(entry.name for entry in entries))
        owners = dict.fromkeys(entry.name for entry in entries if key in option_names(kind, entry.name))
        if owners:
            before = [kind] if len(entries) == 1 else [*owners]
            return InputError(f"is an option of a {kind}", text, f"write {' or '.join(f'{b}.{text}' for b in before)}")
        if dot and plugin_of(kind, head):
            return InputError(f"'{head}' is not among the {kind}s", text, f"add it: -m {kind}={names},{head}")
        if dot and head in {entry.label for entry in line_up.entries(kind)}:
            remedy = f"leave out {kind}={names} or {key}"
            return InputError(f"'{head}' is not among the {kind}s of this run", text, remedy)
    if dot and plugin_of("metric", head):
        return InputError("is an option of a metric", text, f"write metrics.{text}")
    owned = {name for entries in chosen.values() for entry in entries for name in (entry.name, entry.label) if name}
    return unknown_name(key, head, {*_OF_RUN, *owned})
