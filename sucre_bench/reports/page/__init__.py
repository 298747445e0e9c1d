"""The results page: one static file made from the table and the pictures, which opens from disk without a network."""

from sucre_bench.reports.page.write_page import write

__all__ = ["write"]
