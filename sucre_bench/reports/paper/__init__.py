"""Studies: the tables and figures that an experiment makes of its rows.

`Study` is the block ``study:`` of an experiment's configuration, `write` makes its files.
"""

from sucre_bench.jobs.run_options import Study
from sucre_bench.reports.paper.write_study import Written, write

__all__ = ["Study", "Written", "write"]
