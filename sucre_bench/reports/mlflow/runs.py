"""The runs of a results folder in mlflow: a parent, and a child for each job."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sucre_bench import compare, results
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Comparison
from sucre_bench.compare.documents import as_text
from sucre_bench.degrade import Degradation
from sucre_bench.machine import provenance
from sucre_bench.machine.processes import interrupts_held_back
from sucre_bench.machine.text_formats import masked
from sucre_bench.plugins.options import options_of, plain_value
from sucre_bench.reports.mlflow.run import Run, scores_of, stamp
from sucre_bench.reports.mlflow.store import Note, Place, connect, reported
from sucre_bench.reports.paper import style
from sucre_bench.results import layout
from sucre_bench.results.rows import Row, fingerprint, restorations, tuples, values_of
from sucre_bench.results.table import read_both

_LONGEST_PARAM = 6000
_LONGEST_NOTE = 7500
_MOST_RUNS = 50_000  # of one answer of mlflow
_MOST_PICTURES = 40  # of a dataset, evenly chosen; all whole pictures are among the artifacts
_CODE = 12  # digits of a row's code that are of dataset and method


class JobKey(NamedTuple):
    """What identifies a job: labels, all options as JSON, the seed, and the hash of the code."""

    dataset: str
    method: str
    options: str
    seed: int
    code: str

    @classmethod
    def of(cls, row: Row) -> JobKey:
        """Return the job of a row."""
        return cls(row.dataset, row.method, row.options, row.seed, row.code[:_CODE])

    @property
    def hash(self) -> str:
        """What mlflow keeps of it, to find its run again."""
        return fingerprint(self._asdict())[1]

    @property
    def params(self) -> dict[str, str]:
        """Return every option as mlflow's parameters, by its name on the command line."""
        values = json.loads(self.options)
        params = {"seed": int(self.seed), "replicate": values.pop("replicate", 0)}
        degrade = {
            option.name: plain_value(option.default) for option in options_of(Degradation)
        }
        groups = {
            "dataset": values.pop("dataset", {}),
            "degrade": degrade | values.pop("degrade", {}),
            "method": values,
        }
        for group, options in groups.items():
            params |= {f"{group}.{name}": value for name, value in options.items()}
        return {name: _text(value)[:_LONGEST_PARAM] for name, value in params.items()}


def jobs_of(rows: DataFrame) -> dict[JobKey, DataFrame]:
    """Return the rows of each job."""
    rows = rows[rows["method"] != ""]
    keys = ["dataset", "method", "options", "seed", rows["code"].str[:_CODE]]
    groups: Any = rows.groupby(keys, sort=False)
    return {JobKey(*key): of_job for key, of_job in groups}


def log(out: Path, place: Place, runs: Runs | None = None) -> int:
    """Log all of a results folder that mlflow does not have yet. Return how many child runs are new or have changed.

    runs: where a part of it is logged already. Raises InputError for a store that mlflow cannot use, OutputError where
    mlflow fails.
    """
    rows, common = read_both(out)
    comparisons = compare.compare(compare.on_pixels(rows, common))
    with reported(place.uri):
        runs = runs or Runs(out, place)
        try:
            return runs.end(rows, comparisons)
        except KeyboardInterrupt:
            runs.kill()
            raise


