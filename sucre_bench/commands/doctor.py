"""`sucre-bench doctor`: lists what works on this machine."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from sucre_bench.commands.common import json_option


@click.command("doctor")
@click.option(
    "--out",
    default=Path(),
    type=click.Path(path_type=Path),
    help="Results folder whose disk to check [default: the current folder].",
)
@json_option
def doctor(out: Path, as_json: bool) -> None:
    """List what works on this machine, what is missing, and the commands that install it.

    \b
    sucre-bench doctor
    sucre-bench doctor --out /scratch/results
    sucre-bench doctor --json | jq '.features[] | select(.state != "ready")'

    Exit codes: 0, all required packages work; 1, something is broken or a required package is missing. Missing optional
    packages do not count.
    """
    from sucre_bench.programs import doctor

    found = doctor.examine(out)
    if as_json:
        click.echo(json.dumps(doctor.as_object(found), indent=1))
    else:
        doctor.show(found)
    sys.exit(1 if found.faults else 0)
