"""Writes restored pictures for use: whole, under the photographs' names, in their formats, with their metadata.

In: photographs, and a results folder where the engine restored them. Out: the pictures and a contact sheet.
"""
