"""Options and checks that several commands share."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from sucre_bench.machine.text_formats import json_text

if TYPE_CHECKING:
    from sucre_bench.engine.preflight import Planned

_F = TypeVar("_F", bound=Callable[..., Any])
_MOST_SCENES = 3  # of which is said what their views show


class _Path(click.Path):
    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        if value == "":  # else a variable that is not set would be the current folder
            self.fail("is empty", param, ctx)
        return super().convert(value, param, ctx)


PATH: Any = _Path(path_type=Path)
# As `plugins.KINDS`, which would import numpy for every --help.
KINDS = click.Choice(["method", "dataset", "metric"])


def argument(*names: str, of: Any = PATH, **settings: Any) -> Callable[[_F], _F]:
    """Add an argument, a path if `of` names no other type."""
    return click.argument(*names, type=of, **settings)


def words_argument(name: str, metavar: str | None, complete: Any = None) -> Callable[[_F], _F]:
    """Add the words of `sucre-bench run`. complete: completes them in a shell."""
    return click.argument(
        name, nargs=-1, type=click.UNPROCESSED, metavar=metavar, shell_complete=complete
    )


def flag(*names: str, help: str) -> Callable[[_F], _F]:
    """Add an option that is there or not."""
    return click.option(*names, is_flag=True, help=help)


def option(*names: str, of: Any = None, help: str, **settings: Any) -> Callable[[_F], _F]:
    """Add an option. of: click's type, or the words to choose from, the first by default. --help shows a default."""
    if isinstance(of, tuple):
        settings = {"default": of[0], **settings}
        of = click.Choice(of)
    shows = bool(settings.get("default"))
    return click.option(*names, type=of, help=help, **{"show_default": shows, **settings})


path_option = partial(option, of=PATH)


def print_json(value: Any) -> None:
    """Print a value on stdout as JSON: what --json shows. NaN and infinity are null."""
    click.echo(json_text(value))


def _load_plugins(context: click.Context, _: click.Parameter, files: Sequence[str]) -> None:
    if files and not context.resilient_parsing:
        # a shell that completes words asks for no plugin
        from sucre_bench import plugins

        for file in files:
            plugins.load_file(file)


# For programs: the command prints one JSON value on stdout and nothing else there.
json_option = flag(
    "--json", "as_json", help="Print one JSON object on stdout and nothing else, for programs."
)
# The parameter force of `check_output`.
force_option = flag("--force", help="Write over a file that exists.")
_PLUGIN: Any = {
    "multiple": True,
    "of": _Path(),
    "metavar": "FILE",
    "help": "Load the plugins of this .py file; may be repeated.",
}
# Plugin files that the command loads: the parameter plugin_files.
plugin_files_option = option("--plugin", "plugin_files", **_PLUGIN)
# Plugin files that are loaded before the command runs; PluginError then if one does not exist or does not import.
plugin_option = option("--plugin", expose_value=False, callback=_load_plugins, **_PLUGIN)
# The choice of one dataset in a results folder.
dataset_option = option(
    "--dataset",
    default="",
    metavar="LABEL",
    help="Needed if the results have several datasets.",
)


def labels_of(text: str) -> list[str]:
    """Return labels with commas between them, each once. A part with "=" belongs to the label before it."""
    labels: list[str] = []
    for word in (part.strip() for part in text.split(",")):
        if "=" in word and labels:
            labels[-1] += f",{word}"
        elif word and word not in labels:
            labels.append(word)
    return labels


def say_whether_measurable(planned: Sequence[Planned]) -> None:
    """Say whether units and poses fit, or else whether the selected views show their scene's water, where methods of
    several views are to restore it.

    Depth maps are decoded in a process of its own: workers are forked from one without threads.
    """
    scenes = {
        (plan.job.dataset.label, task.scene.name): task.scene
        for plan in planned
        if {"poses", "depth"} <= plan.job.method.plugin.needs
        for task in plan.todo
    }
    if not scenes:
        return
    from sucre_bench.errors import ANY_FAULT
    from sucre_bench.machine import processes, progress
    from sucre_bench.multiview.geometry_faults import first_look

    for (dataset, name), scene in list(scenes.items())[:_MOST_SCENES]:
        with contextlib.suppress(*ANY_FAULT):  # the run says what is wrong with the data
            if said := processes.call(
                partial(first_look, scene.views), "leave out the view that ends it"
            ):
                progress.say(f"{dataset}, {name}: {said}")


def floor_of_psi(planned: Sequence[Planned]) -> str:
    """Return what psi cannot fall below, if it is scored on charts of linear camera data with an sRGB list."""
    tasks = (
        task
        for plan in planned
        if "psi" in {one.plugin.name for one in plan.job.metrics}
        for task in plan.tasks
    )
    kinds = {
        chart.kind
        for task in tasks
        if task.view.encoding == "linear"
        for chart in task.view.charts
    }
    if all(
        Path(kind).is_file() and "# camera" in Path(kind).read_text(errors="replace")
        for kind in kinds
    ):
        return ""
    floor = "psi of a camera's linear values has a floor of about 8 to 9 degrees with the sRGB list of a chart"
    return f"{floor}; spectra and `# camera:` in a CSV of the chart lower it to about 1 (docs/charts.md)"
