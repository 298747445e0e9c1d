"""Image steps that several restorers take, each written once; what OpenCV or scikit-image has is theirs.

Planes are (H, W) and images (H, W, 3) float32 RGB in [0, 1]. What is a matter of colour (lab, luma, saliency,
white_balance) takes gamma-encoded ones; filters, pyramids, the veiling light and water work on linear intensities, too.
Nothing here changes its input.
"""
