"""The command line. Everything heavy is imported by the command that needs it: help and lists answer at once."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import sucre_bench
from sucre_bench.charting.command import charts
from sucre_bench.describe.command import describe
from sucre_bench.errors import OutputError, SucreBenchError, one_line
from sucre_bench.kit.command import check, new
from sucre_bench.prepare.command import prepare
from sucre_bench.texture.command import texture
from sucre_bench.video.command import video

if TYPE_CHECKING:
    import pandas as pd

    from sucre_bench.sweep import Fault, Outcome

__all__ = ["cli", "main"]


def main() -> None:
    """Run the command line; an expected fault is one line on stderr and exit code 2."""
    try:
        cli(standalone_mode=False)
    except click.exceptions.Abort:
        sys.exit(130)
    except click.exceptions.NoArgsIsHelpError as fault:
        click.echo(fault.format_message())
    except click.ClickException as fault:
        _say(f"error: {fault.format_message()}", "red", err=True)
        sys.exit(fault.exit_code)
    except click.exceptions.Exit as ended:
        sys.exit(ended.exit_code)
    except SucreBenchError as fault:
        for line in str(fault).splitlines():
            _say(f"error: {line}", "red", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)


def _say(text: str, colour: str, err: bool = False) -> None:
    """Print a line in colour, where colours are wanted and seen."""
    from rich.text import Text

    from sucre_bench import console

    (console.err if err else console.out).print(Text(text, style=colour), soft_wrap=True)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(sucre_bench.__version__, prog_name="sucre-bench")
def cli() -> None:
    """Compare methods that restore the colours of underwater images.

    \b
    sucre-bench run dataset=demo method=gray_world
    sucre-bench prepare photos/ dive/
    sucre-bench describe colmap dataset.root=dive/
    sucre-bench run -m dataset=colmap dataset.root=dive/ method=underwater,sucre out=results
    sucre-bench compare results
    sucre-bench score restored/ --reference truth/
    """


@cli.command(context_settings={"ignore_unknown_options": True})
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
@click.option("-m", "--multirun", is_flag=True, help="Run every combination of comma-separated values.")
@click.option("--plugin", "plugin_files", multiple=True, metavar="FILE", help="A .py file with plugins of your own.")
@click.option("--cfg", is_flag=True, help="Print the configuration and stop.")
def run(overrides: tuple[str, ...], multirun: bool, plugin_files: tuple[str, ...], cfg: bool) -> None:
    """Restore views of a dataset with a method, and score them.

    \b
    sucre-bench run dataset=colmap dataset.root=DIR method=sucre views=[a.png] out=DIR
    sucre-bench run -m method=underwater,gray_world,stitching,sucre every=4
    sucre-bench run -m method=sucre method.pairing=mutual,depth hydra/launcher=joblib

    Overrides are Hydra's, key=value. dataset=, method=, metrics=[a,b] choose plugins (`sucre-bench list`); their
    options follow a dot. Also: out=FOLDER, views=[NAME,...] or a .txt list, every=N, first=N, seed=N,
    overwrite=missing|always|never, save=display|full, tracking.uri=URI or off, report=false. Any dataset can be made
    worse in a known way: degrade.noise=0.02, degrade.keep=5 and others, see `sucre-bench list degradations`.

    What is done is not done again: the same command goes on where it was stopped.
    """
    from sucre_bench import plugins, sweep

    stray = [word for word in overrides if word.startswith("-")]
    if stray:
        raise click.UsageError(f"no option {stray[0]}; see sucre-bench run --help")
    if cfg:
        from sucre_bench import config

        for file in plugin_files:
            plugins.load_file(file)
        click.echo(config.jobs(overrides, multirun).jobs[0].config, nl=False)
        return
    outcome = sweep.run(overrides, multirun, plugin_files)
    _show_outcome(outcome)
    sweep.track(outcome)
    sys.exit(outcome.exit_code)


def _show_outcome(outcome: Outcome) -> None:
    """Tables, what failed and why, the counts, and where everything is."""
    from sucre_bench import compare, console, report, sweep, tables

    if (outcome.rows["status"] == "ok").any():
        for table in compare.compare(outcome.rows, order=outcome.methods):
            console.out.print(tables.as_table(table, console.out.width))
            for line in tables.verdicts(table):
                click.echo(line)
    for colour, kind, faults in (
        ("red", "failed", (*outcome.failed, *outcome.scores_failed)),
        ("yellow", "skipped", outcome.skipped),
    ):
        for line in _grouped(faults):
            _say(f"{kind}  {line}", colour)
    for line in _not_scored(outcome.rows):
        _say(f"not scored  {line}", "dim")
    if outcome.interrupted:
        click.echo("stopped; the same command goes on from here")
    made = f" ({outcome.cached} cached)" if outcome.cached else ""
    scores = f", {len(outcome.scores_failed)} scores failed" if outcome.scores_failed else ""
    click.echo(f"{outcome.ok} ok{made}, {len(outcome.failed)} failed, {len(outcome.skipped)} skipped{scores}")
    if outcome.failed or outcome.scores_failed:
        click.echo(f"log      {outcome.out / 'logs' / 'failures.log'}")
    click.echo(f"results  {outcome.out}")
    written = sweep.write_study(outcome)
    for note in written.notes:
        _say(note, "yellow")
    for folder, own in itertools.groupby(written.paths, lambda path: path.parent):
        click.echo(f"{folder.name:9}{folder}{os.sep}{{{','.join(sorted(path.name for path in own))}}}")
    if outcome.wants_report and len(outcome.rows):
        click.echo(f"page     {report.write(outcome.out, outcome.rows)}")


def _grouped(faults: Sequence[Fault]) -> Iterator[str]:
    """A line a reason; many views that share one are counted."""
    by_reason: dict[tuple[str, str], list[str]] = {}
    for fault in faults:
        by_reason.setdefault((fault.where, fault.reason), []).append(fault.view)
    for (where, reason), views in by_reason.items():
        which = views[0] if len(views) == 1 else f"{len(views)} views"
        yield f"{where} / {which}: {reason}"


def _not_scored(rows: pd.DataFrame) -> Iterator[str]:
    """A line a reason for the scores that views could not give."""
    skipped = rows[(rows["status"] == "skipped") & (rows["metric"] != "seconds")]
    skipped = skipped[~skipped["reason"].str.startswith("nothing to score")]  # a method without water, say
    why = skipped["reason"].str.split(",").str[0]
    for reason, own in skipped.groupby(why, sort=False):
        views = own[["dataset", "scene", "view"]].drop_duplicates()
        everywhere = rows[rows["view"] != ""][["dataset", "scene", "view"]].drop_duplicates()
        where = "" if len(views) == len(everywhere) else f" in {len(views)} of {len(everywhere)} views"
        yield f"{', '.join(dict.fromkeys(own['metric']))}{where}: {reason}"


@cli.command()
@click.argument("images", type=click.Path(path_type=Path))
@click.option("--reference", type=click.Path(path_type=Path), help="Folder with the same names, or one image.")
@click.option("--metrics", default="", metavar="A,B", help="Names, name:variant or name:all; default all that apply.")
@click.option("--format", "how", type=click.Choice(["terminal", "csv", "json"]), default="terminal", show_default=True)
@click.option("--csv", "file", type=click.Path(path_type=Path), help="Also write every score to this CSV file.")
@click.option("--plugin", "plugin_files", multiple=True, metavar="FILE", help="A .py file with metrics of your own.")
def score(
    images: Path, reference: Path | None, metrics: str, how: str, file: Path | None, plugin_files: tuple[str, ...]
) -> None:
    """Score a folder of images (or one image) with any metric, in any published variant.

    \b
    sucre-bench score restored/
    sucre-bench score restored/ --reference truth/ --metrics psnr,ssim:all
    sucre-bench score restored/ --metrics uciqe:all,uiqm:all --csv scores.csv

    A folder knows no holes: what is black counts as picture. `sucre-bench run` scores only pixels that have a colour.
    """
    from sucre_bench import console, plugins, results, scoring

    for plugin in plugin_files:
        plugins.load_file(plugin)
    with console.live():
        rows = scoring.score_folder(images, reference, [m.strip() for m in metrics.split(",") if m.strip()])
    if file:
        results.write_atomically(file, rows.to_csv(index=False).encode())
    if how == "csv":
        click.echo(rows.to_csv(index=False), nl=False)
    elif how == "json":
        click.echo(rows.to_json(orient="records", indent=1))
    else:
        console.out.print(scoring.summary(rows))
    faults = rows[rows["status"] != "ok"]
    asked = faults if metrics else faults[faults["status"] == "failed"]  # unasked, what does not apply is no fault
    for (view, metric, reason), _ in asked.groupby(["view", "metric", "reason"], sort=False):
        _say(f"failed  {view}: {f'{metric}: ' if metric != 'seconds' else ''}{reason}", "red", err=True)
    sys.exit(1 if len(asked) else 0)


@cli.command("list")
@click.argument("what", type=click.Choice(["methods", "datasets", "metrics", "experiments", "degradations"]))
@click.option("--json", "as_json", is_flag=True, help="For programs.")
@click.option("--plugin", "plugin_files", multiple=True, metavar="FILE", help="A .py file with plugins of your own.")
def list_(what: str, as_json: bool, plugin_files: tuple[str, ...]) -> None:
    """List what there is, what it needs, and whether it is installed."""
    from sucre_bench import listing, plugins

    for file in plugin_files:
        plugins.load_file(file)
    click.echo(
        listing.as_json(what)
        if as_json
        else listing.as_text(what, colour=sys.stdout.isatty() and "NO_COLOR" not in os.environ)
    )


@cli.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--by", type=click.Choice(["method", "view", "region"]), default="method", show_default=True)
@click.option("--metric", "metrics", multiple=True, metavar="NAME[:VARIANT]", help="Only these; may be repeated.")
@click.option("--baseline", default="", metavar="METHOD", help="Show how the others differ from this one.")
@click.option("--common", is_flag=True, help="Where methods ran on different images, compare on those they share.")
@click.option("--spread", is_flag=True, help="Show standard deviations too.")
@click.option(
    "--format",
    "how",
    type=click.Choice(["terminal", "md", "latex", "html", "csv", "json"]),
    default="terminal",
    show_default=True,
)
def compare(
    folders: Sequence[Path], by: Any, metrics: Sequence[str], baseline: str, common: bool, spread: bool, how: Any
) -> None:
    """One table over one or more output folders, with 95 % intervals.

    \b
    sucre-bench compare results
    sucre-bench compare results --baseline sucre_paper --metric psnr --metric psi
    sucre-bench compare monday/ tuesday/ --metric psi --by region --format latex

    Methods are compared on the same images only. What cannot stand side by side is refused, with the difference said.
    """
    from sucre_bench import compare, console, tables

    rows = compare.load(folders)
    compare.refuse(rows, metrics, common)
    compared = compare.compare(rows, metrics, by, baseline=baseline)
    if how != "terminal":
        click.echo(tables.as_text(compared, how, spread), nl=False)
        return
    for table in compared:
        console.out.print(tables.as_table(table, console.out.width, spread))
        for line in tables.verdicts(table):
            click.echo(line)


@cli.command("report")
@click.argument("folder", type=click.Path(path_type=Path))
def report_(folder: Path) -> None:
    """Write FOLDER/report/index.html, a page that opens from disk."""
    from sucre_bench import report, results

    click.echo(report.write(folder, results.read(folder)))


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--uri", default="", metavar="URI", help="mlflow's tracking URI; default: a store in FOLDER.")
@click.option("--experiment", default="sucre_bench", show_default=True, help="mlflow's experiment.")
@click.option("--ui", is_flag=True, help="Then open mlflow's page on this machine, until Ctrl-C.")
@click.option("--port", default=5000, show_default=True, help="Of that page.")
def track(folder: Path, uri: str, experiment: str, ui: bool, port: int) -> None:
    """Tell mlflow what FOLDER holds: after a run on a cluster, or one that was stopped.

    \b
    sucre-bench track results --uri http://127.0.0.1:5000
    sucre-bench track results --ui

    What mlflow has been told before is not told again.
    """
    from sucre_bench import results, tracking

    uri = uri or tracking.default_uri(folder)
    try:
        new = tracking.log(folder, results.read(folder), uri, experiment)
    except SucreBenchError:
        raise
    except Exception as fault:
        raise OutputError(f"{uri}: mlflow cannot be told, {one_line(fault)}; check the URI") from fault
    click.echo(f"mlflow   {uri}, experiment {experiment}: {new} new run{'' if new == 1 else 's'}")
    if ui:
        click.echo(f"page     http://127.0.0.1:{port}")
        sys.exit(tracking.open_ui(uri, port))


@cli.command()
def doctor() -> None:
    """Say what is installed, what is missing, and what that disables."""
    from sucre_bench import doctor

    sys.exit(doctor.show())


for command in (prepare, charts, describe, texture, video, new, check):
    cli.add_command(command)
