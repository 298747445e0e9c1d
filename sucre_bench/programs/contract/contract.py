"""Checks a plugin against the contract: plain functions, the rules, each of which yields lines.

A line is a breach (must be fixed) or a `Doubt` (may be intended). Both are
"fault; remedy". Exceptions and RuntimeWarnings of a plugin are breaches of the rule that ran it. The first line of a
rule's docstring is what the plugin does if it keeps the rule.
"""

import contextlib
import importlib
import inspect
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

from sucre_bench import plugins
from sucre_bench.arguments import checked, fits
from sucre_bench.errors import (
    ANY_FAULT,
    InputError,
    NotApplicableError,
    PluginError,
    SucreBenchError,
    one_line,
)
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import create, options_of
from sucre_bench.plugins.plugin import KINDS, Kind, Plugin

# seconds; `sucre-bench list` imports every plugin and must answer in about one
_SLOW_IMPORT = 1.0

# Packages that take long to import; they belong inside the functions that use them.
_HEAVY = {
    "torch",
    "torchvision",
    "tensorflow",
    "jax",
    "onnx",
    "onnxruntime",
    "numba",
    "kornia",
    "sklearn",
    "scipy",
    "skimage",
    "cv2",
    "colour",
    "open3d",
    "pycolmap",
    "pandas",
    "matplotlib",
    "mlflow",
    "hydra",
    "psutil",
}
# Imports a plugin, and prints the seconds of the processor and the packages that were new.
_IMPORT = """
import sys, time, importlib
from sucre_bench import plugins
known, started = set(sys.modules), time.process_time()
name = sys.argv[1]
plugins.load_file(name) if name.endswith(".py") else importlib.import_module(name)
print(time.process_time() - started, *{new.partition(".")[0] for new in set(sys.modules) - known})
"""

Level = Literal["breach", "doubt"]
Status = Literal["kept", "broken", "doubtful", "skipped"]


class Doubt(str):
    """What a rule yields that may be intended."""


class Finding(NamedTuple):
    """A finding of a rule."""

    level: Level

    text: str
    """One line, "fault; remedy"."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A plugin to check."""

    plugin: Plugin

    options: Mapping[str, Any] = field(default_factory=dict)
    """Of the plugin."""

    @property
    def file(self) -> Path:
        """The file of its class."""
        return Path(inspect.getsourcefile(self.plugin.cls) or "").resolve()

    @property
    def obstacle(self) -> str:
        """Why it cannot be run, with the remedy; empty if it can."""
        if lacking := absent(*self.plugin.requires):
            return str(lacking)
        needed = [o.name for o in options_of(self.plugin.cls) if o.is_required]
        missing = [
            f"{self.plugin.kind}.{name}=..." for name in needed if name not in self.options
        ]
        return f"options must be given; add {' '.join(missing)}" if missing else ""

    def make(self) -> Any:
        """Make the plugin, after importing its packages: settings that these change are not its fault."""
        for package in self.plugin.requires:
            importlib.import_module(package)
        return create(self.plugin, self.options)

    def owns(self, filename: str) -> bool:
        """Whether a file belongs to the plugin or lies in its folder."""
        file = Path(filename).resolve()
        folder = self.file.parent
        return file == self.file or (
            (folder / "__init__.py").exists() and folder in file.parents
        )


Lines = Iterator[str]
Rule = Callable[[Subject], Lines]


class Outcome(NamedTuple):
    """The outcome of a rule."""

    name: str
    """Of the rule's function."""

    rule: str
    """What it says."""

    findings: tuple[Finding, ...]
    seconds: float = 0.0

    skipped: str = ""
    """Why it could not be checked; empty if it was."""

    @property
    def status(self) -> Status:
        """What its line begins with as a sign."""
        levels = {level for level, _ in self.findings}
        if "breach" in levels:
            return "broken"
        if self.skipped:
            return "skipped"
        return "doubtful" if "doubt" in levels else "kept"


def subjects(
    name: str, overrides: Sequence[str] = (), kind: Kind | None = None
) -> list[Subject]:
    """Return the plugin of a name, or those of a .py file, with options as `sucre-bench run` takes them.

    kind: None for any. Raises InputError for an unknown or ambiguous name or an unknown option, PluginError if the
    plugin or its file is broken.
    """
    if name.endswith(".py"):
        loaded = plugins.load_file(Path(name))
        found = [plugins.find(one.kind, one.name) for one in loaded if kind in (None, one.kind)]
        if not found:
            raise InputError(
                f"{name}: holds no {kind}; leave --kind out to check what is there"
            )
        if overrides and len(found) > 1:
            raise InputError(
                f"{name}: holds {len(found)} plugins; leave the options out, or keep one plugin in a file"
            )
    else:
        kinds = [kind] if kind else [k for k in KINDS if name in plugins.discover(k)]
        if not kinds:
            raise plugins.unknown(
                "plugin", name, {other for k in KINDS for other in plugins.discover(k)}, give=""
            )
        if len(kinds) > 1:
            raise InputError(
                f"{name}: is a {' and a '.join(kinds)}; say which with --kind {kinds[0]}"
            )
        found = [plugins.find(kinds[0], name)]
    if not overrides:
        return [Subject(plugin) for plugin in found]
    from sucre_bench.jobs import compose_jobs

    (plugin,) = found
    chosen = (
        f"metrics=[{plugin.name}]"
        if plugin.kind == "metric"
        else f"{plugin.kind}={plugin.name}"
    )
    job = compose_jobs.jobs([chosen, *overrides], multirun=False).jobs[0]
    choices = {"method": job.method, "dataset": job.dataset, "metric": job.metrics[0]}
    return [Subject(plugin, choices[plugin.kind].options)]


