"""One page over many bundles: a lab's board.

In: opened bundles with what `verify` found. Out: index.html, with a table for each dataset, and the bundles beside it.
"""
