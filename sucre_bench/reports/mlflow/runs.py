"""Writes a results folder as runs of mlflow."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Comparison
from sucre_bench.compare.documents import as_text
from sucre_bench.errors import InputError
from sucre_bench.machine import provenance
from sucre_bench.machine.files import regular
from sucre_bench.machine.records import masked
from sucre_bench.machine.text_formats import counted
from sucre_bench.reports.mlflow.already_logged import remember
from sucre_bench.reports.mlflow.connection import connect, said_of
from sucre_bench.reports.mlflow.experiment import Experiment, rows_hash, stamp
from sucre_bench.reports.mlflow.page import VIEW_TAG, view_of
from sucre_bench.reports.paper.figures import style
from sucre_bench.results import layout
from sucre_bench.results.layout import file_name
from sucre_bench.results.rows import restoration_rows, restorations

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import DatasetInput, LoggedModel, Metric

_LONGEST_PARAM = 6000
_MOST_PICTURES = 40  # of a run, evenly chosen; all whole pictures are among its artifacts
_PICTURE_SIZE = (640, 640)


def log(out: Path, rows: DataFrame, comparisons: Sequence[Comparison], uri: str, experiment: str) -> int:
    """Log a results folder in mlflow: its rows, their comparisons, and its files. Return how many child runs are new.

    Child runs whose rows are logged already stay as they are. Raises InputError for a path that mlflow cannot take,
    OutputError where mlflow fails.
    """
    with said_of(uri):
        return _log(out, rows, comparisons, uri, experiment)


def _log(out: Path, rows: DataFrame, comparisons: Sequence[Comparison], uri: str, experiment: str) -> int:
    client, experiment_id = connect(uri, experiment)
    store = Experiment(client, experiment_id, out)
    store.end_abandoned()
    named = rows[rows["method"] != ""]
    jobs = [(str(d), str(m), of_job) for (d, m), of_job in named.groupby(["dataset", "method"], sort=False)]
    new = [job for job in jobs if not store.has(job[2])]
    if not new:
        remember(out, uri, experiment)
        return 0
    older = store.latest()
    client.set_experiment_tag(experiment_id, VIEW_TAG, view_of(comparisons))
    with store.run(out.resolve().name, rows, {"jobs": str(len(jobs)), **_source(out)}) as parent:
        client.set_tag(parent, "mlflow.note.content", _note(rows, comparisons))
        store.log_table(parent, rows)
        for name in ("config.yaml", "environment.json"):
            if (out / name).is_file():
                client.log_artifact(parent, str(out / name))
        for folder in ("tables", "figures"):
            if (out / folder).is_dir():
                client.log_artifacts(parent, str(out / folder), folder)
        store.succeed(parent, older.get(("", ""), []))
        for dataset, method, of_job in new:
            _log_job(store, parent, dataset, method, of_job, older.get((dataset, method), []))
    remember(out, uri, experiment)
    return len(new)


def _log_job(store: Experiment, parent: str, dataset: str, method: str, rows: DataFrame, older: Iterable[str]) -> None:
    """One dataset and method as a child run: parameters, means and per-view steps, table, restored pictures."""
    from mlflow.entities import LoggedModelOutput

    client, options = store.client, json.loads(rows["options"].iloc[-1])
    tags = {
        "mlflow.parentRunId": parent,
        "mlflow.runColor": style.colour(method),
        "dataset": dataset,
        "method": method,
        "plugin": str(options.get("name", "")),
        "data_id": ",".join(sorted(set(rows["data_id"]) - {""})),
        "code": ",".join(sorted(set(rows["code"].str.split(".").str[0]) - {""})),
        "device": ",".join(sorted(set(rows["device"]) - {""})),
        "status": _status(rows),
    }
    with store.run(f"{method} on {dataset}", rows, tags) as run:
        client.set_tag(run, "mlflow.note.content", _about(options, dataset, method, rows))
        params = dict(_params(options)) | _replicates(rows)
        data = _dataset(options, dataset, tags["data_id"])
        client.log_inputs(run, [data])
        model = _model(store, run, method, params, tags)
        _log_values(client, run, rows, params, model, data)
        client.log_outputs(run, [LoggedModelOutput(model.model_id, 0)])
        client.finalize_logged_model(model.model_id, "FAILED" if tags["status"] == "failed" else "READY")
        store.log_table(run, rows)
        pictures = store.out / "restored" / file_name(dataset) / file_name(method)
        if pictures.is_dir():
            store.log_folder(run, pictures, "restored")
        _log_pictures(store, run, rows)
        store.succeed(run, older)
        client.set_tag(run, "rows", rows_hash(rows))  # last: a run that was cut off before is not taken for whole


def _dataset(options: Mapping[str, Any], label: str, data_id: str) -> DatasetInput:
    from mlflow.entities import Dataset, DatasetInput, InputTag

    about = {"dataset": options.get("dataset", {}), "degrade": options.get("degrade", {})}
    text = json.dumps(about, default=str)
    digest = data_id if len(data_id) <= 36 else hashlib.blake2b(data_id.encode(), digest_size=6).hexdigest()
    dataset = Dataset(
        label[:500], digest or "unknown", "local", str(about["dataset"].get("root") or label), profile=text
    )
    return DatasetInput(dataset, [InputTag("mlflow.data.context", "evaluation")])


def _model(store: Experiment, run: str, method: str, params: Mapping[str, Any], tags: Mapping[str, str]) -> LoggedModel:
    """The method as mlflow's models page shows it, with its options."""
    options = {
        name.removeprefix("method."): _text(value) for name, value in params.items() if name.startswith("method.")
    }
    name = file_name(method).replace(".", "_").replace("%", "_")
    about = {key: tags[key] for key in ("dataset", "method", "plugin", "code")}
    return store.client.create_logged_model(store.experiment, name, run, about, options, "restorer")