def check(subject: Subject, lasting: bool = True) -> Iterator[Outcome]:
    """Check a plugin against each rule in turn; no exception ends the check.

    lasting: include the rule that starts a process, which takes seconds.
    """
    from sucre_bench.programs.contract import rules_datasets, rules_methods, rules_metrics

    of_kind = {"method": rules_methods, "dataset": rules_datasets, "metric": rules_metrics}
    of_all: list[Rule] = [is_described, is_installed, imports_lightly]
    at_rest = (*of_all, rules_datasets.names_what_is_missing)
    obstacle = subject.obstacle
    for rule in (*of_all, *of_kind[subject.plugin.kind].rules(subject.plugin)):
        if rule is imports_lightly and not lasting:
            continue
        outcome = check_rule(subject, rule, "" if rule in at_rest else obstacle)
        # a method that restores no view breaks every rule for the same cause
        restores_none = rule is rules_methods.restores_a_view and outcome.status == "broken"
        if restores_none or (outcome.skipped and outcome.skipped == obstacle):
            obstacle = "for the reason above"
        yield outcome


def check_rule(subject: Subject, rule: Rule, obstacle: str = "") -> Outcome:
    """Check a plugin against one rule. obstacle: why the rule cannot be checked, if it cannot."""
    name = getattr(rule, "__name__", "")
    says = (inspect.getdoc(rule) or "").partition("\n")[0]
    says = says[:1].lower() + says[1:].removesuffix(".")
    if obstacle:
        return Outcome(name, says, (), skipped=obstacle)
    started = time.perf_counter()
    said = list[str]()
    skipped = ""
    with warnings.catch_warnings(), contextlib.redirect_stdout(sys.stderr):
        # of a division by zero, for example
        warnings.simplefilter("error", RuntimeWarning)
        try:
            said.extend(rule(subject))  # also what comes before an exception
        except NotApplicableError as reason:
            skipped = one_line(reason)
        except ANY_FAULT as fault:
            said.append(raised(subject, fault))
    findings = tuple(
        Finding("doubt" if isinstance(text, Doubt) else "breach", str(text))
        for text in dict.fromkeys(said)
    )
    return Outcome(name, says, findings, time.perf_counter() - started, skipped)


@checked
def breaches(kind: Kind, name: str, **options: Any) -> list[str]:
    """Check a plugin against the contract, for its own test. Return one line for each breach.

    - kind: "method", "dataset" or "metric";
    - name: the plugin's name;
    - options: its options.

    The rule that starts a process is left out. A rule that cannot be checked, because an option or a package is
    missing, counts as broken.
    Raises InputError for an unknown name, and PluginError if the plugin cannot be imported.

    >>> breaches("method", "gray_world")
    []
    """
    outcomes = list(check(Subject(plugins.find(kind, name), options), lasting=False))
    found = [
        f"{one.rule}: {text}"
        for one in outcomes
        for level, text in one.findings
        if level == "breach"
    ]
    return found + [
        f"{one.rule}: not looked at, {one.skipped}" for one in outcomes if one.skipped
    ]


def raised(subject: Subject, fault: BaseException) -> str:
    """Return an exception as a breach, with the last line of the plugin's code in its traceback."""
    said = one_line(fault)
    if isinstance(fault, SucreBenchError) and "; " in said:
        return said
    frames = [
        frame
        for frame in traceback.extract_tb(fault.__traceback__)
        if subject.owns(frame.filename)
    ]
    where = f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    if "read-only" in said:
        return f"writes into its input{where}; work on a copy, image = view.rgb.copy()"
    return f"raises {said}{where}; mend it, or raise SolveError or NotApplicableError with a reason"


# -- rules for every plugin, none of which runs it -------------------------------------------------------------------


def is_described(subject: Subject) -> Lines:
    """Is described, with the meaning of each option; a default has its option's type."""
    plugin, name = subject.plugin, subject.plugin.cls.__name__
    if plugin.cls.__doc__ is None or plugin.summary.startswith(f"{name}("):
        # what dataclass generates
        yield f"{name} has no docstring; its first paragraph is what `sucre-bench list` says"
    elif not plugin.summary.endswith("."):
        yield "the first paragraph of its docstring is no sentence; end it with a full stop"
    for option in options_of(plugin.cls):
        if not option.help:
            yield f"option '{option.name}' is not explained; write a string below the field"
        if option.default is not MISSING and not fits(option.default, option.type):
            yield f"{option.name} is {option.default!r}, not {option.type}; correct the default, or the type"
    for variant, said in plugin.variants.items():
        if not said:
            yield f"variant '{variant}' is not explained; say in variants= what sets it apart"


def is_installed(subject: Subject) -> Lines:
    """Is installed with all that it requires."""
    if lacking := absent(*subject.plugin.requires):
        yield str(lacking)


def imports_lightly(subject: Subject) -> Lines:
    """Is imported quickly, also in another process."""
    module = subject.plugin.cls.__module__
    # A module in no package is imported from the file that was loaded.
    if module.startswith("sucre_bench_plugin_"):
        module = str(sys.modules[module.partition(".")[0]].__file__)
    done = subprocess.run(
        [sys.executable, "-P", "-c", _IMPORT, module],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise PluginError(
            f"a fresh process fails: {last}; it must import wherever `sucre-bench` runs"
        )
    seconds_text, *imported = done.stdout.splitlines()[-1].split()
    heavy = sorted(_HEAVY & set(imported))
    seconds = float(seconds_text)
    for package in heavy:
        yield f"imports {package} at once; import it in the function that uses it, and add it to requires="
    if seconds > _SLOW_IMPORT and not heavy:
        yield f"takes {seconds:.1f} s to import; move slow work into the functions that need it"
