"""What people look at, made of rows and files: the page, tables and figures of a paper, mlflow."""
