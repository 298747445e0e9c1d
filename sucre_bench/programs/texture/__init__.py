"""Makes a coloured surface of a scene: depth maps fused into points or a mesh, in the colours of a method.

In: the views of a results folder. Out: a `Model`, a .ply or .glb file, and a picture.
"""
