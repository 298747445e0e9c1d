"""`sucre-bench doctor`: what runs on this machine."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from sucre_bench.commands.common import json_option

__all__ = ["doctor"]


@click.command("doctor", short_help="Say what can be done here, and how to get the rest.")
@click.option("--out", default=Path(), type=click.Path(path_type=Path), help="Whose disk to look at.")
@json_option
def doctor(out: Path, as_json: bool) -> None:
    """Say what can be done on this machine, what is missing, and the command that installs it.

    \b
    sucre-bench doctor
    sucre-bench doctor --out /scratch/results
    sucre-bench doctor --json | jq '.features[] | select(.state != "ready")'

    The exit code is 1 where something is broken, or a package that sucre_bench depends on is missing; what is optional
    does not count.
    """
    from sucre_bench.programs import doctor

    found = doctor.examine(out)
    if as_json:
        click.echo(json.dumps(doctor.as_object(found), indent=1))
    else:
        doctor.show(found)
    sys.exit(1 if found.faults else 0)
