"""Sweeps on a SLURM cluster: ``sucre-bench run -m hydra/launcher=slurm``, through submitit.

Hydra's own launcher for SLURM asks ``sacct``, without which a killed job hangs the sweep, and gives up all jobs if one
fails. This one asks ``squeue``, which the controller itself answers, waits for every job, and reports each.
"""
