"""The contract of plugins: rules, each of which examines a plugin and yields findings.

A finding is a breach (must be fixed), a doubt (may be intended) or a note (a figure). Its text is "fault; remedy".
Exceptions and RuntimeWarnings of a plugin are breaches of the rule that ran it.
"""

import contextlib
import importlib
import inspect
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Any, Literal

from sucre_bench import plugins
from sucre_bench.errors import ANY_FAULT, NotApplicableError, SucreBenchError, one_line
from sucre_bench.plugins.options import create, options_of
from sucre_bench.plugins.plugin import KINDS, Kind, Plugin

Level = Literal["breach", "doubt", "note"]
Status = Literal["kept", "broken", "doubtful", "skipped"]


@dataclass(frozen=True)
class Finding:
    """A finding of a rule. text: one line, "fault; remedy", or a figure for a note."""

    level: Level
    text: str


def breach(text: str) -> Finding:
    """Return a finding that must be fixed."""
    return Finding("breach", text)


def doubt(text: str) -> Finding:
    """Return a finding that may be intended."""
    return Finding("doubt", text)


def note(text: str) -> Finding:
    """Return a figure to show with a rule that is kept."""
    return Finding("note", text)


@dataclass(frozen=True, eq=False)
class Subject:
    """A plugin to check.

    options: of the plugin; on: the dataset for trying a method, empty for none; kept: results of one rule that others
    use.
    """

    plugin: Plugin
    options: Mapping[str, Any] = field(default_factory=dict)
    on: str = ""
    kept: dict[str, Any] = field(default_factory=dict)

    @property
    def file(self) -> Path:
        """The file of its class."""
        return Path(inspect.getsourcefile(self.plugin.cls) or "")

    @property
    def obstacle(self) -> str:
        """Why it cannot be run, with the remedy; empty if it can."""
        if line := plugins.missing_packages(self.plugin):
            return f"not installed; {line}"
        needed = [o.name for o in options_of(self.plugin.cls) if o.default is MISSING]
        absent = [f"{self.plugin.kind}.{name}=..." for name in needed if name not in self.options]
        return f"options must be given; add {' '.join(absent)}" if absent else ""

    def make(self) -> Any:
        """Make the plugin, after importing its packages: settings that these change are not its fault."""
        for package in self.plugin.requires:
            importlib.import_module(package)
        return create(self.plugin, self.options)


Look = Callable[[Subject], Iterable[Finding]]


@dataclass(frozen=True)
class Rule:
    """A rule of the contract.

    says: text that follows the plugin's name; look: yields findings; kinds: of plugins; applies: to which of these;
    runs: whether it runs the plugin, which needs all options; lasting: whether it starts processes or uses a whole
    dataset.
    """

    says: str
    look: Look
    kinds: tuple[Kind, ...]
    applies: Callable[[Plugin], bool]
    runs: bool
    lasting: bool

    @property
    def name(self) -> str:
        """Its name in JSON and tests: that of its function."""
        return str(getattr(self.look, "__name__", ""))

    def __str__(self) -> str:
        return self.says


_RULES: list[Rule] = []


def rule(
    says: str,
    *kinds: Kind,
    applies: Callable[[Plugin], bool] = lambda _: True,
    runs: bool = True,
    lasting: bool = False,
) -> Callable[[Look], Look]:
    """Make a function a rule of the contract, by default for all kinds of plugins."""

    def add(look: Look) -> Look:
        _RULES.append(Rule(says, look, kinds or KINDS, applies, runs, lasting))
        return look

    return add


def rules(plugin: Plugin, lasting: bool = True) -> list[Rule]:
    """Return the rules for a plugin. lasting: include those that take seconds."""
    for module in ("rules_every_plugin", "rules_methods", "rules_datasets", "rules_metrics"):
        importlib.import_module(f"sucre_bench.programs.contract.{module}")
    of_plugin = [one for one in _RULES if plugin.kind in one.kinds and one.applies(plugin)]
    return [one for one in of_plugin if lasting or not one.lasting]


@dataclass(frozen=True)
class Outcome:
    """The outcome of a rule. skipped: why it could not be checked; seconds: duration."""

    rule: Rule
    findings: tuple[Finding, ...]
    seconds: float
    skipped: str = ""

    @property
    def status(self) -> Status:
        levels = {finding.level for finding in self.findings}
        if "breach" in levels:
            return "broken"
        return "skipped" if self.skipped else "doubtful" if "doubt" in levels else "kept"


def check(subject: Subject, chosen: Sequence[Rule] | None = None) -> Iterator[Outcome]:
    """Check a plugin against each rule in turn, by default all for it; no exception ends the check."""
    obstacle = subject.obstacle
    for one in rules(subject.plugin) if chosen is None else chosen:
        if one.runs and obstacle:
            yield Outcome(one, (), 0.0, obstacle)
            continue
        started, findings, skipped = time.perf_counter(), [], ""
        with warnings.catch_warnings(record=True) as heard, contextlib.redirect_stdout(sys.stderr):
            warnings.simplefilter("always")
            try:
                for finding in one.look(subject):
                    findings.append(finding)  # findings before an exception count
            except NotApplicableError as reason:
                skipped = one_line(reason)
            except ANY_FAULT as fault:
                findings.append(breach(raised(subject, fault)))
        findings += _warned(subject, heard)
        yield Outcome(one, tuple(dict.fromkeys(findings)), time.perf_counter() - started, skipped)


def breaches(kind: Kind, name: str, **options: Any) -> list[str]:
    """Check a plugin against the contract, for its own test. Return one line for each breach.

    - kind: "method", "dataset" or "metric";
    - name: the plugin's name;
    - options: its options.

    Slow rules are left out. A rule that cannot be checked, because an option or a package is missing, counts as broken.
    Raises InputError for an unknown name, and PluginError if the plugin cannot be imported.

    >>> breaches("method", "gray_world")
    []
    """
    subject = Subject(plugins.find(kind, name), options)
    outcomes = list(check(subject, rules(subject.plugin, lasting=False)))
    found = [f"{one.rule}: {f.text}" for one in outcomes for f in one.findings if f.level == "breach"]
    return found + [f"{one.rule}: not looked at, {one.skipped}" for one in outcomes if one.skipped]


def raised(subject: Subject, fault: BaseException) -> str:
    """Return an exception as a breach's text, with the last line of the plugin's code in its traceback."""
    said = one_line(fault)
    if isinstance(fault, SucreBenchError) and "; " in said:
        return said
    frames = [frame for frame in traceback.extract_tb(fault.__traceback__) if _is_own(subject, frame.filename)]
    where = f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    if "read-only" in said:
        return f"writes into its input{where}; work on a copy, image = view.rgb.copy()"
    return f"raises {said}{where}; mend it, or raise SolveError or NotApplicableError with a reason"


def _warned(subject: Subject, heard: Iterable[warnings.WarningMessage]) -> Iterator[Finding]:
    for one in heard:
        where = f"{Path(one.filename).name}:{one.lineno}"
        said = f"{one.category.__name__} at {where}: {' '.join(str(one.message).split())}"
        if issubclass(one.category, RuntimeWarning):
            yield breach(f"{said}; guard it, or say what cannot be done with SolveError")
        elif _is_own(subject, one.filename):
            yield doubt(f"{said}; follow its advice")


def _is_own(subject: Subject, filename: str) -> bool:
    """Whether a file belongs to the plugin or lies in its folder."""
    file, module = Path(filename).resolve(), subject.file.resolve()
    return file == module or ((module.parent / "__init__.py").exists() and module.parent in file.parents)
