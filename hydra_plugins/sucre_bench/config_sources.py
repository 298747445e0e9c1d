"""Configs that Hydra finds without files: each plugin as a choice of a group, the options of a run, one file by path.

Hydra imports this module in each of its programs, so the package is imported where it is needed. Of the plugins, only
the chosen ones are imported.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigLoadError, ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

OURS = "pkg://sucre_bench.conf"
_GROUPS: dict[str, Any] = {"dataset": "dataset", "method": "method", "metrics": "metric"}


def _parts(config_path: str) -> tuple[str, str]:
    """The group of a config and its name, empty for what is no config in a group."""
    group, _, name = config_path.removesuffix(".yaml").partition("/")
    return group, name


class _Source(ConfigSource):
    """A source that can always be read."""

    def available(self) -> bool:
        """Return whether it can be read."""
        return True


class PluginSource(_Source):
    """`method/NAME`, `dataset/NAME` or a folder, `metrics/NAME` or `NAME:VARIANT`, and `run`, the options of a run."""

    def __getstate__(self) -> dict[str, Any]:
        """Return what a launcher's process needs: also the plugin files that were loaded here."""
        from sucre_bench import plugins

        return {**vars(self), "files": [*plugins.current().files]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Load the plugin files in a launcher's process, before it composes a job."""
        from sucre_bench import plugins

        for file in state.pop("files"):
            plugins.load_file(file)
        vars(self).update(state)

    @staticmethod
    def scheme() -> str:
        """Return the word before ://."""
        return "plugins"

    def is_group(self, config_path: str) -> bool:
        """Return whether a path is a group of configs."""
        return config_path.strip("/") in ("", *_GROUPS)

    def is_config(self, config_path: str) -> bool:
        """Return whether a path is a config."""
        from sucre_bench.jobs.catalogue import is_plugin

        group, name = _parts(config_path)
        return (group, name) == ("run", "") or (
            group in _GROUPS and name != "" and is_plugin(_GROUPS[group], name)
        )

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Return the names in a group, or the groups."""
        group = config_path.strip("/")
        if group not in _GROUPS:
            return [] if results_filter == ObjectType.CONFIG else [*_GROUPS]
        from sucre_bench import plugins

        kind: Any = _GROUPS[group]
        return [] if results_filter == ObjectType.GROUP else sorted(plugins.discover(kind))

    def load_config(self, config_path: str) -> ConfigResult:
        """Return the options of a plugin as its class has them."""
        from sucre_bench.jobs.catalogue import plugin_values
        from sucre_bench.jobs.run_options import RunConfig

        if not self.is_config(config_path):
            raise ConfigLoadError(f"no config {config_path}")
        group, name = _parts(config_path)
        if group == "run":
            values, package = RunConfig.defaults(), "_global_"
        else:
            values = plugin_values(_GROUPS[group], name)
            package = f"metrics.{values['name']}" if group == "metrics" else group
        config = OmegaConf.create(values)
        return ConfigResult(
            self.provider, f"plugins://{config_path}", config, {"package": package}
        )


class PluginSearchPath(SearchPathPlugin):
    """Puts the plugins behind the files of `sucre_bench.conf`, and behind those of nobody else."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Add the plugins, if this is a search path of ours."""
        if any(element.path == OURS for element in search_path.get_path()):
            search_path.append("sucre_bench", "plugins://")


class ExperimentFile(_Source):
    """One file as the config `experiment/file`, wherever it lies; its keys are those of a run."""

    @staticmethod
    def scheme() -> str:
        """Return the word before ://."""
        return "experiment"

    def is_group(self, config_path: str) -> bool:
        """Return whether a path is a group of configs."""
        return config_path.strip("/") == "experiment"

    def is_config(self, config_path: str) -> bool:
        """Return whether a path is the file's config."""
        return config_path.removesuffix(".yaml") == "experiment/file"

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Return the names in a group."""
        return ["file"] if self.is_group(config_path) else []

    def load_config(self, config_path: str) -> ConfigResult:
        """Return the file's config; `@package _global_` may be left out."""
        from sucre_bench.errors import InputError
        from sucre_bench.machine.files import reading, regular
        from sucre_bench.machine.text_formats import read_yaml

        path = Path(self.path)
        with reading(path, "save it as YAML in UTF-8"):
            text = regular(path).read_text(encoding="utf-8-sig")
        # without aliases, which may stand for more than fits into memory
        content = read_yaml(text)
        if not isinstance(content, dict):
            raise InputError(
                "holds no keys",
                "",
                "write an experiment, `sucre-bench list experiments` shows some",
            )
        header = self._get_header_dict(text)
        header["package"] = header["package"] or "_global_"
        return ConfigResult(self.provider, f"file://{path}", OmegaConf.create(content), header)
