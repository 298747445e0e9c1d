"""From a folder of photos to a scene: undistorted images, a COLMAP model and depth maps, on any computer's CPU."""
