"""A plugin with its options, as a configuration or Python names them."""

from collections.abc import Mapping, Sequence
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError
from sucre_bench.imaging.display import check_display
from sucre_bench.jobs.labels import swept_label
from sucre_bench.jobs.presets import plugin_of, preset_of
from sucre_bench.plugins.options import Choice, check_options, options_of, typed
from sucre_bench.plugins.plugin import Kind


def plugin_choice(kind: Kind, values: Any, swept: Sequence[str] = ()) -> Choice:
    """Return the plugin that `name` in the values is, with its label, display and checked options.

    swept: the keys that a sweep varies, see `Job.of`. Raises InputError for what the plugin does not take.
    """
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


def method_choice(name: str, options: Mapping[str, Any]) -> Choice:
    """Return a method or a preset of conf/ with options (label and display too), as Python takes them."""
    plugin = plugin_of("method", name) or plugins.find("method", name)  # which says why there is none
    preset = preset_of("method", name)
    values = preset.sets if preset else {}
    return plugin_choice("method", {"display": plugin.display, **values, **options, "name": plugin.name})
