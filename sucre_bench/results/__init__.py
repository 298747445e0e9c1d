"""The results folder: its score table, the parts that jobs write, and the restorations beside the pictures."""

from sucre_bench.results.reasons import (
    Reason as Reason,
    brief as brief,
    with_remedy as with_remedy,
)
from sucre_bench.results.rows import (
    Row as Row,
    Status as Status,
    fingerprint as fingerprint,
    frame as frame,
    replicated as replicated,
    restoration_rows as restoration_rows,
    unreplicated as unreplicated,
)
from sucre_bench.results.table import (
    TABLE as TABLE,
    Part as Part,
    merge as merge,
    read as read,
    write_rows as write_rows,
)
