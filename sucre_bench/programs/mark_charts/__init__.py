"""Marking colour charts in images: by a detector, by hand in a page of this machine's browser, by the geometry."""
