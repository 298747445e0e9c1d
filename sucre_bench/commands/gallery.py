"""`sucre-bench gallery`: published outputs beside the numbers that their publications print."""

from __future__ import annotations

from pathlib import Path

import click

from sucre_bench.commands import shared
from sucre_bench.machine.files import check_results_folder
from sucre_bench.machine.terminal import say


@click.command()
@shared.argument("repositories", metavar="FOLDER")
@shared.argument("out", metavar="OUT")
@shared.option("--only", default="", metavar="A,B", help="These exhibits. Default: all whose repository is in FOLDER.")
def gallery(repositories: Path, out: Path, only: str) -> None:
    """Score published outputs, and print published beside measured numbers.

    \b
    git clone --depth 1 https://github.com/zhoujingchun03/HAAM-GAN clones/HAAM-GAN
    sucre-bench gallery clones/ gallery/
    sucre-bench gallery clones/ gallery/ --only haam_gan,u45

    FOLDER has clones of the repositories, one folder each. A line says how to get those that are not there. OUT becomes
    a results folder with a page. OUT/pictures has the files and the line-up of each exhibit.
    """
    from sucre_bench import compare
    from sucre_bench.engine.run import run
    from sucre_bench.errors import InputError
    from sucre_bench.jobs.words import quoted
    from sucre_bench.machine import progress, terminal
    from sucre_bench.machine.files import check_folder, write_atomically
    from sucre_bench.programs import gallery as program
    from sucre_bench.reports import page
    from sucre_bench.results import published
    from sucre_bench.results.rows import csv_text

    check_folder(repositories, "give the folder that has the clones")
    check_results_folder(out)
    rows, failed = None, False
    for exhibit in program.exhibits(shared.labels_of(only)):
        try:
            with progress.live():
                line_up = program.lay_out(exhibit, repositories, out)
        except InputError as fault:
            say(f"{exhibit.name} is left out: {fault}", "yellow")
            continue
        outcome = run([str(line_up), f"out={quoted(str(out))}", "tracking.uri=off"], multirun=True)
        rows, failed = outcome.rows, failed or bool(outcome.failed)
        for failure in outcome.failed:
            say(f"failed  {failure.where} / {failure.view}: {failure.reason}", "red")
        if outcome.interrupted:
            raise click.Abort
    if rows is None:
        raise InputError("has none of the repositories", repositories, "clone one, for example as the lines above say")
    with progress.live():
        table = program.compared(rows, out)
    path = out / published.FILE
    write_atomically(path, csv_text(table).encode())
    heads = ("exhibit", "row", "score", "published", "measured", "difference", "views")
    shown = terminal.table(heads[:3], heads[3:])
    lines = table.to_dict("records")
    for line in lines:
        shown.add_row(*(str(line[head]) for head in heads), style="green" if line["difference"] == "equal" else "")
    terminal.out.print(shown)
    for line in lines:
        said = "; ".join(filter(None, [line["form"], line["reason"]]))
        if said and line["published"]:
            shared.echo_wrapped(f"{line['exhibit']} {line['row']} {line['score']}: {said}")
    click.echo(f"table    {path}")
    click.echo(f"page     {page.write(out, rows, compare.compare(rows))}")
    if failed:
        raise SystemExit(1)
