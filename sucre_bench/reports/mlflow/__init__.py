"""Logs a command in mlflow while it runs, or a results folder later; if mlflow fails, the results stay complete.

A results folder's command is a parent run; each job, a dataset and a method with their options, is a child run. A job
that is logged already goes on where it was left.
"""

from sucre_bench.reports.mlflow.live import Live
from sucre_bench.reports.mlflow.runs import log
from sucre_bench.reports.mlflow.store import Place

__all__ = ["Live", "Place", "log"]
