"""sucre_bench: a dataset yields scenes, a method restores a view, a metric scores it, the bench compares.

import sucre_bench as sb

scene = sb.load_scene("colmap", root="dive/")
result = sb.restore("gray_world", scene, scene["a.png"])
rows = sb.score(result, scene["a.png"], metrics=["psi"])
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "1.0.0rc1"

# Where each public name lives: nothing is imported until it is asked for, so that the command line answers at once.
_HOME = {
    "sucre_bench.engine.python_api": (
        "Restored",
        "list_datasets",
        "list_experiments",
        "list_methods",
        "list_metrics",
        "load_scene",
        "load_scenes",
        "restore",
        "score",
    ),
    "sucre_bench.engine.compare_methods": ("Compared", "compare_methods"),
    "sucre_bench.engine.hydra_run": ("run_config",),
    "sucre_bench.results.rows": ("wide",),
    "sucre_bench.degrade": ("Degradation", "degraded"),
    "sucre_bench.errors": (
        "InputError",
        "NotApplicableError",
        "PluginError",
        "SolveError",
        "SucreBenchError",
    ),
    "sucre_bench.programs.contract": ("breaches",),
    "sucre_bench.plugins": ("dataset", "method", "metric", "load_file"),
    "sucre_bench.machine.progress": ("track",),
    "sucre_bench.camera": ("Camera",),
    "sucre_bench.restored_pair": ("RestoredPair",),
    "sucre_bench.scene": (
        "Arrays",
        "Chart",
        "Pixels",
        "Restoration",
        "Scene",
        "Score",
        "View",
        "Water",
    ),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [*_MODULE, "__version__"]

if TYPE_CHECKING:
    from sucre_bench.camera import Camera as Camera
    from sucre_bench.degrade import Degradation as Degradation, degraded as degraded
    from sucre_bench.engine.compare_methods import (
        Compared as Compared,
        compare_methods as compare_methods,
    )
    from sucre_bench.engine.hydra_run import run_config as run_config
    from sucre_bench.engine.python_api import (
        Restored as Restored,
        list_datasets as list_datasets,
        list_experiments as list_experiments,
        list_methods as list_methods,
        list_metrics as list_metrics,
        load_scene as load_scene,
        load_scenes as load_scenes,
        restore as restore,
        score as score,
    )
    from sucre_bench.errors import (
        InputError as InputError,
        NotApplicableError as NotApplicableError,
        PluginError as PluginError,
        SolveError as SolveError,
        SucreBenchError as SucreBenchError,
    )
    from sucre_bench.machine.progress import track as track
    from sucre_bench.plugins.plugin import (
        dataset as dataset,
        method as method,
        metric as metric,
    )
    from sucre_bench.plugins.registry import load_file as load_file
    from sucre_bench.programs.contract import breaches as breaches
    from sucre_bench.restored_pair import RestoredPair as RestoredPair
    from sucre_bench.results.rows import wide as wide
    from sucre_bench.scene import (
        Arrays as Arrays,
        Chart as Chart,
        Pixels as Pixels,
        Restoration as Restoration,
        Scene as Scene,
        Score as Score,
        View as View,
        Water as Water,
    )


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module 'sucre_bench' has no attribute '{name}'")
    return getattr(import_module(_MODULE[name]), name)
