"""Rules for methods: every valid pixel and no other gets a colour, always the same, of what the method declares."""

import functools
import random
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.engine import python_api
from sucre_bench.errors import ANY_FAULT, NotApplicableError, SolveError, one_line
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.programs.contract.contract import Doubt, Lines, Rule, Subject, raised
from sucre_bench.programs.contract.made_scenes import (
    HARD,
    NOISE,
    TARGET,
    WATER,
    least,
    submerged,
    wall,
)
from sucre_bench.scene import Chart, Restoration, Scene, Water

# Threads may add in any order; random results differ by far more.
_ROUNDING = 1e-5

_HOLES = np.zeros(NOISE.shape[:2], dtype=bool)
_HOLES[:, :20] = True


def rules(plugin: Plugin) -> list[Rule]:
    """Return the rules for a method."""
    of_colours = [restores_a_view, colours_what_is_valid, leaves_holes]
    if "depth" in plugin.needs:
        of_colours.append(skips_what_has_no_depth)
    return [*of_colours, runs_with_least, keeps_its_eyes_off, is_deterministic]


def _restore(subject: Subject, scene: Scene) -> Restoration:
    return python_api.restore(subject.make(), scene, scene[TARGET])


@functools.lru_cache(maxsize=1)
def _plain(subject: Subject) -> Restoration:
    """The restoration of the wall of noise in water."""
    return _restore(subject, submerged())


def _rich(**other: Any) -> Scene:
    """The wall of noise with holes in its depth, and a chart on it; other: what is not as usual."""
    return wall(**{"holes": _HOLES, "charts": [_chart(4)], **other})


@functools.lru_cache(maxsize=1)
def _of_rich(subject: Subject) -> Restoration:
    return _restore(subject, _rich())


def _chart(left: float) -> Chart:
    return Chart("c", "dgk", np.array([[left, 4], [left + 30, 4], [left + 30, 24], [left, 24]]))


def restores_a_view(subject: Subject) -> Lines:
    """Restores a view of noise in water."""
    _plain(subject)
    return iter(())


def colours_what_is_valid(subject: Subject) -> Lines:
    """Gives every valid pixel a finite colour, whatever the image."""
    for name, rgb in HARD.items():
        try:
            image = _restore(subject, wall(rgb)).image
        except SolveError as reason:
            yield Doubt(
                f"{name}: nothing is restored, {one_line(reason)}; fine where no answer has a meaning"
            )
            continue
        except ANY_FAULT as fault:
            said = f"{name}: {raised(subject, fault)}"
            # networks with many strides cannot restore a thumbnail
            yield Doubt(said) if name == "tiny" else said
            continue
        finite, no_number = np.isfinite(image).all(axis=-1), np.isnan(image)
        if bad := (~finite).sum():
            yield f"{name}: {bad} of {finite.size} valid pixels get no finite colour; guard what divides"
        if odd := (no_number.any(axis=-1) & ~no_number.all(axis=-1)).sum():
            yield f"{name}: {odd} pixels are NaN in some channels only; a pixel has a colour or none"


def leaves_holes(subject: Subject) -> Lines:
    """Gives no colour where there is no depth, if it needs depth; else one everywhere."""
    result = _of_rich(subject)
    if "depth" not in subject.plugin.needs:
        if missing := (~result.valid).sum():
            yield f"{missing} pixels get no colour; without a need of depth every pixel of the image has one"
        return
    coloured = np.isfinite(result.image[_HOLES]).any(axis=-1)
    if coloured.any():
        remedy = 'set image[~view.valid] = np.nan, or leave "depth" out of needs'
        yield f"{coloured.sum()} of {coloured.size} pixels without depth get a colour; {remedy}"


def skips_what_has_no_depth(subject: Subject) -> Lines:
    """Skips a view without depth, with the reason."""
    remedy = 'raise NotApplicableError(f"{view.name}: no pixel has depth")'
    try:
        _restore(subject, wall(holes=np.ones_like(_HOLES)))
    except NotApplicableError as reason:
        if not (str(reason).startswith(TARGET) and "depth" in str(reason)):
            yield f"the reason is '{one_line(reason)}', which names not the view or not the depth; {remedy}"
    except Exception as fault:
        yield f"ends in {one_line(fault).split('; ')[0]}; {remedy}"
    else:
        yield f"restores it all the same; {remedy}"


def runs_with_least(subject: Subject) -> Lines:
    """Runs with no more than it declares in needs=."""
    try:
        _restore(subject, least(_rich(), subject.plugin.needs))
    except NotApplicableError:
        raise
    except Exception as fault:
        _of_rich(subject)  # raises if the method fails there too: then no need is missing
        has = " and ".join(sorted(subject.plugin.needs)) or "nothing but an image"
        yield f"a view with {has}: {one_line(fault).split('; ')[0]}; add what it uses to needs="


# What no method may read unless it declares it -> the wall with another one.
_OTHERS: dict[str, dict[str, Any]] = {
    "reference": {"reference": NOISE[::-1]},
    "charts": {"charts": [_chart(20)]},
    "truth": {
        "water": Water(WATER.veiling_light * 0.5, WATER.attenuation * 2, WATER.backscatter * 2)
    },
}


def _is_same_with(subject: Subject, **other: Any) -> bool:
    """Whether the result does not change with the wall."""
    try:
        image = _restore(subject, _rich(**other)).image
    except SolveError:
        image = np.full_like(NOISE, np.nan)
    return alike(_of_rich(subject).image, image)


def keeps_its_eyes_off(subject: Subject) -> Lines:
    """Reads nothing that it does not declare in needs=."""
    undeclared = [need for need in _OTHERS if need not in subject.plugin.needs]
    every = {name: value for need in undeclared for name, value in _OTHERS[need].items()}
    if _is_same_with(subject, **every) or not _is_same_with(subject):
        # a random result depends on no input
        return
    for need in undeclared:
        if not _is_same_with(subject, **_OTHERS[need]):
            yield f"its result changes with the {need}, which it is judged by; leave it alone, or add to needs="


def alike(one: Array, other: Array) -> bool:
    """Whether two images are equal within the rounding of sums, NaN at the same places."""
    return one.shape == other.shape and np.allclose(
        one, other, rtol=0, atol=_ROUNDING, equal_nan=True
    )


def is_deterministic(subject: Subject) -> Lines:
    """Gives the same result twice, whatever the seeds."""
    one = _plain(subject).image
    np.random.random()  # a plugin that draws from the common states gets other numbers
    random.random()
    other = _restore(subject, submerged()).image
    if not alike(one, other):
        with np.errstate(invalid="ignore"):
            difference = np.nan_to_num(np.abs(one - other), posinf=0).max()
        remedy = "seed a generator of its own, np.random.default_rng(self.seed), and keep nothing from view to view"
        yield f"the second time differs by up to {difference:.2g}; {remedy}"
