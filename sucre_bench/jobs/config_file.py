"""`config.yaml` of a results folder: the jobs of the last command that wrote there."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import DamagedFileError, FileError, InputError, SucreBenchError, file_error
from sucre_bench.jobs.job import Job
from sucre_bench.machine.files import regular
from sucre_bench.machine.text_formats import read_yaml


def config_path(out: Path) -> Path:
    """The file in a results folder."""
    return out / "config.yaml"


def config_text(jobs: Sequence[Job], words: Sequence[str], is_sweep: bool) -> str:
    """Return the configuration as YAML; of a sweep what its jobs have in common, its words, what differs by job."""
    import yaml

    if not is_sweep:
        return jobs[0].config
    each = [dict(job.values) for job in jobs]
    shared = {key: value for key, value in each[0].items() if all(one[key] == value for one in each)}
    differing = [{key: value for key, value in one.items() if key not in shared} for one in each]
    return str(yaml.safe_dump({**shared, "sweep": list(words), "jobs": differing}, sort_keys=False))


def read_config(path: Path) -> Iterator[Job]:
    """Yield the jobs that a run wrote down. No plugin file that they name is loaded: whoever wrote the folder chose it.

    Raises InputError if the file cannot be read, or if a job needs a plugin that is not loaded.
    """
    content = _content(path)
    each, swept = content.pop("jobs", [{}]), content.pop("swept", ())
    for one in each:
        try:
            job = Job.of({**content, **one}, swept)  # labels of older folders follow from `swept`
        except SucreBenchError as fault:
            if files := _unloaded(content):
                raise InputError(fault.without_remedy, path, load_them(files)) from fault
            raise
        yield job


def unloaded_plugin_files(out: Path) -> tuple[str, ...]:
    """Return the plugin files that the configuration of a results folder names, and that are not loaded.

    Empty if it cannot be read.
    """
    try:
        return _unloaded(_content(config_path(out)))
    except FileError:
        return ()


def load_them(files: Sequence[str]) -> str:
    """Return the remedy where plugin files of a results folder are not loaded."""
    return f"add {shlex.join(word for file in files for word in ('--plugin', file))} if you trust that code"


def _unloaded(content: dict[str, Any]) -> tuple[str, ...]:
    files = content.get("plugins")
    return tuple(str(file) for file in files if not plugins.is_loaded(str(file))) if isinstance(files, list) else ()


def _content(path: Path) -> dict[str, Any]:
    import yaml

    try:
        content = read_yaml(regular(path).read_text(encoding="utf-8"))
        if not all(isinstance(one, dict) for one in (content, *content.get("jobs", ()))):
            raise ValueError("a job is no mapping")
        return {name: value for name, value in content.items() if name not in ("sweep", "sharing")}
    except FileError:
        raise
    except OSError as fault:
        raise file_error(path, fault, "repeat the run's command") from fault
    except (ValueError, AttributeError, TypeError, yaml.YAMLError) as fault:
        raise DamagedFileError("is no run's configuration", path, "repeat the run's command") from fault
