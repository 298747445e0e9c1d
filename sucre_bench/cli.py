"""The command line. Everything heavy is imported by the command that needs it: help and lists answer at once."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import shorten
from typing import Any

import click

import sucre_bench
from sucre_bench import completion
from sucre_bench.charting.command import charts
from sucre_bench.describe.command import describe
from sucre_bench.errors import InputError, OutputError, SucreBenchError, one_line
from sucre_bench.kit.command import check, new
from sucre_bench.prepare.command import prepare
from sucre_bench.texture.command import texture
from sucre_bench.video.command import video

__all__ = ["cli", "main"]

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_BROKEN_PIPE = 141  # what a shell says of a process that SIGPIPE ended


def main() -> None:
    """Run the command line and exit: 2 with one line on stderr for an expected fault, 130 after Ctrl-C."""
    completion.install()
    try:
        status = _status()
        sys.stdout.flush()
    except BrokenPipeError:  # who read us (head, say) has enough
        status = _BROKEN_PIPE
        _drop_output()
        with contextlib.suppress(BrokenPipeError):
            sys.stderr.flush()
    except OSError as fault:
        if fault.filename is not None or fault.errno not in _NO_ROOM:
            raise
        _drop_output()
        status = _fault(f"the output cannot be written, {fault.strerror}; send it where there is room", 2)
    sys.exit(status)


def _drop_output() -> None:
    """What is left in the buffer has nowhere to go."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _status() -> int:
    """Run the command line and return its exit code."""
    try:
        cli(standalone_mode=False)
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except click.exceptions.NoArgsIsHelpError as fault:
        click.echo(fault.format_message())
    except click.exceptions.Exit as ended:
        return ended.exit_code
    except click.ClickException as fault:
        return _fault(" ".join(fault.format_message().split()), fault.exit_code)
    except SucreBenchError as fault:
        return _fault(str(fault), 2)
    except (click.exceptions.Abort, KeyboardInterrupt) as stopped:
        _say(str(stopped.__cause__ or stopped) or "stopped", "yellow")  # click makes an Abort of an interrupt
        return 130
    return 0


def _fault(text: str, status: int) -> int:
    for line in text.splitlines():
        _say(f"error: {line}", "red")
    return status


def _say(text: str, colour: str) -> None:
    """Print a line on stderr, in colour where colours are wanted and seen."""
    from rich.text import Text

    from sucre_bench import console

    console.err.print(Text(text, style=colour), soft_wrap=True)


class _Grouped(click.Group):
    """Its help lists the commands by what one does with them."""

    sections: Mapping[str, Sequence[str]] = {
        "Restore and compare": ("run", "compare", "score"),
        "Your own data": ("prepare", "describe", "charts"),
        "Look at results": ("report", "texture", "video", "track"),
        "Extend": ("list", "new", "check"),
        "This machine": ("doctor", "completion"),
    }

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a list a section, as far as they go in one line."""
        width = max(map(len, self.commands))
        for title, names in self.sections.items():
            with formatter.section(title):
                own = [(name, self.commands[name]) for name in names]
                formatter.write_dl(
                    [(name.ljust(width), c.get_short_help_str(formatter.width - width - 6)) for name, c in own]
                )


_JSON = "For programs: one JSON object on stdout, and nothing else there."


@click.group(cls=_Grouped, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(sucre_bench.__version__, prog_name="sucre-bench")
def cli() -> None:
    """Compare methods that restore the colours of underwater images.

    \b
    sucre-bench run dataset=demo method=gray_world     one method on a made dive
    sucre-bench run -m dataset=demo method=underwater,gray_world,sucre out=results
    sucre-bench compare results                        who leads, and by chance?
    sucre-bench prepare photos/ dive/                  a scene of your own photos
    sucre-bench run dataset=colmap dataset.root=dive/ method=sucre

    Each command's --help begins with examples. `sucre-bench completion --help` tells how <TAB> completes them.
    """


@cli.command(
    context_settings={"ignore_unknown_options": True}, short_help="Restore a dataset's views with methods, score them."
)
@click.argument(
    "overrides", nargs=-1, type=click.UNPROCESSED, metavar="[KEY=VALUE]...", shell_complete=completion.complete_words
)
@click.option("-m", "--multirun", is_flag=True, help="Run every combination of comma-separated values.")
@click.option("--plugin", "plugin_files", multiple=True, metavar="FILE", help="A .py file with plugins of your own.")
@click.option("--cfg", is_flag=True, help="Print the configuration and stop.")
@click.option("--json", "as_json", is_flag=True, help=_JSON)
def run(overrides: tuple[str, ...], multirun: bool, plugin_files: tuple[str, ...], cfg: bool, as_json: bool) -> None:
    """Restore views of a dataset with a method, and score them.

    \b
    sucre-bench run dataset=demo method=gray_world
    sucre-bench run dataset=colmap dataset.root=dive/ method=sucre views=[a.png]
    sucre-bench run -m method=underwater,gray_world,sucre every=4 out=results
    sucre-bench run -m method.pairing=mutual,depth hydra/launcher=joblib
    sucre-bench run -m experiment=table1
    sucre-bench run --json dataset=demo method=gray_world | jq .table

    Words are Hydra's key=value. dataset=, method=, metrics=[a,b] choose plugins (`sucre-bench list`); their options
    follow a dot: method.pairing=depth. With -m, values parted by commas are all run.

    \b
    out=FOLDER              where results go; the same one again adds to it
    views=[NAME,...]        only these, or those of a .txt list
    every=N first=N         each Nth view, the first N
    metrics=[psnr,psi]      only these; metrics.uciqe.variants=[all]
    degrade.noise=0.02      worse data: `sucre-bench list degradations`
    save=full               also J, B, beta, gamma (.npz), for metrics of later on
    overwrite=always        again what is there; never: keep whatever there is
    seed=N                  other draws
    report=false            no page
    tracking.uri=off        no mlflow; or the address of yours

    What is done is not done again: the same command goes on where it was stopped.

    The exit code is 0 when all was done but what had a reason not to be, 1 when a view or a score failed or nothing at
    all was done, 2 for a mistake in the command, 130 after Ctrl-C.
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
    from sucre_bench import summary

    # What a plugin prints is no part of the object.
    with contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext():
        outcome = sweep.run(overrides, multirun, plugin_files)
        try:
            if as_json:
                told = summary.as_object(outcome)
            else:
                summary.show(outcome)
        finally:  # also when whoever reads our output has gone
            sweep.track(outcome)
    if as_json:
        click.echo(json.dumps(told, indent=1))
    sys.exit(outcome.exit_code)


