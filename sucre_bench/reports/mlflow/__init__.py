"""Logs results folders in mlflow, after the work is done; if mlflow fails, the results stay complete.

A command is a parent run; each dataset and method in it is a child run with its parameters, scores and pictures. Rows
that are logged already are not logged again.
"""

from sucre_bench.reports.mlflow.page import check_port, open_ui, runs_page
from sucre_bench.reports.mlflow.runs import log
from sucre_bench.reports.mlflow.store import default_uri, is_logged

__all__ = ["check_port", "default_uri", "is_logged", "log", "open_ui", "runs_page"]
