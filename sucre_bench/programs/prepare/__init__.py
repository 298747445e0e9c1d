"""Makes a scene of a folder of photos, on the CPU.

In: photos and one known length. Out: undistorted images, a COLMAP model, depth maps, a page and prepare.json.
"""