@cli.command(short_help="Score a folder of images with any metric, as published.")
@click.argument("images", type=click.Path(path_type=Path))
@click.option("--reference", type=click.Path(path_type=Path), help="Folder with the same names, or one image.")
@click.option(
    "--metrics",
    default="",
    metavar="A,B",
    shell_complete=completion.complete_metrics,
    help="Names, name:variant or name:all; default all that apply.",
)
@click.option("--format", "how", type=click.Choice(["terminal", "csv", "json"]), default="terminal", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The same as --format json.")
@click.option("--csv", "file", type=click.Path(path_type=Path), help="Also write every score to this CSV file.")
@click.option("--plugin", "plugin_files", multiple=True, metavar="FILE", help="A .py file with metrics of your own.")
def score(
    images: Path,
    reference: Path | None,
    metrics: str,
    how: str,
    as_json: bool,
    file: Path | None,
    plugin_files: tuple[str, ...],
) -> None:
    """Score a folder of images (or one image) with any metric, in any published variant.

    \b
    sucre-bench score restored/
    sucre-bench score restored/ --reference truth/ --metrics psnr,ssim:all
    sucre-bench score restored/ --metrics uciqe:all,uiqm:all --csv scores.csv
    sucre-bench score a.png --json | jq '.[] | {metric, variant, value}'

    A folder knows no holes: what is black counts as picture. `sucre-bench run` scores only pixels that have a colour.
    """
    from sucre_bench import console, plugins, results, scoring

    for plugin in plugin_files:
        plugins.load_file(plugin)
    with contextlib.redirect_stdout(sys.stderr), console.live():  # what a metric prints is no part of the table
        rows = scoring.score_folder(images, reference, [m.strip() for m in metrics.split(",") if m.strip()])
    if file:
        results.write_atomically(file, rows.to_csv(index=False).encode())
    if how == "csv" and not as_json:
        click.echo(rows.to_csv(index=False), nl=False)
    elif as_json or how == "json":
        click.echo(rows.to_json(orient="records", indent=1))
    else:
        console.out.print(scoring.summary(rows))
    faults = rows[rows["status"] != "ok"]
    asked = faults if metrics else faults[faults["status"] == "failed"]  # unasked, what does not apply is no fault
    for (view, metric, reason), _ in asked.groupby(["view", "metric", "reason"], sort=False):
        _say(f"failed  {view}: {f'{metric}: ' if metric != 'seconds' else ''}{reason}", "red")
    sys.exit(1 if len(asked) else 0)


@cli.command("list", short_help="List plugins, their options, and if they can run here.")
@click.argument("what", type=click.Choice(["methods", "datasets", "metrics", "experiments", "degradations"]))
@click.option("--json", "as_json", is_flag=True, help=_JSON)
@click.option("--plugin", "plugin_files", multiple=True, metavar="FILE", help="A .py file with plugins of your own.")
def list_(what: str, as_json: bool, plugin_files: tuple[str, ...]) -> None:
    """List what there is, what it needs, every option, and whether it is installed.

    \b
    sucre-bench list methods
    sucre-bench list metrics --plugin my_metric.py
    sucre-bench list experiments
    sucre-bench list methods --json | jq -r '.[] | select(.installed) | .name'
    """
    from sucre_bench import console, listing, plugins

    for file in plugin_files:
        plugins.load_file(file)
    if as_json:
        click.echo(listing.as_json(what))
    else:
        click.echo(listing.as_text(what, colour=console.has_styles()), color=console.has_styles())


@cli.command(short_help="One table of output folders, with 95 % intervals.")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--by", type=click.Choice(["method", "view", "region"]), default="method", show_default=True)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME[:VARIANT]",
    shell_complete=completion.complete_metrics,
    help="Only these; may be repeated.",
)
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
@click.option("--json", "as_json", is_flag=True, help="The same as --format json.")
def compare(
    folders: Sequence[Path],
    by: Any,
    metrics: Sequence[str],
    baseline: str,
    common: bool,
    spread: bool,
    how: Any,
    as_json: bool,
) -> None:
    """One table over one or more output folders, with 95 % intervals.

    \b
    sucre-bench compare results
    sucre-bench compare results --baseline sucre_paper --metric psnr --metric psi
    sucre-bench compare monday/ tuesday/ --metric psi --by region --format latex
    sucre-bench compare results --json | jq '.[] | {method, metric, mean}'

    Methods are compared on the same images only. What cannot stand side by side is refused, with the difference said.
    """
    from sucre_bench import compare, console, tables

    rows = compare.load(folders)
    compare.refuse(rows, metrics, common)
    compared = compare.compare(rows, metrics, by, baseline=baseline)
    if not any(table.columns for table in compared):
        raise InputError("\n".join(f"{table.title}: {note}" for table in compared for note in table.notes))
    if as_json or how != "terminal":
        click.echo(tables.as_text(compared, "json" if as_json else how, spread), nl=False)
        return
    for table in compared:
        console.out.print(tables.as_table(table, console.out.width, spread))
        for line in tables.verdicts(table):
            click.echo(line)


