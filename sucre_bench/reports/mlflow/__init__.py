"""mlflow, as a sink: it is told what an output folder holds, once the work is done, and may fail without harm.

What a command left is a parent run; every dataset and method in it is a child run with its parameters, scores and
pictures, the dataset as its input and the method as its model. What is there already is not told again.
"""

from sucre_bench.reports.mlflow.connection import default_uri, open_ui, runs_page
from sucre_bench.reports.mlflow.runs import log

__all__ = ["default_uri", "log", "open_ui", "runs_page"]
