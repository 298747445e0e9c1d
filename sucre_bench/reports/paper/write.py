"""A study's files: ``tables/NAME.{md,tex,csv}`` and ``figures/NAME-FIGURE[-SUFFIX].{png,pdf}``."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench.compare import text as tables
from sucre_bench.errors import ANY_FAULT, InputError, NotApplicableError, OutputError, one_line
from sucre_bench.jobs.study import Study
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.log import keep_traceback
from sucre_bench.reports.paper import figures
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.follow_option import along, records
from sucre_bench.reports.paper.ordering import compared
from sucre_bench.results.layout import file_name, log_path

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Written", "write"]


@dataclass(frozen=True)
class Written:
    """What a study came to: its files, and what there is to say of it, such as why a figure could not be drawn."""

    paths: tuple[Path, ...]
    notes: tuple[str, ...]


def write(
    study: Study, rows: pd.DataFrame, out: Path, methods: Sequence[str] = (), datasets: Sequence[str] = ()
) -> Written:
    """Write a study's tables and figures under `out`.

    rows: of the study's methods and datasets alone, as `results.read` returns them; methods, datasets: labels in the
    order that tables and figures have them, default as they were first run. What cannot be made is a note, and costs
    nothing else. Raises OutputError where files cannot be written.
    """
    notes: list[str] = []
    rows = _in_order(rows, methods, datasets)
    if not (rows["status"] == "ok").any():
        return _nothing(study, out, "nothing was restored, so there is nothing to show")
    named, study = study.metrics, _applicable(study, rows, notes)
    paths: list[Path] = []
    try:
        if named and not study.metrics:
            raise NotApplicableError("nothing that it asks for was scored")
        for suffix, text in _tables(study, rows):
            path = out / "tables" / f"{study.name}.{suffix}"
            write_atomically(path, text.encode())
            paths.append(path)
    except OutputError:
        raise
    except (NotApplicableError, InputError) as reason:
        _clear_tables(study, out)
        notes.append(f"{study.name}: no tables, {one_line(reason)}")
    except ANY_FAULT as fault:
        keep_traceback(log_path(out), f"{study.name}, its tables")
        notes.append(f"{study.name}: its tables failed, {one_line(fault)}; the traceback is in {log_path(out)}")
    for name in study.figures:
        paths += _figures(name, study, rows, out, notes)
    return Written(tuple(paths), tuple(notes))


def _nothing(study: Study, out: Path, why: str) -> Written:
    """Say why there is nothing, and leave no tables and figures of an earlier time that would say otherwise."""
    _clear_tables(study, out)
    for name in study.figures:
        _clear(out, f"{study.name}-{name}", ())
    return Written((), (f"{study.name}: {why}",))


def _clear_tables(study: Study, out: Path) -> None:
    for path in (out / "tables").glob(f"{study.name}.*"):
        path.unlink()


def _clear(out: Path, whole: str, written: Collection[Path]) -> None:
    """Remove a figure's files but those that were written now."""
    for old in {*(out / "figures").glob(f"{whole}.*"), *(out / "figures").glob(f"{whole}-*")} - {*written}:
        old.unlink()


def _in_order(rows: pd.DataFrame, methods: Sequence[str], datasets: Sequence[str]) -> pd.DataFrame:
    """Rows so that what comes first is first named."""
    by_time = rows.sort_values("time", kind="stable")
    for column, given in (("method", methods), ("dataset", datasets)):
        order = {label: n for n, label in enumerate(dict.fromkeys([*given, *by_time[column]]))}
        by_time = by_time.assign(**{f"_{column}": by_time[column].map(order)})
    ordered = by_time.sort_values(["_dataset", "_method"], kind="stable")
    return ordered.drop(columns=["_dataset", "_method"]).reset_index(drop=True)


def _applicable(study: Study, rows: pd.DataFrame, notes: list[str]) -> Study:
    """The study without metrics that nothing was scored by, and without a baseline that did not run."""
    scored = rows[rows["status"] == "ok"]
    known = {*scored["metric"], *(scored["metric"] + ":" + scored["variant"])}
    absent = [metric for metric in study.metrics if metric not in known]
    if absent:
        notes.append(f"{study.name}: no scores of {', '.join(absent)}, left out")
        study = replace(study, metrics=tuple(metric for metric in study.metrics if metric in known))
    if study.baseline and study.baseline not in set(rows["method"]):
        notes.append(f"{study.name}: the baseline {study.baseline} did not run; study.baseline=METHOD names another")
        study = replace(study, baseline="")
    return study


def _tables(study: Study, rows: pd.DataFrame) -> Iterator[tuple[str, str]]:
    """Yield each format's suffix and text."""
    import pandas as pd

    if study.along:
        followed = along(rows, study)
        shown = [table for one in followed for table in one.comparisons]
        said = ""  # tables against a baseline say it
        csv = str(pd.DataFrame([record for one in followed for record in records(one)]).to_csv(index=False))
    else:
        shown = compared(rows, replace(study, baseline=""))
        said = "".join(f"- {line}\n" for table in shown for line in tables.verdicts(table))
        against = compared(rows, study) if study.baseline else shown
        each = compared(rows, replace(study, baseline=""), study.by) if study.by != "method" else []
        csv = tables.as_text([*against, *each], "csv", study.spread)
        if study.baseline:
            titled = [replace(table, title=f"{table.title}, against {study.baseline}") for table in against]
            shown = [*itertools.chain(*zip(shown, titled, strict=True))]
        shown += each
    yield "md", tables.as_text(shown, "md", study.spread) + (f"\n{said}" if said else "")
    yield "tex", tables.as_text(shown, "latex", study.spread)
    yield "csv", csv


def _figures(name: str, study: Study, rows: pd.DataFrame, out: Path, notes: list[str]) -> list[Path]:
    """Draw one figure, in as many files as it has pages; those of a time when it had more are cleared away."""
    whole, written = f"{study.name}-{name}", list[Path]()
    try:
        with style.look():
            for suffix, figure in figures.find(name)(rows, study, out):
                if isinstance(figure, NotApplicableError):
                    notes.append(f"{whole}: not drawn, {one_line(figure)}")
                    continue
                stem = "-".join(filter(None, [whole, file_name(suffix) if suffix else ""]))
                written += style.save(figure, out / "figures" / stem, study.svg)
    except OutputError:
        raise
    except NotApplicableError as reason:
        notes.append(f"{whole}: not drawn, {one_line(reason)}")
    except ANY_FAULT as fault:
        keep_traceback(log_path(out), whole)
        notes.append(f"{whole}: failed, {one_line(fault)}; the traceback is in {log_path(out)}")
        return written
    _clear(out, whole, written)
    return written