@cli.command("report", short_help="Write the page of tables and pictures.")
@click.argument("folder", type=click.Path(path_type=Path))
def report_(folder: Path) -> None:
    """Write FOLDER/report/index.html, a page of tables, plots and pictures that opens from disk.

    \b
    sucre-bench report results
    """
    from sucre_bench import report, results

    click.echo(report.write(folder, results.read(folder)))


@cli.command(short_help="Tell mlflow what a folder holds; open mlflow's page.")
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
        raise OutputError(f"{uri}: mlflow cannot be told, {shorten(one_line(fault), 200)}; check the URI") from fault
    click.echo(f"mlflow   {uri}, experiment {experiment}: {new} new run{'' if new == 1 else 's'}")
    if ui:
        click.echo(f"page     {tracking.runs_page(uri, experiment, port)}")
        sys.exit(tracking.open_ui(uri, port))


@cli.command("doctor", short_help="Say what can be done here, and how to get the rest.")
@click.option("--out", default=Path(), type=click.Path(path_type=Path), help="Whose disk to look at.")
@click.option("--json", "as_json", is_flag=True, help=_JSON)
def doctor_(out: Path, as_json: bool) -> None:
    """Say what can be done on this machine, what is missing, and the command that installs it.

    \b
    sucre-bench doctor
    sucre-bench doctor --out /scratch/results
    sucre-bench doctor --json | jq '.features[] | select(.state != "ready")'

    The exit code is 1 where something is broken, or a package that sucre_bench depends on is missing; what is optional
    does not count.
    """
    from sucre_bench import doctor

    found = doctor.examine(out)
    if as_json:
        click.echo(json.dumps(doctor.as_object(found), indent=1))
    else:
        doctor.show(found)
    sys.exit(1 if found.faults else 0)


@cli.command("completion", short_help="Print what makes <TAB> complete in your shell.")
@click.argument("shell", type=click.Choice(list(completion.SHELLS)))
def completion_(shell: str) -> None:
    """Print the script by which a shell completes commands, options and key=value words.

    \b
    echo 'source <(sucre-bench completion bash)' >> ~/.bashrc
    echo 'source <(sucre-bench completion zsh)' >> ~/.zshrc
    sucre-bench completion fish > ~/.config/fish/completions/sucre-bench.fish

    It then holds in every new shell in which sucre-bench is found, as after `source .venv/bin/activate`. In this shell
    alone, now: source <(sucre-bench completion bash). Bash from 4.4 on; in ~/.zshrc, behind compinit.
    """
    click.echo(completion.script(shell, cli), nl=False)


for command in (prepare, charts, describe, texture, video, new, check):
    cli.add_command(command)
