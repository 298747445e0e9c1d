"""Finds views that are done: picture and scores exist, from the same options, data and code."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.score import metric_code, score_code
from sucre_bench.errors import MissingFileError
from sucre_bench.jobs.job import Job
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import are_stored
from sucre_bench.results.rows import Row, tuples


@dataclass(slots=True)
class _Kept:
    """What the table holds of a score."""

    metric: str
    variant: str
    code: str
    status: str
    options_id: str
    data_id: str


_KEPT = tuple(field.name for field in fields(_Kept))


@dataclass(frozen=True)
class Done:
    """What an output folder holds of a job, by the names of scene and view.

    It holds failed views and scores only if the process died at them, because they would end the next process, too.
    metric_codes: the code that the job's scores depend on, see `engine.score.metric_code`.
    """

    job: Job
    kept: dict[tuple[str, str], list[_Kept]]
    metric_codes: tuple[str, ...]
    _by_code: dict[str, frozenset[tuple[str, str, str]]] = field(default_factory=dict)

    @classmethod
    def of(cls, job: Job) -> Done:
        """Read the output folder of a job; one without a table holds nothing."""
        try:
            rows = results.read(job.out, dataset=job.dataset.label, method=job.method.label)
        except MissingFileError:
            rows = results.frame([])
        return cls.among(rows, job)

    @classmethod
    def among(cls, rows: DataFrame, job: Job) -> Done:
        """Pick what a table holds of a job."""
        kept: dict[tuple[str, str], list[_Kept]] = {}
        of_job = rows[(rows["dataset"] == job.dataset.label) & (rows["method"] == job.method.label)]
        is_kept = of_job["status"] != "failed"
        if job.overwrite != "failed":
            died = [text for text in of_job["reason"].unique() if Reason.of(text) is Reason.DIED]
            is_kept |= of_job["reason"].isin(died)
        for scene, view, *about in tuples(of_job[is_kept], "scene", "view", *_KEPT):
            kept.setdefault((scene, view), []).append(_Kept(*about))
        return cls(job, kept, tuple(map(metric_code, job.metrics)))

    def covers(self, base: Row, picture: Path) -> bool:
        """Whether a view needs no work. base: what its rows would say; picture: where its restoration is kept."""
        kept = self.kept.get((base.scene, base.view), [])
        if self.job.overwrite == "always":
            return False
        if self.job.overwrite == "never":
            return bool(kept)
        kept = [k for k in kept if (k.options_id, k.data_id) == (base.options_id, base.data_id)]
        there = {(k.metric, k.variant, k.code) for k in kept}
        whole = (base.metric, base.variant, base.code)
        if any(k.metric == base.metric and k.status != "ok" for k in kept):
            return whole in there
        suffixes = [".png", *([".npz"] if self.job.save == "full" else [])]
        return whole in there and self._wanted(base) <= there and are_stored(picture, suffixes)

    def _wanted(self, base: Row) -> frozenset[tuple[str, str, str]]:
        """The scores, by metric, variant and code, of a view whose rows say `base`: the same for all with its code."""
        if base.code not in self._by_code:
            self._by_code[base.code] = frozenset(
                (metric.plugin.name, variant, score_code(base, code))
                for metric, code in zip(self.job.metrics, self.metric_codes, strict=True)
                if not metric.plugin.is_of_pairs  # these are scored when all views are there
                for variant in metric.variants
            )
        return self._by_code[base.code]