def _replicates(rows: DataFrame) -> dict[str, str]:
    """Which repetitions a run holds, where there are several."""
    numbers = sorted({results.unreplicated(scene)[1] for scene in rows["scene"].unique()})
    return {"replicates": ",".join(map(str, numbers))} if numbers not in ([0], []) else {}


def _params(options: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Every option of method, dataset and degradation by the name the command line has for it."""
    groups = ("dataset", "degrade")
    for name, value in options.items():
        if name not in (*groups, "replicate"):
            yield f"method.{name}", value
    for group in groups:
        yield from ((f"{group}.{name}", value) for name, value in options.get(group, {}).items())


def _log_values(
    client: MlflowClient,
    run: str,
    rows: DataFrame,
    params: Mapping[str, Any],
    model: LoggedModel,
    data: DatasetInput,
) -> None:
    """Parameters, means over views, and every view's value as a step, in as few requests as may be."""
    from mlflow.entities import Param

    metrics = list(_metrics(rows, model.model_id, data))
    listed = [Param(name, _text(value)[:_LONGEST_PARAM]) for name, value in params.items()]
    for start in range(0, len(metrics), 1000):
        client.log_batch(run, metrics=metrics[start : start + 1000])
    for start in range(0, len(listed), 100):
        client.log_batch(run, params=listed[start : start + 100])


def _metrics(rows: DataFrame, model: str, data: DatasetInput) -> Iterator[Metric]:
    from mlflow.entities import Metric

    ok = rows[(rows["status"] == "ok") & ~rows["region"].str.contains("/", regex=False)]
    ok = ok[ok["value"].notna() & ~ok["value"].isin([float("inf"), float("-inf")])]
    steps = _steps(rows)
    for (metric, variant), scores in ok.groupby(["metric", "variant"], sort=False):
        name, when = f"{metric}.{variant}", stamp(scores["time"].max())
        by_view = scores.groupby(["scene", "view"])["value"].mean()
        yield Metric(name, float(by_view.mean()), when, 0, model, data.dataset.name, data.dataset.digest)
        for view, value in by_view.items():
            yield Metric(f"views/{name}", float(value), when, steps[view])

    views = restoration_rows(rows).drop_duplicates(["scene", "view"])
    for status in ("ok", "failed", "skipped"):
        yield Metric(f"views_{status}", float((views["status"] == status).sum()), stamp(rows["time"].max()), 0)


def _steps(rows: DataFrame) -> dict[tuple[str, str], int]:
    """Each view's step in mlflow's curves and pictures, in order of name, alike for all methods of a dataset."""
    views = rows[rows["view"] != ""]
    return {view: step for step, view in enumerate(sorted(set(zip(views["scene"], views["view"], strict=True))))}


def _log_pictures(store: Experiment, run: str, rows: DataFrame) -> None:
    """Small pictures by step, which mlflow's chart view shows side by side for the runs that are selected."""
    from PIL import Image

    steps = _steps(rows)
    every = -(-len(steps) // _MOST_PICTURES)
    for row in restorations(rows).itertuples():
        step = steps[str(row.scene), str(row.view)]
        place = layout.find(row.dataset, row.scene, row.view, store.out) if step % every == 0 else None
        if place is None:
            continue
        try:
            with Image.open(regular(place.restored(store.out, row.method))) as whole:
                small = whole.convert("RGB")
        except (OSError, InputError):  # gone, or cut short: the others are shown
            continue
        small.thumbnail(_PICTURE_SIZE)
        store.client.log_image(run, small, key="restored", step=step, timestamp=stamp(str(row.time)), synchronous=True)


def _status(rows: DataFrame) -> str:
    statuses = set(restoration_rows(rows)["status"])
    return "failed" if "failed" in statuses else "skipped" if statuses == {"skipped"} else "ok"


def _about(options: Mapping[str, Any], dataset: str, method: str, rows: DataFrame) -> str:
    """The description of a child run on mlflow's page."""
    views = rows.loc[rows["view"] != "", ["scene", "view"]].drop_duplicates()
    head = f"**{method}** on **{dataset}**, {counted(len(views), 'view')}."
    plugin = plugins.usable("method").get(str(options.get("name", "")))
    plugin_text = [plugin.summary, plugin.cites] if plugin else []
    reasons = rows.loc[rows["status"] == "failed", "reason"].drop_duplicates().head(5)
    faults = [f"failed: `{reason}`" for reason in reasons]
    return "\n\n".join(part for part in (head, *plugin_text, *faults) if part)


def _source(out: Path) -> dict[str, str]:
    """Commit and command, as mlflow's page shows them."""
    environment = provenance.read(out / "environment.json") or {}
    tags = {
        "mlflow.source.git.commit": environment.get("git_commit"),
        "command": masked(" ".join(environment.get("command", []))),
        "sucre_bench": environment.get("sucre_bench"),
    }
    return {name: str(value)[:5000] for name, value in tags.items() if value}


def _note(rows: DataFrame, comparisons: Sequence[Comparison]) -> str:
    """The tables, which mlflow's page renders as the run's description."""
    ok = rows[rows["status"] == "ok"]
    text = as_text(comparisons, "md") if len(ok) else ""
    return text if len(text) < 7500 else "Too many tables to show here; they are in scores.parquet."


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)
