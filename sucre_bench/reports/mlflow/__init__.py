"""Logs results folders in mlflow, after the work is done; if mlflow fails, the results stay complete.

A command is a parent run; each dataset and method in it is a child run with its parameters, scores and pictures. Rows
that are logged already are not logged again.
"""

from sucre_bench.reports.mlflow.runs import log
from sucre_bench.reports.mlflow.store import check_port, default_uri, is_logged, open_ui, runs_page

__all__ = ["check_port", "default_uri", "is_logged", "log", "open_ui", "runs_page"]