class Runs:
    """The runs of a results folder in an experiment. What has begun before goes on: values are logged once."""

    def __init__(self, out: Path, place: Place) -> None:
        self._client, self._experiment = connect(place)
        self._out = out
        self._note = Note(out)
        of_folder = f"tags.folder = '{self._note.folder}'"
        found = self._client.search_runs([self._experiment], of_folder, max_results=_MOST_RUNS)
        self._known = {str(run.data.tags["job"]): run for run in found}
        self._parent: Run | None = None
        self._children: dict[JobKey, Run] = {}

    def start(self, when: int | None = None) -> Run:
        """Return the parent run, which begins unless it has begun. when: in milliseconds, by default now."""
        if self._parent is None:
            environment = provenance.read(self._out / "environment.json") or {}
            tags = {
                "mlflow.source.git.commit": environment.get("git_commit") or "",
                "command": masked(" ".join(environment.get("command", []))),
                "sucre_bench": environment.get("sucre_bench") or "",
            }
            with interrupts_held_back():  # else nobody would end it
                self._parent = self._begun("parent", self._out.resolve().name, tags, when)
        return self._parent

    def _begin(self, job: JobKey, when: int) -> Run:
        """The child run of a job, which begins unless it has begun."""
        if job not in self._children:
            tags = {
                "dataset": job.dataset,
                "method": job.method,
                "mlflow.parentRunId": self.start(when).id,
                "mlflow.runColor": style.own_look(job.method).colour,
                "code": job.code,
            }
            name = f"{job.method} on {job.dataset}"
            with interrupts_held_back():
                self._children[job] = self._begun(job.hash, name, tags, when)
            self._children[job].log_params(job.params)
        return self._children[job]

    def _begun(self, job: str, name: str, tags: Mapping[str, str], when: int | None) -> Run:
        """A run that begins, or goes on."""
        own = {
            "mlflow.source.name": "sucre-bench",
            "mlflow.source.type": "LOCAL",
            "out": str(self._out.resolve()),
            "folder": self._note.folder,
            "job": job,
            **{tag: value for tag, value in tags.items() if value},
        }
        if job in self._known:
            return Run.again(self._client, self._known[job], own)
        made = self._client.create_run(self._experiment, when, own, name)
        return Run(self._client, made.info.run_id)

    def add(self, rows: DataFrame) -> None:
        """Log views' scores, each view a step, their pictures, their data, and faults."""
        for job, of_job in jobs_of(rows).items():
            run = self._begin(job, stamp(of_job["time"].min()))
            steps = self._steps_of(of_job)
            every = -(-self._note.n_views(job.dataset) // _MOST_PICTURES)
            for row in tuples(restorations(of_job)):
                step = steps[row.scene, row.view]
                if step % every or run.has("views/seconds.wall", step, stamp(row.time)):
                    continue
                if place := layout.find(row.dataset, row.scene, row.view, self._out):
                    picture = place.restored(self._out, row.method)
                    run.log_picture(picture, step, stamp(row.time))
            columns = ("name", "scene", "view", "value", "time")
            run.log_metrics(
                (f"views/{name}", value, steps[scene, view], stamp(time))
                for name, scene, view, value, time in values_of(scores_of(of_job), *columns)
            )
            options = json.loads(job.options).get("dataset", {})
            source = str(options.get("root") or options.get("name", job.dataset))
            run.log_data(job.dataset, source, set(of_job["data_id"]) - {""})
            run.log_status(of_job)

    def close(self, job: JobKey) -> None:
        """End a job whose views are done; `end` adds its means."""
        self._children[job].close()

    def kill(self) -> None:
        """End all that is at work, since the command was stopped."""
        with interrupts_held_back():
            for run in filter(None, (self._parent, *self._children.values())):
                if run.status == "RUNNING":
                    run.close("KILLED")

    def end(self, rows: DataFrame, comparisons: Sequence[Comparison]) -> int:
        """Log what lacks: of each job, and of all of them. Return how many jobs' rows were not all logged."""
        jobs = jobs_of(rows)
        changed = {
            job: of_job for job, of_job in jobs.items() if not self._is_whole(job, of_job)
        }
        is_ended = "parent" in self._known and self._known["parent"].info.status != "RUNNING"
        if is_ended and not changed and not self._parent:
            return 0
        parent = self.start(stamp(rows["time"].min()))
        for job, of_job in changed.items():
            self.add(of_job)
            self._end_job(job, of_job)
        note = as_text(comparisons, "md") if (rows["status"] == "ok").any() else ""
        if len(note) >= _LONGEST_NOTE:
            note = "Too many tables to show here; they are in scores.parquet."
        parent.tag("mlflow.note.content", note)
        for name in ("config.yaml", "environment.json", results.TABLE, "tables", "figures"):
            parent.log_files(self._out / name)
        keys = ["dataset", "method", "name"]
        means = scores_of(rows).groupby(keys, sort=False)["value"].mean()
        parent.log_table(means.unstack())
        parent.log_counts(rows)
        parent.log_status(rows)
        parent.close()
        return len(changed)

    def _is_whole(self, job: JobKey, rows: DataFrame) -> bool:
        """Whether all rows of a job are logged."""
        known = self._known.get(job.hash)
        if known is None or job in self._children:
            return False
        return known.info.status != "RUNNING" and known.data.tags.get("rows") == _hash(rows)

    def _end_job(self, job: JobKey, rows: DataFrame) -> None:
        """Log a job's means, its table, and its restored pictures, and end it."""
        run = self._children[job]
        scores = scores_of(rows)
        when = stamp(rows["time"].max())
        means = scores.groupby("name", sort=False)["value"].mean()
        run.log_metrics((str(name), value, 0, when) for name, value in means.items())
        run.log_counts(rows)
        steps = self._steps_of(rows)
        scores["step"] = [steps[view] for view in values_of(scores, "scene", "view")]
        run.log_table(scores.set_index(["step", "scene", "view", "name"])["value"].unstack())
        restored = layout.restored_path(self._out, layout.file_name(job.dataset), job.method)
        run.log_files(restored, "restored")
        run.close()
        # last: a run that was cut off before is not taken for whole
        run.tag("rows", _hash(rows))

    def steps(self, dataset: str, views: Iterable[tuple[str, str]]) -> dict[Any, int]:
        """Return the steps of views, by scene and name, alike for all methods. New views follow known ones."""
        return self._note.steps(dataset, views)

    def _steps_of(self, rows: DataFrame) -> dict[Any, int]:
        views = values_of(rows[rows["view"] != ""], "scene", "view")
        return self._note.steps(rows["dataset"].iloc[0], views)


def _text(value: Any) -> str:
    """A parameter's value: 0 for 0.0, as users type it."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return value if isinstance(value, str) else json.dumps(value, default=str)


def _hash(rows: DataFrame) -> str:
    """What identifies rows in any order: 16 hex digits."""
    import pandas as pd

    ordered = rows.sort_values(
        [*rows.columns[:4], "metric", "variant", "region"], kind="stable"
    )
    hashes = pd.util.hash_pandas_object(ordered, index=False).to_numpy().tobytes()
    return hashlib.blake2b(hashes, digest_size=8).hexdigest()
