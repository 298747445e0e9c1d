"""The options of `sucre`, in groups, and which of them go together.

Options are fields of the groups below, so that a user types `method.physical=true` whatever group it is in. Where the
water comes from decides what else may be chosen:

| way | chosen by | physical | robust | lamp=true, exposure=per_view |
|---|---|---|---|---|
| EXACT | water=own, solver=exact | yes | yes | one of them, with colours=multi_view |
| ADAM | water=own, solver=adam | no | no | no |
| CLOSED_FORM | water=own, solver=adam_closed_form | no | no | no |
| SHARED | water=shared | yes | no | no |
| KNOWN | water=truth, a file or a folder; water_from=METHOD | no effect | no | no |
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from sucre_bench import InputError
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.passes import Backend


class Way(enum.Enum):
    """How the water is found. The value holds the options that go with it and no other way."""

    EXACT = frozenset({"physical", "robust", "lamp", "exposure"}), "own"
    ADAM = frozenset[str](), "adam"
    CLOSED_FORM = frozenset[str](), "adam_closed_form"
    SHARED = frozenset({"physical"}), "shared"
    KNOWN = frozenset({"physical"}), "known"

    @property
    def options(self) -> frozenset[str]:
        return self.value[0]


@dataclass(frozen=True)
class FitOptions:
    """How the water is fitted to observations."""

    solver: Literal["exact", "adam", "adam_closed_form"] = "exact"
    """exact: the minimum; adam: the paper's steps on all unknowns; adam_closed_form: the paper's steps on the water,
    with the best colours at each."""

    footprint: bool = True
    """Fit the water to observations that average the same ground as the farthest view; colours stay sharp. false: fit
    single pixels, which makes attenuation too high. Needs solver=exact, and water=own or shared."""

    physical: bool = False
    """Keep colours above zero, up to noise; a veil brighter than the darkest pixels raises the cost (solver=exact)."""

    robust: bool = False
    """Give less weight to observations that do not fit: animals that move, pixels paired wrongly (solver=exact)."""

    exposure: Literal["auto", "constant", "per_view"] = "auto"
    """per_view: fit one gain for each view with the water, for cameras that expose automatically (solver=exact);
    constant: one exposure for all views; auto: per_view only if exposures differ, gains explain the observations far
    better, and attenuation is lower with them (footprint=true)."""

    lamp: bool | Literal["auto"] = "auto"
    """true: fit a lamp that is fixed to the camera and is the only light (solver=exact), as in the deep sea; false:
    none; auto: only if light falls off across the images, a lamp or a polynomial of the place, whichever explains the
    observations better (footprint=true)."""

    steps: int = 200
    """Steps of Adam."""

    lr: float = 0.05
    """Adam's learning rate."""

    seed: int = 0
    """Seed of the sample of pixels that the fit starts on."""


@dataclass(frozen=True)
class PairingOptions:
    """Which pixels of other views show a pixel of the target, and in what encoding."""

    pairing: Literal["mutual", "depth"] = "mutual"
    """mutual: the paper's rule, pixels that project onto each other; depth: points whose depths agree, with
    interpolated colours, and more observations if views differ in scale."""

    tolerance: float = 0.03
    """Largest difference of depths with pairing=depth, as a share of the depth."""

    encoding: Literal["view", "linear"] = "view"
    """Fit intensities as stored, as the paper does, or decoded to linear light (sRGB)."""

    pairs: Path | None = None
    """Folder that stores observations on disk, for less memory and for the next run; null: store none."""


@dataclass(frozen=True)
class WaterOptions:
    """Where the water comes from."""

    water: Literal["own", "shared", "truth"] | str = "own"
    """own: fit each image; shared: fit many images of the scene together; truth: the dataset's true water; a .json or
    .npz file with B, beta and gamma; or a folder with one such file for each view, like restored/ of an earlier run."""

    water_from: str = ""
    """Name of a method that estimates the water of each image, instead of the fit. It runs with its default options."""

    shared_views: int = 40
    """Most images that water=shared is fitted to, spread evenly over the scene."""


