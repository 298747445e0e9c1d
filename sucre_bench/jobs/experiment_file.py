"""`experiment.yaml` of a results folder: an experiment as Hydra reads it, which repeats all that the folder holds.

Each run adds its datasets, configurations and metrics to it. `sucre-bench run RESULTS/experiment.yaml out=again` runs
it. Relative paths in it are relative to the folder where the command runs, as the user typed them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sucre_bench.errors import InputError
from sucre_bench.jobs.catalogue import KINDS
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.rerun import given, undegraded_label
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.word_syntax import literal, value_of
from sucre_bench.machine.files import reading, regular, write_atomically
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import plain_value

EXPERIMENT = "experiment.yaml"
# Settings of a command that an experiment has where they are not as by default.
_RECORDED = (
    "every",
    "first",
    "seed",
    "save",
    "bits",
    "colours",
    "baseline",
    "views",
    "plugins",
)


def record_experiment(jobs: Sequence[Job]) -> None:
    """Add the jobs of a command to the experiment of their results folder. OutputError if it cannot be written.

    Settings such as views and study are those of the last command. A file that is no experiment is replaced.
    """
    import yaml

    first = jobs[0]
    out = first.out
    try:
        content = read_recorded(out)
    except InputError:
        content = {}
    sweeper = content.get("hydra", {}).get("sweeper", {})
    listed = {
        kind: {_label(kind, one): one for one in sweeper.get(f"{kind}s", ())} for kind in KINDS
    }
    metrics = {
        str(name).partition(":")[0]: values
        for name, values in content.get("metrics", {}).items()
    }
    for job in jobs:
        degrade = {"degrade": job.degrade.record} if job.degrade.record else {}
        label = undegraded_label(job.dataset.label, job.degrade.record, job.dataset.plugin.name)
        dataset = {"label": label, **given("dataset", job.dataset.record, job.seed), **degrade}
        method = {"label": job.method.label, **given("method", job.method.record, job.seed)}
        listed["dataset"][job.dataset.label] = {"dataset": job.dataset.plugin.name, **dataset}
        listed["method"][job.method.label] = {"method": job.method.plugin.name, **method}
        for metric in job.metrics:
            metrics[metric.plugin.name] = {
                "variants": list(metric.variants),
                **given("metric", metric.record),
            }
    replicates = {job.replicate for job in jobs} | set(content.get("replicates", ()))
    usual = RunConfig.defaults()
    now = {name: plain_value(getattr(first, name)) for name in _RECORDED}
    settings = {name: value for name, value in now.items() if value != usual[name]}
    if first.study:
        study = plain_value(vars(first.study))
        settings["study"] = {name: v for name, v in study.items() if v != usual["study"][name]}
    sweeper = {f"{kind}s": [*listed[kind].values()] for kind in KINDS}
    if replicates != {0}:
        sweeper["params"] = {"replicate": value_of(sorted(replicates))[1:-1]}
    experiment = {
        "defaults": [{"override /metrics": [*metrics]}],
        "metrics": metrics,
        **settings,
        "hydra": {"mode": "MULTIRUN", "sweeper": sweeper},
    }
    # OmegaConf finds nothing to interpolate in it
    text = yaml.safe_dump(
        literal(experiment),
        sort_keys=False,
        allow_unicode=True,
        width=10**6,
        default_flow_style=None,
    )
    head = f"# @package _global_\n# What made {out}. To run it again: sucre-bench run {out / EXPERIMENT} out=again\n"
    write_atomically(out / EXPERIMENT, f"{head}{text}".encode())


def read_recorded(out: Path) -> dict[str, Any]:
    """Return the experiment that runs have recorded in a results folder, empty if none has.

    "replicates" has those of its sweeper. Raises InputError if the file cannot be read or is not as it was written.
    """
    path = out / EXPERIMENT
    if not path.exists():
        return {}
    with reading(path, "repeat the run's command"):
        content = read_yaml(regular(path).read_text(encoding="utf-8"))
        sweeper = content["hydra"]["sweeper"]
        for kind in KINDS:
            if not all(isinstance(one[kind], str) for one in sweeper[f"{kind}s"]):
                raise ValueError(f"it lists no {kind}s")
        replicates = str(sweeper.get("params", {}).get("replicate", 0))
        return {**content, "replicates": [int(number) for number in replicates.split(",")]}


def _label(kind: str, one: Mapping[str, Any]) -> str:
    """The label that the rows of a listed dataset or method have."""
    from sucre_bench.degrade import Degradation

    return Degradation.of(one.get("degrade") or {}).labelled(str(one.get("label") or one[kind]))
