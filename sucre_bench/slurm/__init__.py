"""Sweeps on a SLURM cluster: ``sucre-bench run -m hydra/launcher=slurm``, through submitit.

Hydra's own launcher for it asks ``sacct``, without which a killed job hangs the sweep, and gives up all jobs at the
first that fails. This one asks ``squeue``, which the controller itself answers, waits for every job, and says what
became of each.
"""

from __future__ import annotations

__all__ = ["register"]


def register() -> None:
    """Make the launcher known to Hydra as `slurm`, and in the place of Hydra's own, `submitit_slurm`."""
    from hydra.core.config_store import ConfigStore
    from hydra.core.plugins import Plugins

    from sucre_bench.slurm.launcher import Launcher
    from sucre_bench.slurm.settings import Settings

    known = Plugins.instance().class_name_to_class  # by now Hydra's plugins have stored what ours replaces
    known[Settings._target_] = Launcher
    for name in ("slurm", "submitit_slurm"):
        ConfigStore.instance().store(group="hydra/launcher", name=name, node=Settings, provider="sucre_bench")
