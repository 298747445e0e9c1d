"""A job: one dataset, one method and metrics, each with its options; and `config.yaml`, which stores jobs."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import (
    FileError,
    InputError,
    SucreBenchError,
    unknown_name,
)
from sucre_bench.jobs.catalogue import chosen_metrics
from sucre_bench.jobs.run_options import RunConfig, Shard
from sucre_bench.machine.files import expanded, reading, regular
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import Choice, plain_value, plugin_choice, seed_of


@dataclass(frozen=True, kw_only=True)
class Job(RunConfig):
    """The keys of a run for one dataset, one method and some metrics: what one job does."""

    dataset: Choice
    method: Choice
    metrics: tuple[Choice, ...]
    views: tuple[str, ...] | None

    values: Mapping[str, Any]
    """The whole configuration as plain data."""

    shared_pairs: str = ""
    """The folder where the jobs of its command share pairs; empty if they share none."""

    @property
    def drawn(self) -> Degradation:
        """The degradation with the draws of this replicate."""
        return replace(self.degrade, seed=seed_of(self.degrade.seed, "degrade", self.replicate))

    def of_all_views(self) -> Job:
        """Return the job with all views of its dataset instead of those that the command chose."""
        return replace(self, views=None, every=1, first=None, shard=Shard())

    @classmethod
    def of(
        cls,
        values: Mapping[str, Any],
        swept: Sequence[str] = (),
    ) -> Job:
        """Read a configuration. swept: the keys that a sweep varies; labels name their values.

        Raises InputError for an option that is unknown, and for a value that is not acceptable.
        """
        run = RunConfig.of(values)
        plain = dict(values)
        chosen = dict[str, Choice]()
        given: dict[plugins.Kind, Any] = {"dataset": run.dataset, "method": run.method}
        for kind, options in given.items():
            choice = _labelled(plugin_choice(kind, options), swept)
            # a method may say how rows are to record its options
            pinned = getattr(choice.plugin.cls, "pinned", None) if kind == "method" else None
            if pinned:
                choice = replace(choice, options=pinned(choice.options))
            # A label that says no more than the name stays open: `read` knows no sweep.
            label = None if choice.label == choice.plugin.name else choice.label
            plain[kind] = {**values[kind], "label": label, **choice.record}
            chosen[kind] = replace(choice, replicate=run.replicate)
        dataset = chosen["dataset"]
        metrics = chosen_metrics(run.metrics)
        plain["metrics"] = {
            one.plugin.name: {**one.record, "variants": one.variants} for one in metrics
        }
        made: dict[str, Any] = {
            "dataset": replace(dataset, label=run.degrade.labelled(dataset.label)),
            "method": chosen["method"],
            "metrics": metrics,
            "views": _view_names(run.views),
            "values": plain_value(plain),
        }
        if run.study:
            baseline = run.study.baseline or run.baseline
            made["study"] = replace(run.study, baseline=baseline)
        return cls(**{**vars(run), **made})


def _labelled(choice: Choice, swept: Sequence[str]) -> Choice:
    """A choice whose label has the swept options: "sucre,light=even". A path counts by its last part.

    A label with {OPTION} in it has that value there instead: "gain {strength}". InputError for an unknown option.
    """
    options = {**choice.options, "display": choice.display}
    kind = choice.plugin.kind
    texts = {
        name: str(v.name if isinstance(v, Path) else plain_value(v))
        for name, v in options.items()
    }
    named = set(re.findall(r"\{(\w+)\}", choice.label))
    if unknown := named - texts.keys():
        raise unknown_name(f"{kind}.label", min(unknown), texts, "option")
    parts = [re.sub(r"\{(\w+)\}", lambda found: texts[found[1]], choice.label)]
    for name, text in texts.items():
        if name not in named and (
            f"{kind}.{name}" in swept or (name == "seed" and "seed" in swept)
        ):
            parts.append(f"{name}={text}".replace(" ", ""))
    return replace(choice, label=",".join(parts))


def _view_names(given: Any) -> tuple[str, ...] | None:
    """A list of names, one name, or the path of a text file with one name a line."""
    if given is None:
        return None
    names = [str(n) for n in given] if isinstance(given, list) else [str(given)]
    if len(names) == 1 and names[0].endswith(".txt"):
        path = expanded(names[0])
        with reading(path, "save it as UTF-8 text"):
            text = regular(path, "give a list of views: text, a name a line").read_text(
                encoding="utf-8-sig"
            )
        names = [line.strip() for line in text.splitlines() if line.strip()]
    if not names:
        raise InputError(
            "an empty list", "views", "name some views, or leave views= out for all of them"
        )
    return tuple(names)


# -- config.yaml of a results folder: the jobs of the last command that wrote there -------------------------


CONFIG = "config.yaml"


def config_text(jobs: Sequence[Job], words: Sequence[str], is_sweep: bool) -> str:
    """Return the configuration as YAML; of a sweep what its jobs have in common, its words, what differs by job."""
    import yaml

    if not is_sweep:
        return str(yaml.safe_dump(jobs[0].values, sort_keys=False, allow_unicode=True))
    each = [job.values for job in jobs]
    shared = {
        key: value for key, value in each[0].items() if all(one[key] == value for one in each)
    }
    differing = [
        {key: value for key, value in one.items() if key not in shared} for one in each
    ]
    return str(
        yaml.safe_dump({**shared, "sweep": list(words), "jobs": differing}, sort_keys=False)
    )


def read_config(path: Path) -> Iterator[Job]:
    """Yield the jobs that a run wrote down. No plugin file that they name is loaded: whoever wrote the folder chose it.

    Raises InputError if the file cannot be read, or if a job needs a plugin that is not loaded.
    """
    content = _content(path)
    for one in content.pop("jobs", [{}]):
        try:
            job = Job.of({**content, **one})
        except SucreBenchError as fault:
            if remedy := load_them(_plugin_files(content)):
                raise InputError(fault.without_remedy, path, remedy) from fault
            raise
        yield job


def plugin_files(out: Path) -> tuple[str, ...]:
    """Return the plugin files that the configuration of a results folder names; none if it cannot be read."""
    try:
        return _plugin_files(_content(out / CONFIG))
    except FileError:
        return ()


def load_them(files: Iterable[str]) -> str:
    """Return the remedy for those plugin files of a results folder that are not loaded; empty if all are."""
    words = [
        word for file in files if not plugins.is_loaded(file) for word in ("--plugin", file)
    ]
    return f"add {shlex.join(words)} if you trust that code" if words else ""


def _plugin_files(content: dict[str, Any]) -> tuple[str, ...]:
    files = content.get("plugins")
    return tuple(map(str, files)) if isinstance(files, list) else ()


def _content(path: Path) -> dict[str, Any]:
    with reading(path, "repeat the run's command"):
        content = read_yaml(regular(path).read_text(encoding="utf-8"))
        if not all(isinstance(one, dict) for one in (content, *content.get("jobs", ()))):
            raise ValueError("it is no run's configuration")
        return {
            name: value for name, value in content.items() if name not in ("sweep", "sharing")
        }
