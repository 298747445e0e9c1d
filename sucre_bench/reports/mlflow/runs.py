"""The runs of a results folder in mlflow: a parent, and a child for each job."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from sucre_bench import compare, plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Comparison
from sucre_bench.compare.documents import as_text
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError
from sucre_bench.machine import provenance
from sucre_bench.machine.files import regular
from sucre_bench.machine.text_formats import masked
from sucre_bench.plugins.options import options_of, plain_value
from sucre_bench.reports.mlflow.store import Note, connect, one_line_for
from sucre_bench.reports.paper import style
from sucre_bench.results import layout
from sucre_bench.results.rows import (
    Row,
    fingerprint,
    restoration_rows,
    restorations,
    tuples,
    values_of,
)
from sucre_bench.results.table import read_common

_LONGEST_TAG, _LONGEST_PARAM, _LONGEST_NOTE, _LONGEST_DIGEST = 5000, 6000, 7500, 36
_MOST_PICTURES = 40  # of a dataset, evenly chosen; all whole pictures are among the artifacts
_PICTURE_SIZE = (640, 640)
_CODE = 12  # digits of a row's code that are of dataset and method


class Job(NamedTuple):
    """What identifies a job: labels, all options as JSON, the seed, and the hash of the code."""

    dataset: str
    method: str
    options: str
    seed: int
    code: str

    @classmethod
    def of(cls, row: Row) -> Job:
        """Return the job of a row."""
        return cls(row.dataset, row.method, row.options, row.seed, row.code[:_CODE])

    @property
    def params(self) -> dict[str, str]:
        """Return every option as mlflow's parameters, by its name on the command line."""
        values = json.loads(self.options)
        params = {"seed": int(self.seed), "replicate": values.pop("replicate", 0)}
        degrade = {option.name: plain_value(option.default) for option in options_of(Degradation)}
        groups = {
            "dataset": values.pop("dataset", {}),
            "degrade": degrade | values.pop("degrade", {}),
        }
        for group, options in {**groups, "method": values}.items():
            params |= {f"{group}.{name}": value for name, value in options.items()}
        return {name: _text(value)[:_LONGEST_PARAM] for name, value in params.items()}


def jobs_of(rows: DataFrame) -> dict[Job, DataFrame]:
    """Return the rows of each job."""
    rows = rows[rows["method"] != ""]
    keys = ["dataset", "method", "options", "seed", rows["code"].str[:_CODE]]
    groups: Any = rows.groupby(keys, sort=False)
    return {Job(*key): of_job for key, of_job in groups}


def log(out: Path, uri: str, experiment: str, runs: Runs | None = None) -> int:
    """Log all of a results folder that mlflow does not have yet. Return how many child runs are new or have changed.

    runs: where a part of it is logged already. Raises InputError for a store that mlflow cannot use, OutputError where
    mlflow fails.
    """
    rows = results.read(out)
    comparisons = compare.compare(compare.on_pixels(rows, partial(read_common, out)))
    with one_line_for(uri):
        runs = runs or Runs(out, uri, experiment)
        changed = runs.end(rows, comparisons)
        runs.note.remember(uri, experiment)
        return changed


