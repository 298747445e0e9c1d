"""The tables of `sucre-bench score`: means over the images, and the variants that give published numbers."""

from collections.abc import Sequence
from dataclasses import asdict

import click
import pandas as pd
from rich.table import Table

from sucre_bench.commands.shared_options import print_json
from sucre_bench.compare.numbers import number, standard_deviation
from sucre_bench.compare.words import ARROW
from sucre_bench.machine import terminal
from sucre_bench.programs.match_published import Candidate, Column, PublishedTable, compare
from sucre_bench.results.rows import csv_text


def summary(rows: pd.DataFrame) -> Table:
    """A line a metric and variant, for the terminal: mean, spread and extremes over the images."""
    table = terminal.table(["metric", "variant"], ["mean", "std", "lowest", "highest", "images"])
    ok = rows[rows["status"] == "ok"]
    for (metric, variant), scores in ok.groupby(["metric", "variant"], sort=False):
        values = scores["value"]
        title = f"{metric} {ARROW[scores['better'].iloc[0]]}"
        figures = (values.mean(), float(standard_deviation(values.to_numpy())), values.min(), values.max())
        table.add_row(title, variant, *(number(x) for x in figures), str(len(values)))
    return table


def print_records(table: pd.DataFrame, form: str) -> None:
    """Print a table as "json" or "csv"."""
    if form == "json":
        print_json(table.to_dict("records"))
    else:
        click.echo(csv_text(table), nl=False)


def print_matches(published: PublishedTable, rows: pd.DataFrame, form: str) -> None:
    """Print, for each column of a published table, how far the variants are from it."""
    matches = [(column, compare(column, rows)) for column in published.columns]
    if form != "terminal":
        table = pd.DataFrame(
            {"column": column.header, "metric": column.metric, **asdict(one)}
            for column, found in matches
            for one in found
        )
        print_records(table, form)
        return
    for column, found in matches:
        terminal.out.print(_table(column, found))
        terminal.out.print()
    for column, found in matches:
        terminal.out.print(_verdict(column, found), soft_wrap=True, highlight=False)


def _table(column: Column, candidates: Sequence[Candidate], most: int = 10) -> Table:
    """Return the nearest variants of a column, a line each."""
    table = terminal.table([column.metric], ["mean difference", "largest"])
    table.add_column("at", no_wrap=True)
    table.add_column("compared", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for one in candidates[:most]:
        note = f"no score of {one.lacking}" if one.lacking else ""
        figures = (f"{one.mean:.2g}", f"{one.largest:.2g}", one.at, str(one.compared), note)
        table.add_row(one.variant, *figures, style="green" if one.fits else None)
    return table


def _verdict(column: Column, candidates: Sequence[Candidate]) -> str:
    """Return which variants give a column's numbers, as a sentence."""
    about = f"{column.metric}: column '{column.header}'"
    if fitting := [one for one in candidates if one.fits]:
        names = " or ".join(one.variant for one in fitting[:4]) + (" or others" if len(fitting) > 4 else "")
        return f"{about} is {names}, within {fitting[0].largest:.2g}"
    if not candidates:
        return f"{about}: no variant has a score of these images"
    nearest = candidates[0]
    off = f"differs by {nearest.mean:.2g} on average and by up to {nearest.largest:.2g}"
    return f"{about} is none of the public variants; the nearest, {nearest.variant}, {off}"
