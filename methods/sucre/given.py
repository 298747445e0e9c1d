"""Water that is known already: from a file, from an earlier run, or the truth of a made scene."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.errors import InputError
from sucre_bench.scene import Array, Scene, View

__all__ = ["water_of"]

_NAMES = ("B", "beta", "gamma")


def water_of(source: str, scene: Scene, view: View) -> Array:
    """Return B, beta, gamma (rows) of RGB (columns), (3, 3) float64.

    source: "truth"; a .json or .npz file that holds B, beta and gamma, three numbers each; or a folder with such a
    file for each view, named after its stem, as a run leaves it in restored/. Raises InputError, naming the file.
    """
    if source == "truth":
        if scene.water is None:
            raise InputError(
                f"water=truth: the scene '{scene.name}' does not know its water; give a file, or water=own"
            )
        water = scene.water
        return np.array([water.veiling_light, water.attenuation, water.backscatter], dtype=np.float64)
    path = Path(source).expanduser()
    if path.is_dir():
        stem = path / Path(view.name).stem
        path = next((p for p in (stem.with_suffix(".json"), stem.with_suffix(".npz")) if p.exists()), stem)
    try:
        values: Any = np.load(path, allow_pickle=False) if path.suffix == ".npz" else json.loads(path.read_text())
        water_values = np.array([values[name] for name in _NAMES], dtype=np.float64)
    except FileNotFoundError:
        raise InputError(
            f"{path}: no such file; water= takes own, shared, truth, a .json or .npz file, or a folder of them"
        ) from None
    except (OSError, ValueError, KeyError, TypeError, IndexError) as fault:
        raise InputError(f"{path}: does not hold B, beta and gamma ({fault}); give three numbers of each") from fault
    if water_values.shape != (3, 3) or not np.isfinite(water_values).all():
        raise InputError(f"{path}: B, beta and gamma must be three finite numbers each, red, green and blue")
    return water_values
