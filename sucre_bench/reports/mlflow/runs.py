"""Writes a results folder as runs of mlflow."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Column, Comparison
from sucre_bench.compare.documents import as_text
from sucre_bench.compare.words import deciding
from sucre_bench.errors import InputError
from sucre_bench.machine import provenance
from sucre_bench.machine.files import regular
from sucre_bench.machine.text_formats import masked
from sucre_bench.reports.mlflow.store import VIEW_TAG, connect, one_line_for, remember
from sucre_bench.reports.paper import style
from sucre_bench.results import layout
from sucre_bench.results.rows import restoration_rows, restorations

if TYPE_CHECKING:
    from mlflow import MlflowClient

_LONGEST_PARAM, _LONGEST_NOTE = 6000, 7500
_MOST_PICTURES = 40  # of a run, evenly chosen; all whole pictures are among its artifacts
_PICTURE_SIZE = (640, 640)
_MOST_RUNS = 50_000  # that mlflow returns of a search
_GROUPS = ("dataset", "degrade")  # of options, beside those of the method


def log(out: Path, rows: DataFrame, comparisons: Sequence[Comparison], uri: str, experiment: str) -> int:
    """Log a results folder in mlflow: its rows, their comparisons, and its files. Return how many child runs are new.

    Child runs whose rows are logged already stay as they are. Raises InputError for a store that mlflow cannot use,
    OutputError where mlflow fails.
    """
    with one_line_for(uri):
        client, number = connect(uri, experiment)
        jobs = [of_job for _, of_job in rows[rows["method"] != ""].groupby(["dataset", "method"], sort=False)]
        new = [job for job in jobs if not client.search_runs([number], f"tags.rows = '{_hash(job)}'", max_results=1)]
        if new:
            # mlflow's page begins with the newest run of each method and the columns that decide, best first: what
            # its own button "share" writes.
            chosen = [deciding(comparison) for comparison in comparisons]
            keys = list(dict.fromkeys(_key(column) for each in chosen for column in each.columns))
            view: dict[str, Any] = {
                "selectedColumns": keys,
                "columnOrder": ["attributes.`Run Name`", *keys],
                "searchFilter": "tags.latest = 'yes' and tags.method LIKE '%'",
            }
            if main := next((each.main for each in chosen if each.main), None):
                view |= {"orderByKey": _key(main), "orderByAsc": main.better == "lower"}
            client.set_experiment_tag(number, VIEW_TAG, json.dumps(view))
            _Folder(client, number, out).log(rows, len(jobs), new, comparisons)
        remember(out, uri, experiment)
        return len(new)


@dataclass(frozen=True)
class _Folder:
    """A results folder that is logged in an experiment of mlflow."""

    client: MlflowClient
    experiment: str
    out: Path

    def log(self, rows: DataFrame, n_jobs: int, new: Sequence[DataFrame], comparisons: Sequence[Comparison]) -> None:
        """The parent run, and a child for each of the new jobs."""
        older = self.client.search_runs([self.experiment], "tags.latest = 'yes'", max_results=_MOST_RUNS)
        environment = provenance.read(self.out / "environment.json") or {}
        tags = {
            "jobs": str(n_jobs),
            "mlflow.source.git.commit": environment.get("git_commit"),
            "command": masked(" ".join(environment.get("command", []))),
            "sucre_bench": environment.get("sucre_bench"),
        }
        note = as_text(comparisons, "md") if (rows["status"] == "ok").any() else ""
        if len(note) >= _LONGEST_NOTE:
            note = "Too many tables to show here; they are in scores.parquet."
        with self._run(self.out.resolve().name, rows, tags, note) as parent:
            for name in ("config.yaml", "environment.json"):
                if (self.out / name).is_file():
                    self.client.log_artifact(parent, str(self.out / name))
            for name in ("tables", "figures"):
                if (self.out / name).is_dir():
                    self.client.log_artifacts(parent, str(self.out / name), name)
            self._mark_latest(parent, older, "", "")
            for of_job in new:
                self._log_job(parent, of_job, older)

    def _log_job(self, parent: str, rows: DataFrame, older: Sequence[Any]) -> None:
        """One dataset and method as a child run: parameters, means and per-view steps, table, restored pictures."""
        dataset, method = rows["dataset"].iloc[0], rows["method"].iloc[0]
        options = json.loads(rows["options"].iloc[-1])
        statuses = set(restoration_rows(rows)["status"])
        tags = {
            "mlflow.parentRunId": parent,
            "mlflow.runColor": style.own_look(method).colour,
            "dataset": dataset,
            "method": method,
            "plugin": str(options.get("name", "")),
            "data_id": ",".join(sorted(set(rows["data_id"]) - {""})),
            "code": ",".join(sorted(set(rows["code"].str.split(".").str[0]) - {""})),
            "device": ",".join(sorted(set(rows["device"]) - {""})),
            "status": "failed" if "failed" in statuses else "skipped" if statuses == {"skipped"} else "ok",
        }
        views = rows.loc[rows["view"] != "", ["scene", "view"]].drop_duplicates().sort_values(["scene", "view"])
        # A view's step in mlflow's curves and pictures, alike for all methods of a dataset.
        steps = {view: step for step, view in enumerate(views.itertuples(index=False, name=None))}
        plugin = plugins.usable("method").get(tags["plugin"])
        reasons = rows.loc[rows["status"] == "failed", "reason"].drop_duplicates().head(5)
        note = [f"**{method}** on **{dataset}**, views: {len(views)}."]
        note += [*([plugin.summary, plugin.cites] if plugin else []), *(f"failed: `{reason}`" for reason in reasons)]
        restored = self.out / "restored" / layout.file_name(dataset) / layout.file_name(method)
        with self._run(f"{method} on {dataset}", rows, tags, "\n\n".join(filter(None, note))) as run:
            self._log_values(run, options, rows, steps)
            if restored.is_dir():
                self.client.log_artifacts(run, str(restored), "restored")
            self._log_pictures(run, rows, steps)
            self._mark_latest(run, older, dataset, method)
            self.client.set_tag(run, "rows", _hash(rows))  # last: a run that was cut off before is not taken for whole

    @contextmanager
    def _run(self, name: str, rows: DataFrame, tags: Mapping[str, str | None], note: str) -> Iterator[str]:
        """A run with its table, from the time its rows begin to that of their end."""
        about = {"mlflow.source.name": "sucre-bench", "mlflow.source.type": "LOCAL", "out": str(self.out.resolve())}
        about |= {tag: value[:5000] for tag, value in tags.items() if value} | {"mlflow.note.content": note}
        run = str(self.client.create_run(self.experiment, _stamp(rows["time"].min()), about, name).info.run_id)
        try:
            with tempfile.TemporaryDirectory() as folder:
                rows.to_parquet(Path(folder) / results.TABLE, index=False)
                self.client.log_artifact(run, str(Path(folder) / results.TABLE))
            yield run
        except BaseException:
            with suppress(Exception):  # of what broke it off; mlflow may be gone
                self.client.set_terminated(run, "KILLED")
            raise
        failed = (rows["status"] == "failed").any()
        self.client.set_terminated(run, "FAILED" if failed else "FINISHED", _stamp(rows["time"].max()))

    def _mark_latest(self, run: str, older: Sequence[Any], dataset: str, method: str) -> None:
        """Mark a run as the newest of its dataset and method in this folder (of parents both ""), older ones as not."""
        key = {"out": str(self.out.resolve()), "dataset": dataset, "method": method}
        self.client.set_tag(run, "latest", "yes")
        for other in older:
            if all(other.data.tags.get(tag, "") == value for tag, value in key.items()):
                self.client.set_tag(other.info.run_id, "latest", "no")

    def _log_values(
        self, run: str, options: Mapping[str, Any], rows: DataFrame, steps: Mapping[tuple[str, str], int]
    ) -> None:
        """Parameters, means over views, every view's value as a step, and how many views ended how."""
        from mlflow.entities import Metric, Param

        params = {f"method.{name}": value for name, value in options.items() if name not in (*_GROUPS, "replicate")}
        for group in _GROUPS:
            params |= {f"{group}.{name}": value for name, value in options.get(group, {}).items()}
        replicates = sorted({results.unreplicated(scene)[1] for scene in rows["scene"].unique()})
        if replicates not in ([0], []):
            params["replicates"] = ",".join(map(str, replicates))
        texts = {name: v if isinstance(v, str) else json.dumps(v, default=str) for name, v in params.items()}
        listed = [Param(name, text[:_LONGEST_PARAM]) for name, text in texts.items()]

        ok = rows[(rows["status"] == "ok") & ~rows["region"].str.contains("/", regex=False)]
        ok = ok[ok["value"].abs() < float("inf")]
        metrics, end = [], _stamp(rows["time"].max())
        for (metric, variant), scores in ok.groupby(["metric", "variant"], sort=False):
            name, when = f"{metric}.{variant}", _stamp(scores["time"].max())
            by_view = scores.groupby(["scene", "view"])["value"].mean()
            metrics.append(Metric(name, float(by_view.mean()), when, 0))
            metrics += [Metric(f"views/{name}", float(value), when, steps[view]) for view, value in by_view.items()]
        ended = restoration_rows(rows).drop_duplicates(["scene", "view"])["status"]
        metrics += [Metric(f"views_{how}", float((ended == how).sum()), end, 0) for how in ("ok", "failed", "skipped")]
        for start in range(0, len(metrics), 1000):  # the most of one request
            self.client.log_batch(run, metrics=metrics[start : start + 1000])
        for start in range(0, len(listed), 100):
            self.client.log_batch(run, params=listed[start : start + 100])

    def _log_pictures(self, run: str, rows: DataFrame, steps: Mapping[tuple[str, str], int]) -> None:
        """Small pictures by step, which mlflow's chart view shows side by side for the runs that are selected."""
        from PIL import Image

        every = -(-len(steps) // _MOST_PICTURES)
        for row in restorations(rows).itertuples():
            step = steps[str(row.scene), str(row.view)]
            place = layout.find(row.dataset, row.scene, row.view, self.out) if step % every == 0 else None
            if place is None:
                continue
            try:
                with Image.open(regular(place.restored(self.out, row.method))) as whole:
                    small = whole.convert("RGB")
            except (OSError, InputError):  # gone, or cut short: the others are shown
                continue
            small.thumbnail(_PICTURE_SIZE)
            when = _stamp(str(row.time))
            self.client.log_image(run, small, key="restored", step=step, timestamp=when, synchronous=True)


def _key(column: Column) -> str:
    """A score's name where mlflow's page looks for columns."""
    return f"metrics.`{column.metric}.{column.variant}`"


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
