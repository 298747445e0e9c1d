"""`sucre-bench run` and `lineup`: restore a dataset with methods, and write what made a results folder.

`engine.run.run` does the work; --cfg and --dry-run stop before it.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sucre_bench.commands import completion, shared
from sucre_bench.machine.files import check_output, write_atomically
from sucre_bench.machine.terminal import say

if TYPE_CHECKING:
    from sucre_bench.engine.preflight import Planned


@click.command()
@shared.words_argument("overrides", "[LINE-UP.yaml] [KEY=VALUE]...", completion.complete_words)
@shared.flag("-m", "--multirun", help="Run every combination of comma-separated values.")
@shared.plugin_files_option
@shared.flag("--cfg", help="Print the configuration of all jobs and stop.")
@shared.flag("--dry-run", help="Print jobs, views, and the expected time, and stop.")
@shared.json_option
def run(
    overrides: tuple[str, ...], multirun: bool, plugin_files: tuple[str, ...], cfg: bool, dry_run: bool, as_json: bool
) -> None:
    """Restore views of a dataset with a method, and score them.

    \b
    sucre-bench run dataset=demo method=gray_world
    sucre-bench run dataset=./dive method=sucre_plus method.fill=true
    sucre-bench run -m method=underwater,gray_world,sucre every=4 out=results
    sucre-bench run -m method.pairing=mutual,depth workers=2
    sucre-bench run -m method=sucre,onnx sucre.physical=true onnx.model=net.onnx
    sucre-bench run lineup.yaml out=results
    sucre-bench run experiment=table1
    sucre-bench run --dry-run -m method=gray_world,sucre
    sucre-bench run --json dataset=demo method=gray_world | jq .table

    Every word is key=value. dataset=, method= and metrics=[a,b] choose plugins (`sucre-bench list`). An option of a
    plugin follows a dot: method.pairing=depth. With -m, the command runs every combination of the values with commas
    between them. An option after a method's name is for that method alone. A line-up is a file with all of this; a word
    of the command replaces the same key of the file.

    \b
    out=FOLDER              write results there; the same folder again adds to it
    views=[NAME,...]        only these views; views=list.txt: one name a line
    every=N first=N         every Nth view; the first N views
    metrics=[psnr,psi]      only these metrics; uciqe:all: every variant of one
    dataset=./FOLDER        find out which dataset the folder is
    baseline=LABEL          show the differences from this method
    degrade.noise=0.02      make the data worse: `sucre-bench list degradations`
    save=full               also write J, B, beta, gamma (.npz), for later metrics
    overwrite=always        restore finished views again; never: only new views
    overwrite=failed        also try views again at which the process died
    view_timeout_s=60       a view that takes longer has failed; null: no limit
    workers=4               4 views at once; 0: all in this process, to debug
    seed=N                  other random draws
    report=false            write no page
    tracking.uri=off        no mlflow; tracking.uri=URI: another mlflow

    If you stop a run, the same command continues. It does not restore finished views again.

    Exit codes: 0, everything finished (skipped views are allowed); 1, a view or a score failed, or nothing was restored
    or scored; 2, the command has a mistake; 130, stopped by Ctrl-C.
    """
    from sucre_bench.jobs.words import value_of
    from sucre_bench.machine.provenance import absent

    if plugin_files:
        overrides = (*overrides, f"plugins={value_of([str(Path(file).resolve()) for file in plugin_files])}")
    if cfg:
        from sucre_bench.jobs.compose_jobs import jobs
        from sucre_bench.jobs.job import config_text

        command = jobs([word for word in overrides if word != "job"], multirun)  # Hydra's own is `--cfg job`
        click.echo(config_text(command.jobs, command.words, command.is_sweep), nl=False)
        return
    if old := absent("numpy", "pandas", "pyarrow", "scipy", "numba"):
        say(f"packages: {old}", "yellow")
    # What a plugin prints is no part of a JSON object.
    printed = contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext()
    if dry_run:
        from sucre_bench.commands import run_forecast
        from sucre_bench.engine.forecast import forecast

        with printed:
            found = forecast(overrides, multirun)
        shared.print_json([asdict(one) for one in found]) if as_json else run_forecast.show(found)
        return
    from sucre_bench.commands import run_summary
    from sucre_bench.engine.run import run as run_jobs

    floor = []

    def before(planned: Sequence[Planned]) -> None:
        shared.say_what_views_show(planned)
        floor.append(shared.floor_of_psi(planned))

    with printed:
        outcome = run_jobs(overrides, multirun, before)
        comparisons = run_summary.compared(outcome)
        summary = run_summary.as_object(outcome, comparisons) if as_json else None
    try:
        if as_json:
            shared.print_json(summary)
        else:
            run_summary.show(outcome, comparisons)
        sys.stdout.flush()
        for note in filter(None, floor):
            say(note, "yellow")
    finally:  # also when whoever reads our output has gone
        if not outcome.interrupted:  # who stops a run wants the shell back; the same command logs all of it
            with contextlib.redirect_stdout(sys.stderr):
                run_summary.track(outcome, comparisons)
    sys.exit(outcome.exit_code)


@click.command()
@shared.argument("folder", metavar="RESULTS")
@shared.option(
    "--out",
    of=click.Path(path_type=Path, allow_dash=True),
    metavar="FILE",
    help="Where to write the line-up; - prints it. [default: RESULTS/lineup.yaml]",
)
@shared.plugin_option
@shared.force_option
def lineup(folder: Path, out: Path | None, force: bool) -> None:
    """Write the line-up of a results folder: one file with its datasets, configurations, metrics and settings.

    \b
    sucre-bench lineup results/
    sucre-bench lineup results/ --out paper.yaml
    sucre-bench run paper.yaml out=again

    The file has every configuration of the score table, with its label and options. Other settings, for example views
    and study, are those of the last command. Paths in the file are relative to its folder.
    """
    from sucre_bench.jobs.job import load_them
    from sucre_bench.jobs.lineup import line_up_of
    from sucre_bench.jobs.words import shell

    file = folder / "lineup.yaml" if out is None else out
    is_printed = str(file) == "-"
    if out is not None and not is_printed:
        check_output(file, "line-up", force=force)
    line_up, notes = line_up_of(folder, Path() if is_printed else file.parent)
    for note in notes:
        say(f"note: {note}", "yellow")
    if remedy := load_them(str(file.parent / path) for path in line_up.settings.get("plugins", [])):
        say(f"note: plugin files that the folder names are not loaded; {remedy}", "yellow")
    text = line_up.as_yaml(
        f"The line-up that made {folder}. To run it: sucre-bench run {'FILE' if is_printed else file.name}"
    )
    if is_printed:
        click.echo(text, nl=False)
        return
    write_atomically(file, text.encode())
    click.echo(f"{file}  run it: {shell(['sucre-bench', 'run', str(file), 'out=again'])}")
