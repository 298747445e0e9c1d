"""Several views of one scene: which pixels of other views show a pixel's point, and in which colour."""
