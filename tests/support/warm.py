"""Imports what nearly every run imports: for the process that commands of tests are forked from."""

from __future__ import annotations

import cv2  # noqa: F401
import pandas  # noqa: F401
import pyarrow.parquet  # noqa: F401
import scipy.stats  # noqa: F401

import sucre_bench.commands.run
import sucre_bench.commands.run_summary
import sucre_bench.compare
import sucre_bench.engine.job
import sucre_bench.engine.run  # noqa: F401
from sucre_bench.jobs import compose_jobs

compose_jobs.jobs(["method=gray_world"], multirun=False)  # finds all plugins, and Hydra's
