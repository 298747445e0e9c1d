"""Logs results folders in mlflow, after the work is done; if mlflow fails, the results stay complete.

A command is a parent run; each dataset and method in it is a child run with its parameters, scores and
pictures, the dataset as its input and the method as its model. Rows that are logged already are not logged again.
"""

from sucre_bench.reports.mlflow.already_logged import is_logged
from sucre_bench.reports.mlflow.connection import default_uri
from sucre_bench.reports.mlflow.page import check_port, open_ui, runs_page
from sucre_bench.reports.mlflow.runs import log

__all__ = ["check_port", "default_uri", "is_logged", "log", "open_ui", "runs_page"]
