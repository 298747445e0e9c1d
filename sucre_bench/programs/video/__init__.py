"""A run's views as a video, before and after, and how much a method's colours flicker from one view to the next."""
