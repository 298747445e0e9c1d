"""Marks colour charts in images: by a detector, by hand on a page in the browser, and by the scene's geometry.

In: views. Out: charts.json of the scene.
"""
