"""Several views of one scene: which pixels of other views show a pixel's point, and in which colour.

A method calls `stored_pairs.paired`, which calls `observe.observe` if nothing is stored; that calls `pairing.match`.
`overlaps`, `geometry_faults` and `spread` say whether views fit together, and whether they tell the water.
"""
