"""`sucre-bench charts`: mark the colour charts of a scene's views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from sucre_bench.commands import completion_words
from sucre_bench.machine.plural import counted

if TYPE_CHECKING:
    from sucre_bench.programs.charts.session import Session

_DATASET = "colmap"  # reads images that are given without dataset=


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument(
    "words",
    nargs=-1,
    type=click.UNPROCESSED,
    metavar="VIEW... [KEY=VALUE]...",
    shell_complete=completion_words.complete_views,
)
@click.option("--kind", default="dgk", show_default=True, metavar="NAME|FILE.csv", help="Kind of the charts to mark.")
@click.option("--accept", is_flag=True, help="Open no page; accept all proposals whose patches are in order.")
@click.option("--no-browser", is_flag=True, help="Print the address of the page; do not open a browser.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page; 0 (default): any free port.")
def charts(words: tuple[str, ...], kind: str, accept: bool, no_browser: bool, port: int) -> None:
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

    from sucre_bench.machine import progress_display
    from sucre_bench.programs.charts import open_session

    with progress_display.live():
        session = open_session.open_session(words, kind, _DATASET)
        session.prepare()
    if accept:
        with progress_display.live():
            accepted, doubtful = session.accept()
        for proposal, fault in doubtful:
            click.echo(f"left  {proposal.view}, {proposal.chart.name}: {fault}")
        click.echo(f"{counted(len(accepted), 'proposal')} accepted, {len(doubtful)} left for you to check")
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
    _show(session)


def _show(session: Session) -> None:
    for view in session.everything:
        marked, proposed = session.file.confirmed(view.name), session.file.proposed(view.name)
        if marked or proposed:
            open_ = f", {len(proposed)} to confirm" if proposed else ""
            click.echo(f"{view.name}: {counted(len(marked), 'chart')}{open_}")
    click.echo(f"charts   {session.file.path}{'' if session.file.path.is_file() else ': none marked, nothing written'}")
