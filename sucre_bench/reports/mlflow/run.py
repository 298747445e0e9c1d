"""One run of mlflow: what is logged in it, of rows of the score table."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench.arrays import DataFrame
from sucre_bench.errors import InputError
from sucre_bench.machine.files import regular
from sucre_bench.results.rows import restoration_rows

if TYPE_CHECKING:
    from mlflow import MlflowClient

LONGEST_TAG = 5000
_LONGEST_DIGEST = 36
_MOST_METRICS = 1000  # of one request
_PICTURE_SIZE = (640, 640)

Value = tuple[str, float, int, int]  # name, value, step, and milliseconds since 1970


class Run:
    """A run at work. status: as mlflow has it."""

    def __init__(self, client: MlflowClient, run_id: str) -> None:
        self.id = run_id
        self.status = "RUNNING"
        self._client = client
        self._logged = set[tuple[str, int, int]]()  # name, step and time of each value
        self._has_failed = False

    @classmethod
    def again(cls, client: MlflowClient, known: Any, tags: Mapping[str, str]) -> Run:
        """Return a known run, which goes on with these tags. Its values are not logged again."""
        from mlflow.entities import RunTag

        run = cls(client, known.info.run_id)
        client.update_run(run.id, "RUNNING")
        client.log_batch(run.id, tags=[RunTag(*tag) for tag in tags.items()])
        for name in known.data.metrics:
            points = client.get_metric_history(run.id, name)
            run._logged |= {(name, point.step, point.timestamp) for point in points}
        return run

    def has(self, name: str, step: int, time: int) -> bool:
        """Return whether a value is logged."""
        return (name, step, time) in self._logged

    def close(self, status: str = "") -> None:
        """End it, as failed if one of its rows has. status: another end."""
        status = status or ("FAILED" if self._has_failed else "FINISHED")
        if status != self.status:
            self._client.set_terminated(self.id, status)
        self.status = status

    def tag(self, name: str, value: str) -> None:
        """Set a tag."""
        self._client.set_tag(self.id, name, value[:LONGEST_TAG])

    def log_params(self, params: Mapping[str, str]) -> None:
        """Log parameters."""
        from mlflow.entities import Param

        self._client.log_batch(self.id, params=[Param(*one) for one in params.items()])

    def log_metrics(self, values: Iterable[Value]) -> None:
        """Log the values that are not logged yet."""
        from mlflow.entities import Metric
        from mlflow.utils import chunk_list

        new = [
            Metric(name, value, time, step)
            for name, value, step, time in values
            if not self.has(name, step, time)
        ]
        for some in chunk_list(new, _MOST_METRICS):
            self._client.log_batch(self.id, metrics=some)
            self._logged |= {(one.key, one.step, one.timestamp) for one in some}

    def log_counts(self, rows: DataFrame) -> None:
        """Log how many views ended how."""
        view = ["dataset", "method", "scene", "view"]
        ended = restoration_rows(rows).drop_duplicates(view)["status"]
        for how in ("ok", "failed", "skipped"):
            self._client.log_metric(self.id, f"views_{how}", float((ended == how).sum()))

    def log_status(self, rows: DataFrame) -> None:
        """Tag it with its status, and with the first reason of a fault if there is one."""
        reasons = rows.loc[rows["status"] == "failed", "reason"]
        if len(reasons):
            self._has_failed = True
            self.tag("reason", str(reasons.iloc[0]))
        is_ok = (restoration_rows(rows)["status"] == "ok").any()
        ended = "ok" if is_ok else "skipped"
        self.tag("status", "failed" if self._has_failed else ended)

    def log_table(self, table: DataFrame) -> None:
        """Log a table, with the levels of its index as columns, instead of what was logged before."""
        whole = table.reset_index().astype(object)
        text = whole.to_json(orient="split", index=False)
        self._client.log_text(self.id, text, "scores.json")
        shown = [{"path": "scores.json", "type": "table"}]
        self.tag("mlflow.loggedArtifacts", json.dumps(shown))

    def log_data(self, name: str, source: str, data_ids: Collection[str]) -> None:
        """Log a dataset as an input. data_ids: of its scenes; source: its folder, or its name."""
        from mlflow.entities import Dataset, DatasetInput, InputTag

        uri = json.dumps({"uri": source})
        digests = sorted({data_id[:_LONGEST_DIGEST] for data_id in data_ids})
        context = [InputTag("mlflow.data.context", "evaluation")]
        inputs = [DatasetInput(Dataset(name, one, "local", uri), context) for one in digests]
        self._client.log_inputs(self.id, inputs)

    def log_picture(self, path: Path, step: int, time: int) -> None:
        """Log a small picture by step, which mlflow's chart view shows side by side for the runs that are selected."""
        from PIL import Image

        with suppress(OSError, InputError):  # gone, or cut short: the others are shown
            with Image.open(regular(path)) as whole:
                small = whole.convert("RGB")
            small.thumbnail(_PICTURE_SIZE)
            self._client.log_image(
                self.id, small, key="restored", step=step, timestamp=time, synchronous=True
            )

    def log_files(self, path: Path, name: str = "") -> None:
        """Log a file, or a folder by a name, if it is there."""
        if path.is_dir():
            self._client.log_artifacts(self.id, str(path), name or path.name)
        elif path.is_file():
            self._client.log_artifact(self.id, str(path))


def scores_of(rows: DataFrame) -> DataFrame:
    """Return each view's score of each metric: the mean over its regions without patches, and its time."""
    import numpy as np

    is_whole = (rows["view"] != "") & ~rows["region"].str.contains("/", regex=False)
    ok = rows[(rows["status"] == "ok") & is_whole & np.isfinite(rows["value"])]
    named = ok.assign(name=ok["metric"] + "." + ok["variant"])
    keys = ["dataset", "method", "name", "scene", "view"]
    return named.groupby(keys, sort=False, as_index=False).agg({"value": "mean", "time": "max"})


def stamp(time: str) -> int:
    """Return a row's time as mlflow has it: milliseconds since 1970."""
    import pandas as pd

    return int(pd.Timestamp(str(time)).timestamp() * 1000)
