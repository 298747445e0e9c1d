"""Methods for restorers outside this project: images that exist already, and programs that restore images.

What both have in common: `pattern` finds the image that belongs to a view, `picture` reads it, `template` fills
placeholders. `handover` writes what a program is given, `process` runs it.
"""

from sucre_bench.methods.doors.command import Command
from sucre_bench.methods.doors.precomputed import Precomputed

__all__ = ["Command", "Precomputed"]
