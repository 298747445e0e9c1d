"""Sweeps on a SLURM cluster: ``sucre-bench run -m hydra/launcher=slurm``, through submitit.

Hydra's own launcher for it asks ``sacct``, without which a killed job hangs the sweep, and gives up all jobs at the
first that fails. This one asks ``squeue``, which the controller itself answers, waits for every job, and says what
became of each.
"""

from __future__ import annotations

__all__ = ["register"]


def register() -> None:
    """Let Hydra find the launcher's class, which is no plugin in a package of Hydra's."""
    from hydra.core.plugins import Plugins

    from sucre_bench.engine.slurm.launcher import Launcher
    from sucre_bench.jobs.slurm_settings import Settings

    Plugins.instance().class_name_to_class[Settings._target_] = Launcher
