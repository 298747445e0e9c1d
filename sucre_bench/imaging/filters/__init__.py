"""Image filters that several methods use. If OpenCV or scikit-image has a filter, it is used here.

Planes are (H, W) and images (H, W, 3) float32 RGB in [0, 1]. Filters of colour (lab, luma, saliency, white_balance)
take gamma-encoded intensities. The other filters, pyramids, the veiling light and water work on linear intensities,
too. Nothing here changes its input.
"""
