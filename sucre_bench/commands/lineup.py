"""`sucre-bench lineup`: write the line-up that made a results folder."""

from pathlib import Path

import click

from sucre_bench.commands.output_files import check_output
from sucre_bench.commands.shared_options import plugin_option
from sucre_bench.machine.notices import say


@click.command()
@click.argument("folder", metavar="RESULTS", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, allow_dash=True),
    metavar="FILE",
    help="Where to write the line-up; - prints it. [default: RESULTS/lineup.yaml]",
)
@plugin_option
def lineup(folder: Path, out: Path | None) -> None:
    """Write the line-up of a results folder: one file with its datasets, configurations, metrics and settings.

    \b
    sucre-bench lineup results/
    sucre-bench lineup results/ --out paper.yaml
    sucre-bench run paper.yaml out=again

    The file has every configuration of the score table, with its label and options. Other settings, for example views
    and study, are those of the last command. Paths in the file are relative to its folder.
    """
    from sucre_bench.jobs.lineup_of_results import line_up_of
    from sucre_bench.jobs.rerun import shell
    from sucre_bench.machine.files import write_atomically

    file = folder / "lineup.yaml" if out is None else out
    is_printed = str(file) == "-"
    if not is_printed:
        check_output(file, "line-up")
    found = line_up_of(folder, Path() if is_printed else file.parent)
    for note in found.notes:
        say(f"note: {note}", "yellow")
    text = found.line_up.as_yaml(
        f"The line-up that made {folder}. To run it: sucre-bench run {'FILE' if is_printed else file.name}"
    )
    if is_printed:
        click.echo(text, nl=False)
        return
    write_atomically(file, text.encode())
    click.echo(f"{file}  run it: {shell(['sucre-bench', 'run', str(file), 'out=again'])}")
