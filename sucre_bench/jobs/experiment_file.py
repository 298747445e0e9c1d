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
from sucre_bench.jobs.rerun import given
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.word_syntax import literal, value_of
from sucre_bench.machine.files import reading, regular, write_atomically
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import Choice, plain_value
from sucre_bench.plugins.plugin import Kind

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
    datasets = {_of_label(one): one for one in sweeper.get("datasets", ())}
    methods = {_of_label(one): one for one in sweeper.get("methods", ())}
    metrics = dict(content.get("metrics", {}))
    for job in jobs:
        dataset = _listed("dataset", job.dataset, job.seed)
        dataset["label"] = job.values["dataset"]["label"] or job.dataset.plugin.name
        if job.degrade.record:
            dataset["degrade"] = job.degrade.record
        datasets[_of_label(dataset)] = dataset
        method = _listed("method", job.method, job.seed)
        methods[_of_label(method)] = method
        for metric in job.metrics:
            variants = {"variants": list(metric.variants)}
            metrics[metric.plugin.name] = {**variants, **given("metric", metric.record)}
    replicates = {job.replicate for job in jobs} | set(content.get("replicates", ()))
    usual = RunConfig.defaults()
    now = {name: plain_value(getattr(first, name)) for name in _RECORDED}
    settings = {name: value for name, value in now.items() if value != usual[name]}
    if first.study:
        study = plain_value(vars(first.study))
        settings["study"] = {name: v for name, v in study.items() if v != usual["study"][name]}
    sweeper = {"datasets": [*datasets.values()], "methods": [*methods.values()]}
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


def _listed(kind: Kind, choice: Choice, seed: int) -> dict[str, Any]:
    """A dataset or method as a sweeper lists it. seed: of the run."""
    options = given(kind, choice.record, seed)
    return {kind: choice.plugin.name, "label": choice.label, **options}


def _of_label(listed: Mapping[str, Any]) -> str:
    """What tells a listed dataset or method from others: its label, and how it is degraded."""
    return f"{listed.get('label')} {listed.get('degrade')}"
