"""`sucre-bench doctor`: what runs on this machine."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from sucre_bench.commands.common import json_option

__all__ = ["doctor"]


@click.command("doctor")
@click.option("--out", default=Path(), type=click.Path(path_type=Path), help="Folder whose disk to check.")
@json_option
def doctor(out: Path, as_json: bool) -> None:
    """Say what works on this machine, what is missing, and the command that installs it.

    \b
    sucre-bench doctor
    sucre-bench doctor --out /scratch/results
    sucre-bench doctor --json | jq '.features[] | select(.state != "ready")'

    The exit code is 1 if something is broken or a required package is missing; optional packages do not count.
    """
    from sucre_bench.programs import doctor

    found = doctor.examine(out)
    if as_json:
        click.echo(json.dumps(doctor.as_object(found), indent=1))
    else:
        doctor.show(found)
    sys.exit(1 if found.faults else 0)
