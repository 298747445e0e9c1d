"""Image steps that several restorers take, each written once; what OpenCV or scikit-image has is theirs.

Planes are (H, W) and images (H, W, 3) float32 RGB, gamma-encoded, in [0, 1]. Nothing here changes its input.
"""
