"""Methods for restorers outside this project: images that exist already, and programs that restore images.

`precomputed` finds and reads the image of a view; `command` writes a program's input files, and `process` runs it.
"""

from sucre_bench.methods.doors.command import Command
from sucre_bench.methods.doors.precomputed import Precomputed

__all__ = ["Command", "Precomputed"]
