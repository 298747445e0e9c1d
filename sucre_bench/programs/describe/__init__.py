"""Describes the data of a scene and finds faults in them, before any method runs.

In: views, read once at reduced size. Out: `Described`, with facts of each view, overlaps, faults and a contact sheet.
"""
