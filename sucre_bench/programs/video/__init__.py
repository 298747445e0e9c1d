"""Makes a video of views before and after, and measures how much colours flicker from one view to the next.

In: the views of a results folder. Out: a .webm or .mp4 file, and `Flicker` by method.
"""
