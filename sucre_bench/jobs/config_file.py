"""`config.yaml` of a results folder: the jobs of the last command that wrote there."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import DamagedFileError, FileError, file_error
from sucre_bench.jobs.job import Job
from sucre_bench.machine.files import regular


def config_path(out: Path) -> Path:
    """The file in a results folder."""
    return out / "config.yaml"


def config_text(jobs: Sequence[Job], words: Sequence[str], is_sweep: bool) -> str:
    """Return the configuration as YAML; of a sweep what its jobs have in common, its words, what differs by job."""
    import yaml

    if not is_sweep:
        return jobs[0].config
    each: list[dict[str, Any]] = [yaml.safe_load(job.config) for job in jobs]
    shared = {key: value for key, value in each[0].items() if all(one[key] == value for one in each)}
    differing = [{key: value for key, value in one.items() if key not in shared} for one in each]
    return str(yaml.safe_dump({**shared, "sweep": list(words), "jobs": differing}, sort_keys=False))


def read_config(path: Path) -> Iterator[Job]:
    """Yield the jobs that a run wrote down. Raises InputError when the file cannot be read."""
    import yaml

    try:
        told: dict[str, Any] = yaml.safe_load(regular(path).read_text(encoding="utf-8"))
        each, swept = told.pop("jobs", [{}]), told.pop("swept", ())
        for name in ("sweep", "sharing"):
            told.pop(name, None)
    except FileError:
        raise
    except OSError as fault:
        raise file_error(path, fault, "repeat the run's command") from fault
    except (ValueError, AttributeError, RecursionError, yaml.YAMLError) as fault:
        raise DamagedFileError("is no run's configuration", path, "repeat the run's command") from fault
    for file in told.get("plugins") or ():
        plugins.load_file(file)
    for one in each:
        yield Job.of({**told, **one}, swept)  # labels of older folders follow from `swept`
