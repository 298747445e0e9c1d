"""One picture: encoding, display, CIELAB, image files, charts, filters."""
