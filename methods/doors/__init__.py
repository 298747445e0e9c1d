"""Methods for restorers outside this project: images that exist already, and programs that restore images.

Both use `pattern`, which finds the image of a view, `read_picture`, which reads it, and `placeholders`, which fills in
the names in a command or a file name. `handover` writes a program's input files, and `process` runs the program.
"""

from sucre_bench.methods.doors.command import Command
from sucre_bench.methods.doors.precomputed import Precomputed

__all__ = ["Command", "Precomputed"]
