"""What a scene's data are, and what is wrong with them: read once, at reduced size, before any method runs."""
