"""A comparison as people and programs read it: terminal, Markdown, LaTeX, HTML, CSV, JSON, and a sentence a metric."""

from sucre_bench.tables.papers import Format, as_text
from sucre_bench.tables.terminal import as_table
from sucre_bench.tables.words import ARROW, left_out, legend, number, shown, signed, title, verdicts

__all__ = [
    "ARROW",
    "Format",
    "as_table",
    "as_text",
    "left_out",
    "legend",
    "number",
    "shown",
    "signed",
    "title",
    "verdicts",
]
