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
from sucre_bench.compare import Comparison
from sucre_bench.compare.documents import as_text
from sucre_bench.errors import InputError
from sucre_bench.machine import provenance
from sucre_bench.machine.files import regular
from sucre_bench.machine.text_formats import masked
from sucre_bench.reports.mlflow.page import VIEW_TAG, view_of
from sucre_bench.reports.mlflow.store import connect, remember, said_of
from sucre_bench.reports.paper.figures import style
from sucre_bench.results import layout
from sucre_bench.results.rows import restoration_rows, restorations

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Metric

_LONGEST_PARAM = 6000
_MOST_PICTURES = 40  # of a run, evenly chosen; all whole pictures are among its artifacts
_PICTURE_SIZE = (640, 640)
_MOST_RUNS = 50_000  # that mlflow returns of a search


def log(out: Path, rows: DataFrame, comparisons: Sequence[Comparison], uri: str, experiment: str) -> int:
    """Log a results folder in mlflow: its rows, their comparisons, and its files. Return how many child runs are new.

    Child runs whose rows are logged already stay as they are. Raises InputError for a store that mlflow cannot use,
    OutputError where mlflow fails.
    """
    with said_of(uri):
        folder = _Folder(*connect(uri, experiment), out)
        named = rows[rows["method"] != ""]
        jobs = [of_job for _, of_job in named.groupby(["dataset", "method"], sort=False)]
        new = [of_job for of_job in jobs if not folder.has(of_job)]
        if new:
            folder.log_command(rows, new, comparisons)
        remember(out, uri, experiment)
        return len(new)


@dataclass(frozen=True)
class _Folder:
    """A results folder that is logged in an experiment of mlflow."""

    client: MlflowClient
    experiment: str
    out: Path

    def has(self, rows: DataFrame) -> bool:
        """Whether a run of these very rows is whole."""
        return bool(self.client.search_runs([self.experiment], f"tags.rows = '{_hash(rows)}'", max_results=1))

    def log_command(self, rows: DataFrame, new: Sequence[DataFrame], comparisons: Sequence[Comparison]) -> None:
        """The parent run, and a child for each of the new jobs."""
        older = self._latest()
        self.client.set_experiment_tag(self.experiment, VIEW_TAG, view_of(comparisons))
        environment = provenance.read(self.out / "environment.json") or {}
        tags = {
            "jobs": str(len(rows.loc[rows["method"] != "", ["dataset", "method"]].drop_duplicates())),
            "mlflow.source.git.commit": environment.get("git_commit"),
            "command": masked(" ".join(environment.get("command", []))),
            "sucre_bench": environment.get("sucre_bench"),
        }
        note = as_text(comparisons, "md") if (rows["status"] == "ok").any() else ""
        if len(note) >= 7500:
            note = "Too many tables to show here; they are in scores.parquet."
        with self._run(self.out.resolve().name, rows, tags, note) as parent:
            for name in ("config.yaml", "environment.json"):
                if (self.out / name).is_file():
                    self.client.log_artifact(parent, str(self.out / name))
            for name in ("tables", "figures"):
                self._log_folder(parent, self.out / name, name)
            self._mark(parent, older.get(("", ""), []))
            for of_job in new:
                self._log_job(parent, of_job, older)

    def _log_job(self, parent: str, rows: DataFrame, older: Mapping[tuple[str, str], list[str]]) -> None:
        """One dataset and method as a child run: parameters, means and per-view steps, table, restored pictures."""
        dataset, method = rows["dataset"].iloc[0], rows["method"].iloc[0]
        options = json.loads(rows["options"].iloc[-1])
        statuses = set(restoration_rows(rows)["status"])
        tags = {
            "mlflow.parentRunId": parent,
            "mlflow.runColor": style.colour(method),
            "dataset": dataset,
            "method": method,
            "plugin": str(options.get("name", "")),
            "data_id": ",".join(sorted(set(rows["data_id"]) - {""})),
            "code": ",".join(sorted(set(rows["code"].str.split(".").str[0]) - {""})),
            "device": ",".join(sorted(set(rows["device"]) - {""})),
            "status": "failed" if "failed" in statuses else "skipped" if statuses == {"skipped"} else "ok",
        }
        with self._run(f"{method} on {dataset}", rows, tags, _about(options, rows)) as run:
            self._log_values(run, options, rows)
            self._log_folder(
                run, self.out / "restored" / layout.file_name(dataset) / layout.file_name(method), "restored"
            )
            self._log_pictures(run, rows)
            self._mark(run, older.get((dataset, method), []))
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

    def _latest(self) -> dict[tuple[str, str], list[str]]:
        """The newest runs of this folder by dataset and method, both empty for its parent run."""
        found: dict[tuple[str, str], list[str]] = {}
        for run in self.client.search_runs([self.experiment], "tags.latest = 'yes'", max_results=_MOST_RUNS):
            tags = run.data.tags
            if tags.get("out") == str(self.out.resolve()):
                found.setdefault((tags.get("dataset", ""), tags.get("method", "")), []).append(run.info.run_id)
        return found

    def _mark(self, run: str, older: Sequence[str]) -> None:
        """Mark a run as the newest of its dataset and method, and older runs as not."""
        self.client.set_tag(run, "latest", "yes")
        for other in older:
            self.client.set_tag(other, "latest", "no")

    def _log_folder(self, run: str, folder: Path, name: str) -> None:
        if folder.is_dir():
            self.client.log_artifacts(run, str(folder), name)

    def _log_values(self, run: str, options: Mapping[str, Any], rows: DataFrame) -> None:
        """Parameters, means over views, and every view's value as a step, in as few requests as may be."""
        from mlflow.entities import Param

        params = {f"method.{name}": value for name, value in options.items() if name not in (*_GROUPS, "replicate")}
        for group in _GROUPS:
            params |= {f"{group}.{name}": value for name, value in options.get(group, {}).items()}
        replicates = sorted({results.unreplicated(scene)[1] for scene in rows["scene"].unique()})
        if replicates not in ([0], []):
            params["replicates"] = ",".join(map(str, replicates))
        metrics, texts = list(_metrics(rows)), {name: _text(value)[:_LONGEST_PARAM] for name, value in params.items()}
        listed = [Param(name, text) for name, text in texts.items()]
        for start in range(0, len(metrics), 1000):
            self.client.log_batch(run, metrics=metrics[start : start + 1000])
        for start in range(0, len(listed), 100):
            self.client.log_batch(run, params=listed[start : start + 100])

    def _log_pictures(self, run: str, rows: DataFrame) -> None:
        """Small pictures by step, which mlflow's chart view shows side by side for the runs that are selected."""
        from PIL import Image

        steps = _steps(rows)
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


