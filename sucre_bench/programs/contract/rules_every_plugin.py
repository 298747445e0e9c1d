"""Rules for every plugin."""

import functools
from collections.abc import Iterator
from typing import Any

from sucre_bench import plugins
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import Broken, Plugin
from sucre_bench.programs.contract.contract import Finding, Rule, Subject, breach, doubt, note

_SLOW_IMPORT = 1.0  # seconds; `sucre-bench list` imports every plugin and must answer in about one


def rules(plugin: Plugin) -> list[Rule]:
    """Return the rules for a plugin, none of which runs it."""
    attributed = [] if plugin.kind == "metric" else [is_attributed]
    return [is_described, *attributed, is_configurable, is_installed, imports_lightly]


def is_described(subject: Subject) -> Iterator[Finding]:
    """Is described, with the meaning of each option."""
    plugin = subject.plugin
    if plugin.cls.__doc__ is None or plugin.summary.startswith(
        f"{plugin.cls.__name__}("
    ):  # the docstring that dataclass generates
        yield breach(f"{plugin.cls.__name__} has no docstring; its first paragraph is what `sucre-bench list` says")
    elif not plugin.summary.endswith("."):
        yield breach("the first paragraph of its docstring is no sentence; end it with a full stop")
    for option in options_of(plugin.cls):
        if not option.help:
            yield breach(f"option '{option.name}' is not explained; write a string below the field")
    for variant, said in plugin.variants.items():
        if not said:
            yield breach(f"variant '{variant}' is not explained; say in variants= what sets it apart")


def is_attributed(subject: Subject) -> Iterator[Finding]:
    """Names its publication and its licence."""
    plugin = subject.plugin
    if plugin.kind == "dataset" and not (plugin.source or plugin.licence):
        yield doubt('neither source nor licence; tell where the data are from, @dataset(source="...", licence="...")')
    if plugin.kind == "method" and not (plugin.cites or plugin.licence):
        yield doubt('neither cites nor licence; @method(cites="Author Year, title", licence="...") credits its authors')


def is_configurable(subject: Subject) -> Iterator[Finding]:
    """Has options that a command can set."""
    kind, name = subject.plugin.kind, subject.plugin.name
    known = [one for k in plugins.KINDS for one in plugins.discover(k).values()]
    refused = _refused(tuple(one.cls for one in known if isinstance(one, Plugin)))
    now = plugins.discover(kind).get(name)
    if reason := now.reason if isinstance(now, Broken) else refused.get(subject.plugin.cls):
        yield breach(f"{reason}; correct the default, or the type")


@functools.lru_cache(maxsize=1)  # of all plugins at once, .1 s
def _refused(known: tuple[type[Any], ...]) -> dict[type[Any], str]:
    """Why Hydra cannot represent a plugin's options; such plugins are set aside."""
    from sucre_bench.jobs.hydra_schema import register

    register()
    refused = {}
    for cls in known:
        now = plugins.discover(cls.__plugin__.kind).get(cls.__plugin__.name)
        if isinstance(now, Broken):
            refused[cls] = now.reason
    return refused


def is_installed(subject: Subject) -> Iterator[Finding]:
    """Is installed with all that it requires."""
    if line := plugins.missing_packages(subject.plugin):
        yield breach(f"packages are missing; {line}")


def imports_lightly(subject: Subject) -> Iterator[Finding]:
    """Is imported quickly, and changes nothing by that."""
    from sucre_bench.programs.contract.fresh_process import imported

    (done,) = imported([subject])
    for package in done.heavy:
        yield breach(f"imports {package} at once; import it in the function that uses it, and add it to requires=")
    for name in done.changed:
        yield breach(f"its import changes {name}; leave that to whoever runs it")
    if done.seconds > _SLOW_IMPORT and not done.heavy:
        yield breach(f"takes {done.seconds:.1f} s to import; move slow work into the functions that need it")
    yield note(f"{done.seconds:.2f} s")
