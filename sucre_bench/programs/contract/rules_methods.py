"""Rules for methods: every valid pixel and no other gets a colour, and the process is not changed."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.engine import python_api
from sucre_bench.errors import ANY_FAULT, NotApplicableError, SolveError, one_line
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.programs.contract.contract import Finding, Rule, Subject, breach, doubt, note, raised
from sucre_bench.programs.contract.made_scenes import HARD, NOISE, TARGET, WATER, least, submerged, wall
from sucre_bench.programs.contract.process_state import watched
from sucre_bench.scene import Chart, Plane, Restoration, Scene, Water

_PLANES: tuple[Plane, ...] = ("rgb", "depth", "reference")
_LASTING = 60.0  # seconds for one view of the made scene, .3 megapixels: a dive of 500 views then takes a night
_CLIPPED = 0.05  # share of values
# Threads may add in any order; random results differ by far more.
_ROUNDING = 1e-5

_HOLES = np.zeros(NOISE.shape[:2], dtype=bool)
_HOLES[:, :20] = True


def rules(plugin: Plugin) -> list[Rule]:
    """Return the rules for a method. Some changes of the process happen only in a first call, so that rule is first."""
    of_depth = [leaves_holes, skips_what_has_no_depth] if "depth" in plugin.needs else [leaves_no_holes]
    of_needs = [runs_with_least, keeps_its_eyes_off, *([uses_what_it_needs] if plugin.needs else [])]
    of_result = [is_deterministic, is_the_same_elsewhere, tells_what_can_be_kept, restores_a_scene]
    return [leaves_the_process, leaves_its_input, colours_what_is_valid, *of_depth, *of_needs, *of_result]


def _restore(subject: Subject, scene: Scene) -> Restoration:
    return python_api.restore(subject.make(), scene, scene[TARGET])


def _plain(subject: Subject) -> Restoration:
    """The restoration of the wall of noise in water."""
    if "plain" not in subject.kept:
        subject.kept["plain"] = _restore(subject, submerged())
    return subject.kept["plain"]


def _rich(**other: Any) -> Scene:
    """The wall of noise with holes in its depth, and a chart on it; other: what is not as usual."""
    return wall(**{"holes": _HOLES, "charts": [_chart(4)], **other})


def _of_rich(subject: Subject) -> tuple[Scene, Restoration]:
    if "rich" not in subject.kept:
        scene = _rich()
        subject.kept["rich"] = scene, _restore(subject, scene)
    return subject.kept["rich"]


def _chart(left: float) -> Chart:
    return Chart("c", "dgk", np.array([[left, 4], [left + 30, 4], [left + 30, 24], [left, 24]]))


def leaves_the_process(subject: Subject) -> Iterator[Finding]:
    """Changes nothing in the process: random states, threads, settings."""
    subject.make()  # imports what it requires
    with watched() as changes:
        subject.kept["plain"] = _restore(subject, submerged())
    yield from changes


def leaves_its_input(subject: Subject) -> Iterator[Finding]:
    """Does not change its input."""
    scene, result = _of_rich(subject)
    for view, fresh in zip(scene, _rich(), strict=True):
        for plane in _PLANES:
            now = np.asarray(getattr(view, plane))
            if not np.array_equal(now, np.asarray(getattr(fresh, plane))) or now.flags.writeable:
                yield breach(f"{plane} of {view.name} is changed or unlocked; work on a copy, view.{plane}.copy()")
            elif np.shares_memory(now, result.image) and result.image.flags.writeable:
                yield breach(f"its image is {plane} of {view.name} itself, unlocked; return a copy of it")


def colours_what_is_valid(subject: Subject) -> Iterator[Finding]:
    """Gives every valid pixel a finite colour, whatever the image."""
    heard = set[str]()  # a fault of every image is reported for the first
    for name, rgb in HARD.items():
        try:
            image = _restore(subject, wall(rgb)).image
        except SolveError as reason:
            yield doubt(f"{name}: nothing is restored, {one_line(reason)}; fine where no answer has a meaning")
            continue
        except ANY_FAULT as fault:
            if (said := raised(subject, fault)) not in heard:
                yield breach(f"{name}: {said}")
            heard.add(said)
            continue
        bad = ~np.isfinite(image).all(axis=-1)
        if bad.any():
            yield breach(f"{name}: {bad.sum()} of {bad.size} valid pixels get no finite colour; guard what divides")
        odd = np.isnan(image).any(axis=-1) & ~np.isnan(image).all(axis=-1)
        if odd.any():
            yield breach(f"{name}: {odd.sum()} pixels are NaN in some channels only; a pixel has a colour or none")


def leaves_holes(subject: Subject) -> Iterator[Finding]:
    """Gives no colour where there is no depth."""
    coloured = np.isfinite(_of_rich(subject)[1].image[_HOLES]).any(axis=-1)
    if coloured.any():
        yield breach(
            f"{coloured.sum()} of {coloured.size} pixels without depth get a colour; set image[~view.valid] = np.nan, "
            'or leave "depth" out of needs'
        )


def skips_what_has_no_depth(subject: Subject) -> Iterator[Finding]:
    """Skips a view without depth, with the reason."""
    remedy = 'raise NotApplicableError(f"{view.name}: no pixel has depth")'
    try:
        _restore(subject, wall(holes=np.ones_like(_HOLES)))
    except NotApplicableError as reason:
        if not (str(reason).startswith(TARGET) and "depth" in str(reason)):
            yield breach(f"the reason is '{one_line(reason)}', which names not the view or not the depth; {remedy}")
    except Exception as fault:
        yield breach(f"ends in {one_line(fault).split('; ')[0]}; {remedy}")
    else:
        yield breach(f"restores it all the same; {remedy}")


def leaves_no_holes(subject: Subject) -> Iterator[Finding]:
    """Colours the whole image, whatever the depth."""
    missing = ~_of_rich(subject)[1].valid
    if missing.any():
        yield breach(f"{missing.sum()} pixels get no colour; without a need of depth every pixel of the image has one")


def runs_with_least(subject: Subject) -> Iterator[Finding]:
    """Runs with no more than it declares in needs=."""
    try:
        _restore(subject, least(_rich(), subject.plugin.needs))
    except NotApplicableError:
        raise
    except Exception as fault:
        if "read-only" in str(fault):
            raise  # it writes into its input, whatever it needs
        has = " and ".join(sorted(subject.plugin.needs)) or "nothing but an image"
        yield breach(f"a view with {has}: {one_line(fault).split('; ')[0]}; add what it uses to needs=")


# An entry of `Scene.has` -> the wall with another one.
_OTHERS: dict[str, dict[str, Any]] = {
    "depth": {"slant": 1.0},
    "poses": {"nearer": 0.5},
    "reference": {"reference": NOISE[::-1]},
    "charts": {"charts": [_chart(20)]},
    "truth": {"water": Water(WATER.veiling_light * 0.5, WATER.attenuation * 2, WATER.backscatter * 2)},
}


def keeps_its_eyes_off(subject: Subject) -> Iterator[Finding]:
    """Reads nothing that it does not declare in needs=."""
    first = _of_rich(subject)[1].image
    undeclared = [need for need in ("reference", "charts", "truth") if need not in subject.plugin.needs]
    every = {name: value for need in undeclared for name, value in _OTHERS[need].items()}
    if alike(first, _other(subject, every)) or not alike(
        first, _other(subject, {})
    ):  # a random result depends on no input
        return
    for need in undeclared:
        if not alike(first, _other(subject, _OTHERS[need])):
            yield breach(f"its result changes with the {need}, which it is judged by; leave it alone, or add to needs=")


def uses_what_it_needs(subject: Subject) -> Iterator[Finding]:
    """Uses what it declares in needs=."""
    first = _of_rich(subject)[1].image
    for need in sorted(subject.plugin.needs & set(_OTHERS)):
        if alike(first, _other(subject, _OTHERS[need])):
            yield doubt(f"its result is the same with other {need}; leave it out of needs= if it is not used")


def _other(subject: Subject, other: dict[str, Any]) -> Array:
    try:
        return _restore(subject, _rich(**other)).image
    except SolveError:
        return np.full_like(NOISE, np.nan)


def alike(one: Array, other: Array) -> bool:
    """Whether two images are equal within the rounding of sums, NaN at the same places."""
    return one.shape == other.shape and np.allclose(one, other, rtol=0, atol=_ROUNDING, equal_nan=True)


def is_deterministic(subject: Subject) -> Iterator[Finding]:
    """Gives the same result twice, whatever the seeds."""
    first = _plain(subject).image
    with watched():  # alters the random states
        second = _restore(subject, submerged()).image
    subject.kept["is random"] = not alike(first, second)
    if subject.kept["is random"]:
        yield breach(
            f"the second time differs by up to {_difference(first, second):.2g}; seed a generator of its own, "
            "np.random.default_rng(self.seed), and keep nothing from call to call"
        )


def is_the_same_elsewhere(subject: Subject) -> Iterator[Finding]:
    """Gives the same result in another process."""
    from sucre_bench.programs.contract.fresh_process import restored

    if subject.kept.get("is random"):
        raise NotApplicableError("it does not give the same twice here")
    here = _plain(subject).image
    (there,) = restored([subject])
    if not alike(here, there):
        yield breach(
            f"another process differs by up to {_difference(here, there):.2g}; iterate over sorted things, not sets, "
            "and keep nothing from view to view"
        )


def _difference(one: Array, other: Array) -> float:
    both = np.isfinite(one) & np.isfinite(other)
    return float(np.abs(one[both] - other[both]).max()) if both.any() else float("nan")


def tells_what_can_be_kept(subject: Subject) -> Iterator[Finding]:
    """Gives water, confidence and info in the right form."""
    result = _plain(subject)
    shape = result.image.shape[:2]
    if result.confidence is not None and np.asarray(result.confidence).shape != shape:
        yield breach(f"confidence is {np.asarray(result.confidence).shape}; it is a number a pixel, {shape}")
    for name in ("veiling_light", "attenuation", "backscatter") if result.water else ():
        values = np.asarray(getattr(result.water, name))
        if values.shape != (3,) or np.isinf(values).any():
            yield breach(f"water.{name} is {values}; give three numbers, NaN for what is not estimated")
    kept = {key: value for key, value in result.info.items() if key != "true_water"}
    try:
        json.dumps(kept, default=str)
    except (TypeError, ValueError) as fault:
        yield breach(f"info cannot be written as JSON, {fault}; keep text, numbers and lists in it")


def restores_a_scene(subject: Subject) -> Iterator[Finding]:
    """Restores a view of a whole scene."""
    if not subject.on:
        raise NotApplicableError("no scene is chosen; name a dataset with --on")
    method = subject.make()
    scene = next(python_api.load_scenes(subject.on))
    absent = subject.plugin.needs - scene.has
    if absent:
        raise NotApplicableError(f"{subject.on} has no {' and '.join(sorted(absent))}; name another dataset with --on")
    if hasattr(method, "warm_up"):
        method.warm_up()
    view = scene.views[len(scene) // 2]
    result = python_api.restore(method, scene, view)
    seconds, megapixels = result.info["seconds"], view.rgb.shape[0] * view.rgb.shape[1] / 1e6
    said = f"{seconds:.2g} s, {result.info['peak_mb']:.0f} MB"
    yield note(f"{said}, {result.valid.mean():.0%} of {megapixels:.1f} megapixels of {subject.on}")
    if seconds > _LASTING:
        yield doubt(
            f"{seconds:.0f} s for {megapixels:.1f} megapixels; work on fewer pixels, or say so in its docstring"
        )
    values = result.image[result.valid]
    outside = float(((values < 0) | (values > 1)).mean())
    if subject.plugin.display == "none" and outside > _CLIPPED:
        yield doubt(f"{outside:.0%} of values leave [0, 1] and are clipped; see display= of @method, or clip them")
