"""Logs a command in mlflow while it runs, or a results folder later; if mlflow fails, the results stay complete.

A results folder's command is a parent run; each job, a dataset and a method with their options, is a child run. A job
that is logged already goes on where it was left.
"""
