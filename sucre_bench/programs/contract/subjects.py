"""The plugins that a command names, by name or file, with their options."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError
from sucre_bench.plugins.plugin import KINDS, Kind, Plugin
from sucre_bench.programs.contract.contract import Subject


def subjects(name: str, overrides: Sequence[str] = (), kind: Kind | None = None, on: str = "") -> list[Subject]:
    """Return the plugin of a name, or those of a .py file, with options as `sucre-bench run` takes them.

    kind: None for any; on: the dataset for trying a method. Raises InputError for an unknown or ambiguous name or an
    unknown option, PluginError if the plugin or its file is broken.
    """
    if on:
        plugins.find("dataset", on)
    found = _of_file(Path(name)) if name.endswith(".py") else [_named(name, kind)]
    found = [plugin for plugin in found if kind in (None, plugin.kind)]
    if not found:
        raise InputError(f"{name}: holds no {kind}; leave --kind out to check what is there")
    if overrides and len(found) > 1:
        raise InputError(f"{name}: holds {len(found)} plugins; leave the options out, or keep one plugin in a file")
    return [Subject(plugin, _options(plugin, overrides), on) for plugin in found]


def _named(name: str, kind: Kind | None) -> Plugin:
    kinds = [kind] if kind else [k for k in KINDS if name in plugins.discover(k)]
    if not kinds:
        known = {other for k in KINDS for other in plugins.discover(k)}
        raise plugins.unknown("plugin", name, known, give="")
    if len(kinds) > 1:
        raise InputError(f"{name}: is a {' and a '.join(kinds)}; say which with --kind {kinds[0]}")
    return plugins.find(kinds[0], name)


def _of_file(path: Path) -> list[Plugin]:
    """The plugins of a file, in its order. Raises PluginError for an unusable one."""
    return [plugins.find(one.kind, one.name) for one in plugins.current().load_file(path)]


def _options(plugin: Plugin, overrides: Sequence[str]) -> Mapping[str, Any]:
    from sucre_bench.jobs import compose_jobs

    if not overrides:
        return {}
    chosen = f"metrics=[{plugin.name}]" if plugin.kind == "metric" else f"{plugin.kind}={plugin.name}"
    job = compose_jobs.jobs([chosen, *overrides], multirun=False).jobs[0]
    choices = {"method": job.method, "dataset": job.dataset, "metric": job.metrics[0].choice}
    return choices[plugin.kind].options
