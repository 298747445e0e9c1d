"""Metrics, one subject a file or folder.

| file | subject |
|---|---|
| `similarity.py`, `colours.py` | against a reference: psnr, ssim; errors of the computed colours, and dE00 |
| `chart_colours.py` | against a colour chart: psi, de00, neutral, hue |
| `water.py` | the water, against the true one |
| `uciqe.py`, `uiqm/` | one picture alone, as people like it |
| `faults.py`, `seams.py`, `shares_and_counts.py` | one picture alone: what is wrong with it; its coverage |
| `across_views.py`, `matches.py` | several restored views of a scene |
| `distances.py` | distances of charts and views |
| `new_views.py` | views that a rendering method did not see in training |
"""
