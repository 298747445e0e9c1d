"""A scene as a coloured surface: depth maps fused into points or a mesh, coloured as methods restored the views."""
