"""The rows of a study, with its comparisons: each is computed once, for all tables and figures."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import By, Comparison, against, compare, only
from sucre_bench.compare.compare_rows import asked_for
from sucre_bench.jobs.run_options import Study
from sucre_bench.reports.paper.follow_option import Along, along


@dataclass(frozen=True)
class StudyResults:
    """What tables and figures are made of.

    rows: in the order that methods are to have; out: the results folder; made: comparisons of these rows by all
    metrics, if there are some already.
    """

    study: Study
    rows: DataFrame
    out: Path
    made: tuple[Comparison, ...] = ()

    @cached_property
    def comparisons(self) -> list[Comparison]:
        """A table for each dataset: methods by the study's metrics."""
        if not self.made:
            return self._compare("method")
        scored = set(self.rows.loc[asked_for(self.rows, self.study.metrics), "dataset"])
        return [only(table, self.study.metrics) for table in self.made if table.title in scored]

    @cached_property
    def with_baseline(self) -> list[Comparison]:
        """The same tables against the study's baseline; `comparisons` if it has none."""
        name = self.study.baseline
        return [against(table, name) if name in table.methods else table for table in self.comparisons]

    @cached_property
    def parts(self) -> list[Comparison]:
        """A table for each view or region, if the study asks for them."""
        return self._compare(self.study.by) if self.study.by != "method" else []

    @cached_property
    def followed(self) -> list[Along]:
        """The scores along the study's option. Raises NotApplicableError if no row has a value of it."""
        return along(self.rows, self.study)

    def _compare(self, by: By) -> list[Comparison]:
        order: Sequence[str] = list(dict.fromkeys(self.rows["method"]))
        return [only(table, self.study.metrics) for table in compare(self.rows, self.study.metrics, by, order)]
