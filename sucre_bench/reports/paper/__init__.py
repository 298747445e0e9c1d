"""Studies: the tables and figures that an experiment makes of its rows.

`Study` is the block ``study:`` of an experiment's configuration, `write` makes its files. `follow_option`
has the tables of a study that follows one option through its values.
"""

from sucre_bench.jobs.run_options import Study
from sucre_bench.reports.paper.write import Written, write

__all__ = ["Study", "Written", "write"]
