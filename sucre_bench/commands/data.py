"""`sucre-bench describe` and `charts`: what a dataset holds, and its colour charts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.measure import Measurement
from rich.text import Text

from sucre_bench.commands import completion, shared
from sucre_bench.errors import InputError
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.files import check_output, write_atomically
from sucre_bench.machine.text_formats import counted

if TYPE_CHECKING:
    from sucre_bench.programs.describe.description import Described

_ROWS = 30  # of the table of views
_WIDEST = 10_000  # characters
_HEADS = (
    "depth",
    "{unit} (1, 50, 99 %)",
    "overlap",
    "views",
    "disagrees",
    "mean R G B",
    "charts",
)


@click.command()
@shared.words_argument("words", "[DATASET|FOLDER] [KEY=VALUE]...", completion.complete_words)
@shared.json_option
@shared.path_option(
    "--sheet",
    metavar="FILE",
    help="Where to write the contact sheet, .png or .jpg [default: SCENE-sheet.png]",
)
@shared.flag("--no-sheet", help="Write no contact sheet.")
@shared.option(
    "--most",
    default=400,
    of=click.IntRange(1),
    help="Describe at most this many views of a scene, evenly spread.",
)
@shared.plugin_option
@shared.force_option
def describe(
    words: tuple[str, ...],
    as_json: bool,
    sheet: Path | None,
    no_sheet: bool,
    most: int,
    force: bool,
) -> None:
    """Describe what a dataset holds, write a contact sheet, and list faults with their remedies.

    \b
    sucre-bench describe ./dive
    sucre-bench describe colmap dataset.root=dive/
    sucre-bench describe dataset=demo dataset.water=turbid every=4 --json

    The command recognises a folder by its files. It takes these words of `sucre-bench run`: dataset= and its options,
    views=, every=, first= and degrade.

    Exit codes: 0, at least one view was read; 2, no view could be read, or the command has a mistake.
    """
    from sucre_bench.engine.preflight import select
    from sucre_bench.loading.view_files import source_files
    from sucre_bench.programs.describe import description
    from sucre_bench.results.layout import file_name

    if sheet is not None:
        check_output(sheet, "contact sheet", force=force)
    overrides = [word if "=" in word else f"dataset={word}" for word in words]
    with progress.live():
        selections = select(overrides)
    sheets = [Path(f"{file_name(one.scene.name)}-sheet.png") for one in selections]
    if no_sheet:
        sheets = []
    elif sheet:
        sheets = [sheet]
    if sheet and len(selections) > 1:
        raise InputError("there are several scenes", "--sheet", "leave it out")
    with progress.live():
        inputs = [
            file for one in selections for view in one.views for file in source_files(view)
        ]
        for path in sheets:
            check_output(path, "contact sheet", inputs, force or sheet is None)
        described = [description.described(selection, most) for selection in selections]
    if as_json:
        shared.print_json([one.as_object() for one in described])
    for n, one in enumerate(described):
        if not as_json:
            _show(one)
        if sheets:
            write_atomically(sheets[n], one.sheet(sheets[n].suffix))
            click.echo(f"sheet    {sheets[n]}", err=as_json)
    if not any(view.mean for one in described for view in one.facts):
        raise InputError("describe: no view could be read; mend the files named above")


def _show(one: Described) -> None:
    """Print a description: facts, a table of views, the distances, and faults."""
    lines = [*_facts(one).items()]
    lines += [("set", found.sentence()) for found in one.sets]
    for name, text in lines:
        terminal.show(f"{name:8} {text}")
    between = {overlap.view: overlap for overlap in one.overlaps}
    table = terminal.table(["view"], [head.format(unit=one.unit) for head in _HEADS])
    for view in one.facts[:_ROWS]:
        near = "-" if view.distances is None else " ".join(f"{d:.2f}" for d in view.distances)
        lap = ["-"] * 3
        if overlap := between.get(view.name):
            off = "-" if overlap.disagreement is None else f"{overlap.disagreement:.2%}"
            lap = [f"{overlap.seen:.0%}", str(overlap.partners), off]
        colours = " ".join(f"{m:.2f}" for m in view.mean) if view.mean else "unreadable"
        depth = f"{view.coverage:.0%}" if view.has_depth else "-"
        table.add_row(Text(view.name), depth, near, *lap, colours, str(len(view.charts) or "-"))
    wide = terminal.out.options.update(max_width=_WIDEST)
    # names stay whole; a narrow terminal wraps rows
    table.width = Measurement.get(terminal.out, wide, table).maximum
    terminal.out.print(table, soft_wrap=True)
    if len(one.facts) > _ROWS:
        click.echo(f"... and {len(one.facts) - _ROWS} more views; --json has them all")
    if one.spread:
        terminal.show(f"measure  {one.spread.sentence(one.unit)}")
    for fault in one.faults:
        terminal.show(f"wrong    {fault}", style="yellow")
    click.echo(f"found    {counted(len(one.faults), 'fault')}")


def _facts(one: Described) -> dict[str, str]:
    """The lines on the whole scene, by their first word."""
    import numpy as np

    sizes = Counter(f"{view.width}x{view.height}" for view in one.facts)
    encodings = " and ".join(sorted({view.encoding for view in one.facts}))
    focals = sorted({view.focal for view in one.facts if view.focal})
    has = ", ".join(one.has) or "images alone"
    water = "not known"
    if true := one.water:
        known = {"B": true.veiling_light, "beta": true.attenuation, "gamma": true.backscatter}
        water = ", ".join(
            f"{name} {' '.join(f'{v:.3g}' for v in values)}" for name, values in known.items()
        )
    places = np.array([view.position for view in one.facts if view.position])
    travel = "one pose" if len(places) else "not known, no poses"
    if len(places) > 1:
        extent = np.linalg.norm(np.ptp(places, axis=0))
        travel = f"{extent:.2f} {one.unit} between the outermost of {len(places)} cameras"
    facts = {
        "scene": f"{one.scene} of {one.dataset}: {len(one.facts)} of {one.n_views} views; has {has}",
        "images": f"{', '.join(f'{n} of {size}' for size, n in sizes.most_common(3))}, {encodings}",
        "cameras": f"{len(focals)}, focal {', '.join(f'{fx:.0f}' for fx, _ in focals[:3])} px"
        if focals
        else "none",
        "travel": travel,
        "water": water,
    }
    if one.scale is not None:
        facts["scale"] = one.scale["note"]
    return facts


@click.command()
@shared.words_argument("words", "VIEW... [KEY=VALUE]...", completion.complete_words)
@shared.option(
    "--kind", default="dgk", metavar="NAME|FILE.csv", help="Kind of the charts to mark."
)
@shared.flag("--accept", help="Open no page; accept all proposals whose patches are in order.")
@shared.flag("--no-browser", help="Print the address of the page; do not open a browser.")
@shared.option(
    "--port",
    of=click.IntRange(0, 65535),
    default=0,
    help="Port of the page; 0 (default): any free port.",
)
def charts(
    words: tuple[str, ...], kind: str, accept: bool, no_browser: bool, port: int
) -> None:
    """Mark colour charts: click their four corners on a page in your browser.

    \b
    sucre-bench charts dive/images/a.png
    sucre-bench charts dataset=colmap dataset.root=dive/ views=[a.png,b.png]
    sucre-bench charts dive/images/a.png --kind colorchecker24
    sucre-bench charts dataset=colmap dataset.root=dive/ --accept

    VIEW is an image in the folder images/ of a scene. With dataset=, it is the name of a view. The kinds are dgk,
    colorchecker24, colorchecker_sg, or a CSV file. The command finds charts of the kind colorchecker24 by itself. Depth
    and poses carry a marked chart to the other views, where you confirm it. The page shows the named views first. The
    scene's charts.json stores everything.
    """
    import webbrowser

    from sucre_bench.programs.charts.session import open_session

    with progress.live():
        session = open_session(words, kind, "colmap")  # for images without dataset=
        session.prepare()
    if accept:
        with progress.live():
            accepted, doubtful = session.accept()
        for proposal, fault in doubtful:
            click.echo(f"left  {proposal.view}, {proposal.chart.name}: {fault}")
        click.echo(
            f"{counted(len(accepted), 'proposal')} accepted, {len(doubtful)} left for you to check"
        )
    else:
        from sucre_bench.programs.charts.server import PageServer

        with PageServer(session, port) as server:
            click.echo(f"page     {server.url}  (Ctrl-C ends it)")
            if not no_browser:
                webbrowser.open(server.url)
            try:
                server.serve_forever()
            except KeyboardInterrupt:
                click.echo("stopped; confirmed charts are stored")
    for view in session.everything:
        marked = session.file.confirmed(view.name)
        proposed = session.file.proposed(view.name)
        if marked or proposed:
            open_ = f", {len(proposed)} to confirm" if proposed else ""
            click.echo(f"{view.name}: {counted(len(marked), 'chart')}{open_}")
    click.echo(
        f"charts   {session.file.path}{'' if session.file.path.is_file() else ': none marked, nothing written'}"
    )
