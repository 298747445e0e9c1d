"""A comparison as people and programs read it: terminal, Markdown, LaTeX, HTML, CSV, JSON, and a sentence a metric."""

from sucre_bench.compare.documents import Format, as_text
from sucre_bench.compare.terminal import as_table
from sucre_bench.compare.words import ARROW, left_out, legend, number, shown, signed, title, verdicts

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
