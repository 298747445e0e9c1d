"""`sucre-bench bundle`: writes a results folder as one file."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from sucre_bench.commands.output_files import check_output
from sucre_bench.commands.shared_options import plugin_option
from sucre_bench.machine.notices import say


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("file", type=click.Path(path_type=Path), metavar="FILE.zip")
@click.option(
    "--pictures",
    type=click.Choice(["none", "restored", "all"]),
    default="none",
    show_default=True,
    help="restored: put the restored images in; all: also views and references, if you may publish them.",
)
@click.option("--by", default="", metavar="TEXT", help='Who publishes the bundle, for example "Reef Lab".')
@click.option("--code", is_flag=True, help="Put the files of --plugin in, so that others can run lineup.yaml.")
@plugin_option
def bundle(folder: Path, file: Path, pictures: Any, by: str, code: bool) -> None:
    """Write a results folder as one file: scores, configuration and hashes.

    \b
    sucre-bench bundle results paper.zip
    sucre-bench bundle results paper.zip --pictures restored --by "Reef Lab"
    sucre-bench bundle results paper.zip --plugin my_method.py --code

    The command prints an id that stands for every hash in the file. Print the id in your paper. The same results always
    give the same bytes and the same id.
    """
    from sucre_bench.machine import progress_display
    from sucre_bench.programs.bundle.write import bundle_results

    check_output(file, "bundle")
    with progress_display.live():
        made = bundle_results(folder, file, pictures, by, _line_up(folder, code))
    size = file.stat().st_size
    click.echo(f"bundle   {file}, {f'{size / 1e6:.1f} MB' if size >= 1e6 else f'{size / 1e3:.0f} kB'}")
    click.echo(f"id       {made.id}")
    click.echo(f"scores   {made.n_scores}, and seconds and memory")
    click.echo(f"files    {made.n_inside} pictures and records inside, {made.n_outside} outside by their hash")
    if made.unverifiable:
        told = ", ".join(f"{n} of {metric}" for metric, n in made.unverifiable.items())
        say(f"nobody can verify these scores, which need more than 8 bits: {told}", "yellow")
    if made.local_paths:
        say(f"the bundle names folders of this machine: {', '.join(made.local_paths)}", "yellow")


def _line_up(folder: Path, has_code: bool) -> dict[str, str]:
    """Return the line-up file that runs these results again. If it cannot be made, say why and return none."""
    from sucre_bench import results
    from sucre_bench.errors import SucreBenchError
    from sucre_bench.jobs.lineup_of_results import line_up_of

    results.read(folder)  # a folder without results is an error of its own
    try:
        line_up = line_up_of(folder, folder).line_up
    except SucreBenchError as fault:
        say(f"no lineup.yaml in the bundle: {fault}", "yellow")
        return {}
    given = line_up.settings.get("plugins", [])
    files = _plugin_files([folder / name for name in given]) if has_code else {}
    if files:
        line_up = replace(line_up, settings={**line_up.settings, "plugins": list(files)})
    elif given:
        code = "--plugin FILE --code puts that code into the bundle"
        say(f"note: lineup.yaml needs {', '.join(given)}; {code}", "yellow")
    text = line_up.as_yaml("The line-up that made these results. To run it: sucre-bench run lineup.yaml")
    return {"lineup.yaml": text, **files}


def _plugin_files(paths: Iterable[Path]) -> dict[str, str]:
    """The text of plugin files by their name in the bundle; none if one was not loaded, or two have one name.

    paths: that the results folder names, which may be any file of this machine.
    """
    from sucre_bench import plugins
    from sucre_bench.errors import InputError
    from sucre_bench.machine.files import regular

    texts: dict[str, str] = {}
    for path in paths:
        name = f"plugins/{path.name}"
        if not plugins.is_loaded(path):
            say(f"{path}: is not in the bundle; add --plugin {path} if it is the run's plugin file", "yellow")
            return {}
        try:
            text = regular(path).read_text(encoding="utf-8")
        except (OSError, InputError, ValueError) as fault:
            say(f"{path}: is not in the bundle, {fault}; publish it beside the bundle", "yellow")
            return {}
        if name in texts:
            say(f"{path}: is not in the bundle, another plugin file has its name; rename it and run again", "yellow")
            return {}
        texts[name] = text
    return texts