class Runs:
    """The runs of a results folder in an experiment. What has begun before goes on: values are logged once.

    note: what the folder notes.
    """

    def __init__(self, out: Path, uri: str, experiment: str) -> None:
        self._client, self._experiment = connect(uri, experiment)
        self._out = out
        self.note = Note(out)
        self.note.write()  # the folder's id, before any run has it
        self._parent = ""
        self._children: dict[Job, str] = {}
        self._at_work = set[str]()
        self._failed = set[str]()
        self._logged: dict[
            str, set[tuple[str, int, int]]
        ] = {}  # name, step and time of each run's values

    def start(self, jobs: Iterable[Job], when: int | None = None) -> None:
        """Begin the parent run, with the parameters that all jobs share. when: in milliseconds, by default now."""
        first, *others = [job.params for job in jobs]
        shared = {
            name: value
            for name, value in first.items()
            if all(one.get(name) == value for one in others)
        }
        environment = provenance.read(self._out / "environment.json") or {}
        tags = {
            "mlflow.source.git.commit": environment.get("git_commit"),
            "command": masked(" ".join(environment.get("command", []))),
            "sucre_bench": environment.get("sucre_bench"),
        }
        self._parent = self._begin(self._out.resolve().name, {}, shared, shared, tags, when)

    def begin(self, job: Job, when: int | None = None) -> str:
        """Return the child run of a job, which begins unless it has begun. when: as for `start`."""
        if job not in self._children:
            plugin_name = str(json.loads(job.options).get("name", ""))
            plugin = plugins.usable("method").get(plugin_name)
            note = [
                f"**{job.method}** on **{job.dataset}**.",
                *([plugin.summary, plugin.cites] if plugin else []),
            ]
            tags = {
                "mlflow.parentRunId": self._parent,
                "mlflow.runColor": style.own_look(job.method).colour,
                "mlflow.note.content": "\n\n".join(filter(None, note)),
                "plugin": plugin_name,
                "code": job.code,
            }
            name = f"{job.method} on {job.dataset}"
            labels = {"dataset": job.dataset, "method": job.method}
            self._children[job] = self._begin(name, labels, job, job.params, tags, when)
        return self._children[job]

    def add(self, rows: DataFrame) -> None:
        """Log views' scores, each view a step, their pictures, and faults."""
        from mlflow.entities import Metric

        for job, of_job in jobs_of(rows).items():
            run = self.begin(job, _stamp(of_job["time"].min()))
            steps = self._steps_of(job, of_job)
            for row in tuples(restorations(of_job)):
                step = steps[row.scene, row.view]
                is_new = ("views/seconds.wall", step, _stamp(row.time)) not in self._logged[run]
                if is_new and step % -(-len(self.note.views[job.dataset]) // _MOST_PICTURES) == 0:
                    self._log_picture(run, row, step)
            values = []
            for name, scene, view, value, time in values_of(
                _scores(of_job), "name", "scene", "view", "value", "time"
            ):
                point = (f"views/{name}", steps[scene, view], _stamp(time))
                if point not in self._logged[run]:
                    self._logged[run].add(point)
                    values.append(Metric(point[0], value, point[2], point[1]))
            self._log_metrics(run, values)
            self._log_datasets(run, job, of_job)
            self._note_faults(run, of_job)

    def close(self, job: Job) -> None:
        """End a job whose views are done; `end` adds its means."""
        self._close(self._children[job])

    def kill(self) -> None:
        """End all that is at work, since the command was stopped."""
        for run in self._at_work:
            self._client.set_terminated(run, "KILLED")

    def end(self, rows: DataFrame, comparisons: Sequence[Comparison]) -> int:
        """Log what lacks: of each job, and of all of them. Return how many jobs' rows were not all logged."""
        jobs = jobs_of(rows)
        changed = {job: of_job for job, of_job in jobs.items() if not self._is_whole(job, of_job)}
        if not (changed or self._at_work):
            return 0
        if not self._parent:  # nobody followed the command
            _, older = self._named({}, "")
            self._parent = next(
                (run.info.run_id for run in older if run.data.tags["latest"] == "yes"), ""
            )
            if not self._parent:
                self.start(jobs, _stamp(rows["time"].min()))
            self._at_work.add(self._parent)
        for job, of_job in changed.items():
            self.add(of_job)
            self._end_job(job, of_job)
        note = as_text(comparisons, "md") if (rows["status"] == "ok").any() else ""
        if len(note) >= _LONGEST_NOTE:
            note = "Too many tables to show here; they are in scores.parquet."
        self._client.set_tag(self._parent, "mlflow.note.content", note)
        for path in (
            self._out / name for name in ("config.yaml", "environment.json", results.TABLE)
        ):
            if path.is_file():
                self._client.log_artifact(self._parent, str(path))
        for path in (self._out / name for name in ("tables", "figures")):
            if path.is_dir():
                self._client.log_artifacts(self._parent, str(path), path.name)
        means = (
            _scores(rows)
            .groupby(["dataset", "method", "name"], sort=False)["value"]
            .mean()
            .unstack()
        )
        self._log_table(self._parent, means)
        self._log_counts(self._parent, rows)
        self._note_faults(self._parent, rows)
        for run in [*self._at_work]:
            self._close(run)
        return len(changed)

    def steps(self, dataset: str, views: Iterable[tuple[str, str]]) -> dict[tuple[str, str], int]:
        """Return the steps of views, by scene and name, alike for all methods. New views follow known ones."""
        known = self.note.views.setdefault(dataset, [])
        names = {view: [results.unreplicated(view[0])[0], view[1]] for view in sorted(set(views))}
        if new := [name for name in names.values() if name not in known]:
            known += [name for k, name in enumerate(new) if name not in new[:k]]
            self.note.write()
        places = {tuple(name): step for step, name in enumerate(known)}
        return {view: places[tuple(name)] for view, name in names.items()}

    def _steps_of(self, job: Job, rows: DataFrame) -> dict[tuple[str, str], int]:
        return self.steps(job.dataset, values_of(rows[rows["view"] != ""], "scene", "view"))

    # -- one run --

    def _named(
        self, labels: Mapping[str, str], identity: object
    ) -> tuple[dict[str, str], list[Any]]:
        """The tags by which a run is found again, and the runs of the same dataset and method of the folder."""
        place = fingerprint({"folder": self.note.folder, **labels})[1]
        tags = {"place": place, "job": fingerprint({"place": place, "is": identity})[1]}
        return tags, self._client.search_runs([self._experiment], f"tags.place = '{place}'")

    def _begin(
        self,
        name: str,
        labels: Mapping[str, str],
        identity: object,
        params: Mapping[str, str],
        tags: Mapping[str, str | None],
        when: int | None,
    ) -> str:
        """A run that begins, or goes on. labels: of dataset and method, of which only the newest run is `latest`."""
        from mlflow.entities import Param, RunTag

        place, others = self._named(labels, identity)
        own = {
            "mlflow.source.name": "sucre-bench",
            "mlflow.source.type": "LOCAL",
            "out": str(self._out.resolve()),
        }
        own |= {tag: value[:_LONGEST_TAG] for tag, value in tags.items() if value}
        own |= {**labels, **place, "latest": "yes"}
        run = ""
        for other in others:
            if other.data.tags["job"] == place["job"]:
                run = other.info.run_id
                names = (name for name in other.data.metrics if name.startswith("views/"))
                points = (
                    point for name in names for point in self._client.get_metric_history(run, name)
                )
                self._logged[run] = {(point.key, point.step, point.timestamp) for point in points}
            elif other.data.tags.get("latest") == "yes":
                self._client.set_tag(other.info.run_id, "latest", "no")
        if run:
            self._client.update_run(run, "RUNNING")
            self._client.log_batch(run, tags=[RunTag(*tag) for tag in own.items()])
        else:
            run = self._client.create_run(self._experiment, when, own, name).info.run_id
            self._logged[run] = set()
        self._at_work.add(run)
        listed = [Param(*param) for param in params.items()]
        for start in range(0, len(listed), 100):  # the most of one request
            self._client.log_batch(run, params=listed[start : start + 100])
        return run

    def _is_whole(self, job: Job, rows: DataFrame) -> bool:
        """Whether all rows of a job are logged."""
        tags, runs = self._named({"dataset": job.dataset, "method": job.method}, job)
        own = [run for run in runs if run.data.tags["job"] == tags["job"]]
        return any(
            run.data.tags.get("rows") == _hash(rows) and run.info.status != "RUNNING" for run in own
        )

    def _end_job(self, job: Job, rows: DataFrame) -> None:
        """Log a job's means, its table, and its restored pictures, and end it."""
        from mlflow.entities import Metric

        run = self._children[job]
        scores = _scores(rows)
        steps = self._steps_of(job, rows)
        when = _stamp(rows["time"].max())
        means = scores.groupby("name", sort=False)["value"].mean().items()
        self._log_metrics(run, [Metric(str(name), value, when, 0) for name, value in means])
        self._log_counts(run, rows)
        scores["step"] = [steps[view] for view in values_of(scores, "scene", "view")]
        self._log_table(run, scores.set_index(["step", "scene", "view", "name"])["value"].unstack())
        restored = layout.restored_path(self._out, layout.file_name(job.dataset), job.method)
        if restored.is_dir():
            self._client.log_artifacts(run, str(restored), "restored")
        self._close(run)
        # last: a run that was cut off before is not taken for whole
        self._client.set_tag(run, "rows", _hash(rows))

    def _close(self, run: str) -> None:
        self._client.set_terminated(run, "FAILED" if run in self._failed else "FINISHED")
        self._at_work.discard(run)

    def _note_faults(self, run: str, rows: DataFrame) -> None:
        """Tag a run with its status and the first reason of a fault, if there is one."""
        reasons = rows.loc[rows["status"] == "failed", "reason"]
        if len(reasons):
            self._failed.add(run)
            self._client.set_tag(run, "reason", str(reasons.iloc[0])[:_LONGEST_TAG])
        statuses = {*restoration_rows(rows)["status"], *(["failed"] if run in self._failed else [])}
        status = next(
            (status for status in ("failed", "ok", "skipped") if status in statuses), "ok"
        )
        self._client.set_tag(run, "status", status)

    def _log_metrics(self, run: str, metrics: Sequence[Any]) -> None:
        for start in range(0, len(metrics), 1000):  # the most of one request
            self._client.log_batch(run, metrics=metrics[start : start + 1000])

    def _log_counts(self, run: str, rows: DataFrame) -> None:
        """How many views ended how."""
        ended = restoration_rows(rows).drop_duplicates(["method", "scene", "view"])["status"]
        for how in ("ok", "failed", "skipped"):
            self._client.log_metric(run, f"views_{how}", float((ended == how).sum()))

    def _log_table(self, run: str, table: DataFrame) -> None:
        """Log a table, with the levels of its index as columns, instead of what was logged before."""
        whole = table.reset_index().astype(object)
        if "mlflow.loggedArtifacts" in self._client.get_run(run).data.tags:
            # log_table would add to it
            self._client.log_text(run, whole.to_json(orient="split", index=False), "scores.json")
        else:
            self._client.log_table(run, whole, "scores.json")

    def _log_datasets(self, run: str, job: Job, rows: DataFrame) -> None:
        """Log the data of each scene as an input."""
        from mlflow.entities import Dataset, DatasetInput, InputTag

        options = json.loads(job.options).get("dataset", {})
        source = json.dumps({"uri": str(options.get("root") or options.get("name", job.dataset))})
        ids = {data_id[:_LONGEST_DIGEST] for data_id in rows["data_id"]} - {""}
        inputs = [Dataset(job.dataset, data_id, "local", source) for data_id in sorted(ids)]
        context = [InputTag("mlflow.data.context", "evaluation")]
        self._client.log_inputs(run, [DatasetInput(one, context) for one in inputs])

    def _log_picture(self, run: str, row: Any, step: int) -> None:
        """A small picture by step, which mlflow's chart view shows side by side for the runs that are selected."""
        from PIL import Image

        place = layout.find(row.dataset, row.scene, row.view, self._out)
        with suppress(OSError, InputError):  # gone, or cut short: the others are shown
            if place:
                with Image.open(regular(place.restored(self._out, row.method))) as whole:
                    small = whole.convert("RGB")
                small.thumbnail(_PICTURE_SIZE)
                when = _stamp(row.time)
                self._client.log_image(
                    run, small, key="restored", step=step, timestamp=when, synchronous=True
                )


def _scores(rows: DataFrame) -> DataFrame:
    """Each view's score of each metric: the mean over its regions without patches, and its time."""
    import numpy as np

    is_ok = (
        (rows["status"] == "ok")
        & (rows["view"] != "")
        & ~rows["region"].str.contains("/", regex=False)
    )
    ok = rows[is_ok & np.isfinite(rows["value"])]
    named = ok.assign(name=ok["metric"] + "." + ok["variant"])
    keys = ["dataset", "method", "name", "scene", "view"]
    return named.groupby(keys, sort=False, as_index=False).agg({"value": "mean", "time": "max"})


def _text(value: Any) -> str:
    """A parameter's value: 0 for 0.0, as users type it."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return value if isinstance(value, str) else json.dumps(value, default=str)


def _stamp(time: str) -> int:
    """A row's time as mlflow has it: milliseconds since 1970."""
    import pandas as pd

    return int(pd.Timestamp(str(time)).timestamp() * 1000)


def _hash(rows: DataFrame) -> str:
    """What identifies rows in any order: 16 hex digits."""
    import pandas as pd

    ordered = rows.sort_values([*rows.columns[:4], "metric", "variant", "region"], kind="stable")
    hashes = pd.util.hash_pandas_object(ordered, index=False).to_numpy().tobytes()
    return hashlib.blake2b(hashes, digest_size=8).hexdigest()