@dataclass(frozen=True)
class ColourOptions:
    """How colours follow from the water."""

    colours: Literal["multi_view", "single_view"] = "multi_view"
    """multi_view: compute each colour from all its observations; single_view: from the image's own intensity alone,
    with the same water."""

    prior: bool = False
    """Take noise out of colours: in each window by the channel that is known best, then towards the image's mean colour
    at their own brightness, in proportion to their noise. The three channels are treated together."""

    edges: bool = False
    """Where other views contradict the image, at edges of depth and of texture and on animals, show what the image
    shows (colours=multi_view; no effect with robust)."""

    even: bool = False
    """Remove dots, lines and steps that appear where a view misses some pixels between those that it shows
    (colours=multi_view)."""


@dataclass(frozen=True)
class ComputeOptions:
    """Where to compute, and what to record."""

    backend: Backend = "auto"
    """Array library: numba, torch, jax, or numpy in float64; auto: numba, but torch with device=cuda."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU, when there is one, for torch, jax and solver=adam, else the CPU."""

    residuals: bool = False
    """Write residual statistics of the fit, and some points over distance, to <view>.json, for figures."""


def way_of(options: Any) -> Way:
    """Return how the water is found with these options of `sucre`."""
    if options.water == "shared":
        return Way.SHARED
    if options.water_from or options.water != "own":
        return Way.KNOWN
    return {"exact": Way.EXACT, "adam": Way.ADAM, "adam_closed_form": Way.CLOSED_FORM}[options.solver]


def typed(options: Any, name: str, value: bool | str) -> str:
    """Return an option as a user types it, "method.lamp=true".

    It is empty where it would change nothing, or does not go with the other options.
    """
    try:
        is_new = replace(options, **{name: value}) != options
    except InputError:
        return ""
    if not is_new or (name == "physical" and way_of(options) is Way.KNOWN):
        return ""
    return f"method.{name}={str(value).lower()}"


def check(options: Any, method: str) -> None:
    """Raise InputError for values out of range, and for options that do not go together; method: its name."""
    for name in ("tolerance", "shared_views", "steps", "lr"):
        if not getattr(options, name) > 0:
            raise InputError(f"{method}.{name}: {getattr(options, name)} must be positive")
    if options.tolerance >= 1:
        raise InputError(f"{method}.tolerance: {options.tolerance} must be below 1, it is a share of the depth")
    if options.seed < 0:
        raise InputError(f"{method}.seed: {options.seed} must not be negative")
    if options.pairs is not None and options.pairs.exists() and not options.pairs.is_dir():
        raise InputError(f"{options.pairs}: is no folder; give a folder in {method}.pairs")
    if not options.water:
        raise InputError(f"{method}.water: is empty; use own, shared, truth, a file or a folder")
    given = [
        f"{name}={value}" for name in ("water", "water_from") if (value := getattr(options, name)) not in ("", "own")
    ]
    if len(given) > 1:
        raise InputError(f"{method}.water_from: the water is given twice, {' and '.join(given)}; leave one out")
    if options.lamp != "auto" and not isinstance(options.lamp, bool):
        raise InputError(f"{method}.lamp: '{options.lamp}' is not a choice; use true, false or auto")
    extras = [name for name in ("physical", "robust", "lamp") if getattr(options, name) is True]
    extras += ["exposure"] if options.exposure == "per_view" else []
    if extras and options.solver != "exact":
        off = "constant" if extras[0] == "exposure" else "false"
        fault = f"goes with {method}.solver=exact, not with {method}.solver={options.solver}"
        raise InputError(f"{method}.{extras[0]}: {fault}; give {method}.{extras[0]}={off}")
    if given and options.solver != "exact":
        raise InputError(f"{method}.{given[0]}: leaves nothing to {method}.solver={options.solver}; leave one out")
    for name in extras:
        if name not in way_of(options).options:
            raise InputError(f"{method}.{name}: is found with the image's own water; leave out {method}.{given[0]}")
    if options.lamp is True and options.fill:
        raise InputError(f"{method}.fill: a lamp lights pixels without depth in an unknown way; use {method}.lamp=auto")
    alone = [name for name in ("lamp", "exposure") if name in extras]
    if len(alone) == 2:
        raise InputError(
            f"{method}.exposure: a lamp explains the same differences of light; leave out {method}.lamp=true"
        )
    if alone and options.colours == "single_view":
        raise InputError(
            f"{method}.{alone[0]}: is found with colours of all views; leave out {method}.colours=single_view"
        )
