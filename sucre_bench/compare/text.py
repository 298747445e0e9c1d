"""A comparison as text: terminal, Markdown, LaTeX, HTML, CSV, JSON, and a sentence for each verdict."""

from sucre_bench.compare.decisive_columns import decisive
from sucre_bench.compare.documents import Format, as_text
from sucre_bench.compare.numbers import NUMBERS, number, signed
from sucre_bench.compare.terminal import as_blocks, as_table
from sucre_bench.compare.words import ARROW, left_out, legend, shown, title, verdict_text

__all__ = [
    "ARROW",
    "NUMBERS",
    "Format",
    "as_blocks",
    "as_table",
    "as_text",
    "decisive",
    "left_out",
    "legend",
    "number",
    "shown",
    "signed",
    "title",
    "verdict_text",
]
