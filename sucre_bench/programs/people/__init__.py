"""A people's study: which restorations people prefer, in pairs and without names.

In: a results folder, then the files of votes that the page saves. Out: a page to judge pairs with, Bradley-Terry
scores, and how far observers and metrics agree with them.
"""