_GROUPS = ("dataset", "degrade")  # of options, beside those of the method


def _metrics(rows: DataFrame) -> Iterator[Metric]:
    """Means over views, each view's value as a step, and how many views ended how."""
    from mlflow.entities import Metric

    ok = rows[(rows["status"] == "ok") & ~rows["region"].str.contains("/", regex=False)]
    ok = ok[ok["value"].notna() & ~ok["value"].isin([float("inf"), float("-inf")])]
    steps = _steps(rows)
    for (metric, variant), scores in ok.groupby(["metric", "variant"], sort=False):
        name, when = f"{metric}.{variant}", _stamp(scores["time"].max())
        by_view = scores.groupby(["scene", "view"])["value"].mean()
        yield Metric(name, float(by_view.mean()), when, 0)
        for view, value in by_view.items():
            yield Metric(f"views/{name}", float(value), when, steps[view])
    views = restoration_rows(rows).drop_duplicates(["scene", "view"])
    for status in ("ok", "failed", "skipped"):
        yield Metric(f"views_{status}", float((views["status"] == status).sum()), _stamp(rows["time"].max()), 0)


def _steps(rows: DataFrame) -> dict[tuple[str, str], int]:
    """Each view's step in mlflow's curves and pictures, in order of name, alike for all methods of a dataset."""
    views = rows[rows["view"] != ""]
    return {view: step for step, view in enumerate(sorted(set(zip(views["scene"], views["view"], strict=True))))}


def _about(options: Mapping[str, Any], rows: DataFrame) -> str:
    """The description of a child run on mlflow's page."""
    views = rows.loc[rows["view"] != "", ["scene", "view"]].drop_duplicates()
    head = f"**{rows['method'].iloc[0]}** on **{rows['dataset'].iloc[0]}**, views: {len(views)}."
    plugin = plugins.usable("method").get(str(options.get("name", "")))
    reasons = rows.loc[rows["status"] == "failed", "reason"].drop_duplicates().head(5)
    parts = [head, *([plugin.summary, plugin.cites] if plugin else []), *(f"failed: `{reason}`" for reason in reasons)]
    return "\n\n".join(part for part in parts if part)


def _text(value: Any) -> str:
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
