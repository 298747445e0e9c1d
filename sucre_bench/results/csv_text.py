"""Writes a table as CSV, with as many digits as are needed to read the same numbers again."""

from sucre_bench.arrays import DataFrame


def csv_text(table: DataFrame) -> str:
    """Return a table as CSV without its index, lines ending in one newline. NaN: an empty cell.

    pandas alone writes numbers as numpy prints them, and packages alter that for a whole process: importing
    colour-science leaves 12 digits of 17.
    """
    return str(table.to_csv(index=False, lineterminator="\n", float_format=float.__repr__))
