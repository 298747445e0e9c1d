"""`sucre-bench run`: restore a dataset with methods. It is a program of Hydra: `engine.hydra_run` does the work."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.commands import completion, shared
from sucre_bench.machine.terminal import say

if TYPE_CHECKING:
    from sucre_bench.engine.preflight import Planned
    from sucre_bench.jobs.job import Job
    from sucre_bench.reports.mlflow.live import Live


@click.command()
@shared.words_argument(
    "overrides", "[EXPERIMENT.yaml] [KEY=VALUE]...", completion.complete_words
)
@shared.flag("-m", "--multirun", help="Run every combination of comma-separated values.")
@shared.plugin_files_option
@shared.path_option(
    "--config-dir",
    "-cd",
    help="A folder of yours with configs: method/, experiment/ ...",
)
@shared.option(
    "--config-name",
    "-cn",
    default="config",
    help="The configuration to begin with, of your folder.",
)
@shared.option(
    "--cfg",
    "-c",
    is_flag=False,
    flag_value="job",
    metavar="[job|hydra|all]",
    help="Print the configuration and stop; --cfg hydra: Hydra's own, --cfg all: both.",
)
@shared.option(
    "--package",
    "-p",
    default="",
    help="Print this part of the configuration, for example method.",
)
@shared.flag("--resolve", help="Print the configuration with each ${...} filled in.")
@shared.option(
    "--info",
    "-i",
    is_flag=False,
    flag_value="all",
    metavar="[WHAT]",
    help="Print what Hydra composes of: --info config, defaults, searchpath, plugins or all.",
)
@shared.flag("--hydra-help", help="Print Hydra's own help and stop.")
@shared.flag("--dry-run", help="Print jobs, views, and the expected time, and stop.")
@shared.json_option
def run(
    overrides: tuple[str, ...],
    multirun: bool,
    plugin_files: tuple[str, ...],
    config_dir: Path | None,
    config_name: str,
    dry_run: bool,
    as_json: bool,
    **shown: Any,
) -> None:
    """Restore views of a dataset with a method, and score them.

    \b
    sucre-bench run dataset=demo method=gray_world
    sucre-bench run dataset=./dive method=sucre_plus method.fill=true
    sucre-bench run -m method=underwater,gray_world,sucre every=4 out=results
    sucre-bench run -m method.light=auto,even workers=2
    sucre-bench run -m method=sucre,onnx sucre.physical=true onnx.model=net.onnx
    sucre-bench run experiment=table1
    sucre-bench run my_experiment.yaml out=results
    sucre-bench run results/experiment.yaml out=again
    sucre-bench run --config-dir mine method=my_preset
    sucre-bench run -m hydra/launcher=slurm experiment=table1
    sucre-bench run --dry-run -m method=gray_world,sucre
    sucre-bench run --json dataset=demo method=gray_world | jq .table

    Every word is key=value. dataset=, method= and metrics=[a,b] choose plugins (`sucre-bench list`). An option of a
    plugin follows a dot: method.light=even. With -m, the command runs every combination of the values with commas
    between them. An option after a method's name is for that method alone. An experiment is a file of Hydra with all of
    this; a word of the command replaces the same key of the file. Hydra's grammar, launchers, sweepers and
    callbacks work; docs/run.md says what does not.

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
    tracking=off            no mlflow; tracking.uri=URI: another mlflow

    If you stop a run, the same command continues. It does not restore finished views again.

    Exit codes: 0, everything finished (skipped views are allowed); 1, a view or a score failed, or nothing was restored
    or scored; 2, the command has a mistake; 130, stopped by Ctrl-C.
    """
    from sucre_bench.jobs import hydra_configs
    from sucre_bench.jobs.word_syntax import value_of
    from sucre_bench.machine.files import check_folder

    if plugin_files:
        overrides = (
            *overrides,
            f"plugins={value_of([str(Path(file).resolve()) for file in plugin_files])}",
        )
    if config_dir is not None:
        check_folder(config_dir, "give the folder that holds method/, experiment/ and others")
    places = () if config_dir is None else (f"file://{config_dir.resolve()}",)
    with hydra_configs.searching(*places, config=config_name):
        if any(shown[name] for name in ("cfg", "info", "hydra_help")):
            _show(overrides, multirun, **shown)
            return
        _run(overrides, multirun, dry_run, as_json)


def _run(overrides: Sequence[str], multirun: bool, dry_run: bool, as_json: bool) -> None:
    """Run the jobs and show what became of them, or with dry_run what they would be."""
    from sucre_bench.machine.provenance import absent

    if old := absent("numpy", "pandas", "pyarrow", "scipy", "numba"):
        say(f"packages: {old}", "yellow")
    # What a plugin prints is no part of a JSON object.
    printed = contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext()
    if dry_run:
        from sucre_bench.commands import run_forecast
        from sucre_bench.engine.forecast import forecast

        with printed:
            found = forecast(overrides, multirun)
        shared.print_json([asdict(one) for one in found]) if as_json else run_forecast.show(
            found
        )
        return
    from sucre_bench.commands import run_summary
    from sucre_bench.engine.hydra_run import run_words
    from sucre_bench.engine.run import Watch
    from sucre_bench.machine import progress

    floor: list[str] = []
    logs: list[Live] = []  # one, if mlflow is wanted

    def start(job: Job) -> None:
        if job.tracking.uri != "off" and not absent("mlflow"):
            from sucre_bench.reports.mlflow.live import Live

            logs.append(block.enter_context(Live(job)))

    def before(planned: Sequence[Planned]) -> None:
        shared.say_whether_measurable(planned)
        floor.append(shared.floor_of_psi(planned))
        for log in logs:
            log.follow(planned)

    def meanwhile() -> None:
        for log in logs:
            log.receive()

    with contextlib.ExitStack() as block:
        with printed, progress.live(meanwhile=meanwhile):
            watch = Watch(start, before)
            outcome = run_words(overrides, multirun, watch)
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
            for log in logs if not outcome.interrupted else ():
                log.end()
    sys.exit(outcome.exit_code)


def _show(
    words: Sequence[str],
    multirun: bool,
    cfg: str | None,
    info: str | None,
    hydra_help: bool,
    package: str,
    resolve: bool,
) -> None:
    """Print what Hydra composes of the words of a command: as `--cfg`, `--info` and `--hydra-help` of its programs."""
    from hydra._internal.utils import get_args_parser
    from omegaconf import OmegaConf

    from sucre_bench.errors import InputError
    from sucre_bench.jobs import compose_jobs, hydra_configs
    from sucre_bench.jobs.read_words import read, reading_experiment

    app = hydra_configs.hydra_app()
    kinds = (
        ("job", "hydra", "all")
        if cfg
        else ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")
    )
    kind = cfg or info or ""
    if kind not in kinds:  # an option without a value takes the word after it
        words = [kind, *words]
        kind = kinds[0]
    if hydra_help:
        parser = get_args_parser()
        args = parser.parse_args([])
        context = click.get_current_context()
        ours = {flag for one in context.command.get_params(context) for flag in one.opts}
        for action in [*parser._actions]:  # noqa: SLF001
            if action.option_strings and not ours.intersection(action.option_strings):
                parser._remove_action(action)  # noqa: SLF001
        app.hydra_help(config_name=hydra_configs.config_name(), args_parser=parser, args=args)
        return
    with reading_experiment(words) as words:
        asked = read(words, multirun)
        is_sweep = asked.config is not None
        command = compose_jobs.command_of(asked)
        lines = compose_jobs.lines_of(asked)
        if info:
            app.show_info(kind, config_name=hydra_configs.config_name(), overrides=lines)
            return
        config = hydra_configs.composed(lines, is_sweep=True) if is_sweep else command.config
    with hydra_configs.current(config):
        whole = app.get_sanitized_cfg(config, kind)
        shown: Any = OmegaConf.select(whole, package) if package else whole
        if shown is None:
            raise InputError(
                f"no part is called '{package}'", "--package", "--cfg shows the parts"
            )
        text = (
            OmegaConf.to_yaml(shown, resolve=resolve)
            if OmegaConf.is_config(shown)
            else f"{shown}\n"
        )
    click.echo(text, nl=False)
