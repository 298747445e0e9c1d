"""`sucre-bench doctor`: lists what is installed on this machine."""

import sys
from dataclasses import asdict
from pathlib import Path

import click

from sucre_bench.commands import shared
from sucre_bench.machine import progress, terminal

_COLOURS = {"ready": "green", "missing": "yellow", "broken": "red", "absent": "dim"}


@click.command("doctor")
@shared.option(
    "--out",
    of=shared.PATH,
    help="Results folder whose disk to check [default: the current folder].",
)
@shared.json_option
def doctor(out: Path | None, as_json: bool) -> None:
    """List what is installed on this machine, what is missing, and the commands that install it.

    \b
    sucre-bench doctor
    sucre-bench doctor --out /scratch/results
    sucre-bench doctor --json | jq '.features[] | select(.state != "ready")'

    Exit codes: 0, all required packages are there; 1, something is broken or a required package is missing. Missing
    optional packages do not count.
    """
    from sucre_bench.programs import doctor

    with progress.live():
        found = doctor.examine(out or Path())
    if as_json:
        shared.print_json({**asdict(found), "faults": found.faults})
        sys.exit(1 if found.faults else 0)
    terminal.show(f"sucre_bench {found.version} on Python {found.python}")
    for name, said in {"source": found.commit, **found.machine}.items():
        if said:
            terminal.show(f"{name:9}{said}")
    width = max(len(feature.name) for feature in found.features)
    for feature in found.features:
        dim = "dim" if feature.state == "absent" else ""
        state = (f"{feature.state:9}", _COLOURS[feature.state])
        terminal.show(state, (f"{feature.name:{width}}  ", dim), (feature.said, dim))
        if feature.remedy:  # below the feature
            terminal.show(f"{'':9}", (f"$ {feature.remedy}", "bold"))
    terminal.show(
        "everything that sucre_bench needs is there"
        if not found.faults
        else f"{found.faults} to mend"
    )
    sys.exit(1 if found.faults else 0)
