"""Several views of one scene: projecting between them, and finding the observations of each pixel."""
