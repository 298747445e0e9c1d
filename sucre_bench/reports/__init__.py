"""Reports from rows and files: the page, tables and figures of a paper, mlflow."""
