"""Rules for every plugin."""

from collections.abc import Iterator
from dataclasses import MISSING

from sucre_bench import plugins
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import Plugin, fits
from sucre_bench.programs.contract.contract import Doubt, Note, Rule, Subject

_SLOW_IMPORT = 1.0  # seconds; `sucre-bench list` imports every plugin and must answer in about one


def rules(plugin: Plugin) -> list[Rule]:
    """Return the rules for a plugin, none of which runs it."""
    attributed = [] if plugin.kind == "metric" else [is_attributed]
    return [is_described, *attributed, is_configurable, is_installed, imports_lightly]


def is_described(subject: Subject) -> Iterator[str]:
    """Is described, with the meaning of each option."""
    plugin, name = subject.plugin, subject.plugin.cls.__name__
    if plugin.cls.__doc__ is None or plugin.summary.startswith(f"{name}("):  # what dataclass generates
        yield f"{name} has no docstring; its first paragraph is what `sucre-bench list` says"
    elif not plugin.summary.endswith("."):
        yield "the first paragraph of its docstring is no sentence; end it with a full stop"
    for option in options_of(plugin.cls):
        if not option.help:
            yield f"option '{option.name}' is not explained; write a string below the field"
    for variant, said in plugin.variants.items():
        if not said:
            yield f"variant '{variant}' is not explained; say in variants= what sets it apart"


def is_attributed(subject: Subject) -> Iterator[str]:
    """Names its publication and its licence."""
    plugin = subject.plugin
    if plugin.kind == "dataset" and not (plugin.source or plugin.licence):
        yield Doubt('neither source nor licence; tell where the data are from, @dataset(source="...", licence="...")')
    if plugin.kind == "method" and not (plugin.cites or plugin.licence):
        yield Doubt('neither cites nor licence; @method(cites="Author Year, title", licence="...") credits its authors')


def is_configurable(subject: Subject) -> Iterator[str]:
    """Has options that a command can set."""
    for option in options_of(subject.plugin.cls):
        if option.default is not MISSING and not fits(option.type, option.default):
            yield f"{option.name} is {option.default!r}, not {option.type}; correct the default, or the type"


def is_installed(subject: Subject) -> Iterator[str]:
    """Is installed with all that it requires."""
    if line := plugins.missing_packages(subject.plugin):
        yield f"packages are missing; {line}"


def imports_lightly(subject: Subject) -> Iterator[str]:
    """Is imported quickly, and changes nothing by that."""
    from sucre_bench.programs.contract.side_effects import in_fresh_process

    (there,) = in_fresh_process((subject,))
    for package in there.heavy:
        yield f"imports {package} at once; import it in the function that uses it, and add it to requires="
    for name in there.changed:
        yield f"its import changes {name}; leave that to whoever runs it"
    if there.seconds > _SLOW_IMPORT and not there.heavy:
        yield f"takes {there.seconds:.1f} s to import; move slow work into the functions that need it"
    yield Note(f"{there.seconds:.2f} s")
