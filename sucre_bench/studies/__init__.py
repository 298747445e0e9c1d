"""Studies: what an experiment asks of its rows, beside the long table itself: tables and figures for a paper.

`Study` is the block ``study:`` of an experiment's configuration, `write` makes its files. `sucre_bench.studies.along`
has the tables of a study that follows one option through its values.
"""

from sucre_bench.studies.study import Study
from sucre_bench.studies.writing import Written, write

__all__ = ["Study", "Written", "write"]
