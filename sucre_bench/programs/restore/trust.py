"""How far restored pictures can be trusted: what their records say of the water, and what the eye sees in them."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import CHANNELS, Array
from sucre_bench.errors import ANY_FAULT
from sucre_bench.imaging.display import display
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.imaging.visible_faults import Look, VisibleFault, faults_of_dive, look_at
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import track
from sucre_bench.machine.text_formats import counted
from sucre_bench.programs.restore.write import Restored
from sucre_bench.results.restorations import read_mask
from sucre_bench.results.rows import csv_text

# A water is measured if the method's judge admitted it, no channel was assumed, and far colours are wrong by less than
# this share.
_FAR = 0.3

# What a record gets beside what is stored: how many other pictures of the dive are of no use.
RUINED = "ruined"

_AT_ONCE = 4  # pictures that are looked at

_SEEN = {
    "cast": "its ground has another cast than the photograph's",
    "red": "dark or saturated red covers {value:.0%} of it",
    "rims": "coloured rims lie along edges",
    "flat": "patches of it have one flat colour",
    "turning": "its hue differs from the other pictures' by more than the photographs' do",
    "below": "{value:.0%} of a channel is darker than black",
}
# Faults that make a picture useless, from so many times their limit; others may lie where nobody looks. Of 120 pictures
# of nine dives, those that the eye accepts have casts up to 1.3 times the limit.
_RUINING = {"cast": 1.5, "turning": 1.0, "below": 1.0}

_OF_HUE = ("cast", "turning")


class Trust(Enum):
    """Whether a picture can be used."""

    GOOD = "good"
    LOOK = "look"
    DO_NOT_USE = "do not use"


@dataclass(frozen=True)
class Assessed:
    """A picture's name, whether it can be used, and why not."""

    name: str
    trust: Trust
    reasons: tuple[str, ...] = ()


def why_not_measured(record: Mapping[str, Any]) -> str:
    """Return why the water of a restoration's record was not measured; "" if it was."""
    if "beta" not in record:
        return "the method balances colours and measures no water"
    if record.get("solver") == "none":
        return "no water explains the views better than none, so it shows the photograph's colours, balanced"
    if ruined := record.get(RUINED):
        return f"water ruins {counted(ruined, 'other picture')} of the dive"
    if assumed := record.get("assumed"):
        return f"the veil of {_named(assumed)} is not determined"
    if rough := record.get("roughly_known"):
        return f"the water of {_named(rough)} is known only roughly"
    far = [
        f"{name} {error:.0%}"
        for name, error in (record.get("far_error") or {}).items()
        if error and error > _FAR
    ]
    if far:
        return f"far ground may be wrong by {', '.join(far)}"
    judged = record.get("judged")
    if not judged:
        # the judge chooses no water that predicts unseen views no better than none
        return "no views were left to judge the water on"
    if judged[0]["drift"] > judged[0]["drift_of_photograph"]:
        return "colours turn from near to far ground by more than the photograph's"
    if below := record.get("below_zero"):
        return f"{' and '.join(below)}: too many colours are darker than black"
    return ""


def _named(channels: Sequence[str]) -> str:
    return "all channels" if len(channels) == len(CHANNELS) else " and ".join(channels)


def assess(
    restored: Sequence[Restored], out: Path, original_geometry: bool, instead: Mapping[str, str]
) -> list[Assessed]:
    """Return how far each picture below OUT/pictures can be trusted, and write it to OUT/pictures.csv.

    instead: why another method than the dive's made a picture, by name.
    """

    import pandas as pd

    def seen(one: Restored) -> Look:
        picture = read_rgb(out / "pictures" / one.name)
        if original_geometry and one.lens is not None:
            return look_at(picture, read_rgb(one.photograph), None, _below(one))
        return _look(one, picture)

    faults = {one.name: found for one, found in _faults(_looks(restored, seen))}
    assessed = [_assessed(one, faults.get(one.name, ()), instead) for one in restored]
    lines = [(one.name, one.trust.value, "; ".join(one.reasons)) for one in assessed]
    table = pd.DataFrame(lines, columns=["picture", "trust", "why"])
    write_atomically(out / "pictures.csv", csv_text(table).encode())
    return assessed


def ruined(restored: Sequence[Restored]) -> dict[str, str]:
    """Return why restored images of a dive are of no use, by name, before places without depth are filled.

    Those left are compared again without them. Where half of a dive are of no use, none is trusted: nobody can tell
    which half turned. One that shows the photograph's colours is not among them: balanced colours are no better.
    """

    def seen(one: Restored) -> Look:
        image, mask = read_rgb(one.image), read_mask(one.image)
        return _look(one, image if mask is None else np.where(mask[..., None], image, np.nan))

    looks = _looks(restored, seen)
    photographs = {one.name for one in restored if one.record.get("solver") == "none"}
    whys = dict[str, str]()
    is_settled = False
    while not is_settled:
        left = {one: look for one, look in looks.items() if one.name not in whys}
        before = len(whys)
        for one, faults in _faults(left):
            ruining = [_words(fault) for fault in faults if _is_ruining(fault)]
            if ruining and one.name not in photographs:
                whys[one.name] = "; ".join(ruining)
        is_settled = len(whys) == before
    if whys and len(whys) >= len(looks) / 2:
        for one in looks:
            if one.name not in photographs:
                whys.setdefault(one.name, "half of the dive's pictures are of no use")
    return whys


def _looks(
    restored: Sequence[Restored], seen: Callable[[Restored], Look]
) -> dict[Restored, Look]:
    """Look at the pictures of a dive."""

    def look(one: Restored) -> Look:
        try:
            return seen(one)
        except ANY_FAULT:  # the picture stays; it is not looked at
            return Look()

    together = [one for one in restored if one.is_of_dive]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        looks = list(track(pool.map(look, together), "looking at pictures", len(together)))
    return dict(zip(together, looks, strict=True))


def _faults(
    looks: Mapping[Restored, Look],
) -> Iterator[tuple[Restored, tuple[VisibleFault, ...]]]:
    """Yield the faults of each picture of a dive; those of one method are compared with each other."""
    for method in {one.method for one in looks}:
        of_method = {one: look for one, look in looks.items() if one.method == method}
        yield from zip(of_method, faults_of_dive(list(of_method.values())), strict=True)


def _look(one: Restored, picture: Array) -> Look:
    beside = display(one.view.rgb, "none", one.view.encoding)
    return look_at(picture, beside, one.view.distance, _below(one))


def _below(one: Restored) -> float:
    """The share of the worst channel that is below zero before display; NaN if not known."""
    return max(one.record.get("negative_share") or [math.nan])


def _is_ruining(fault: VisibleFault) -> bool:
    return fault.value > _RUINING.get(fault.kind, math.inf) * fault.limit


def _words(fault: VisibleFault) -> str:
    return _SEEN[fault.kind].format(value=fault.value)


def _assessed(
    one: Restored, faults: Sequence[VisibleFault], instead: Mapping[str, str]
) -> Assessed:
    own = faults
    if (
        one.record.get("solver") == "none"
    ):  # with the photograph's colours, the hue is the display's
        own = [fault for fault in faults if fault.kind not in _OF_HUE]
    reasons = [_words(fault) for fault in own]
    if len(own) < len(faults):
        reasons.append("the display turns its hue")
    if one.name in instead:
        reasons.append(instead[one.name])
    if unmeasured := why_not_measured(one.record):
        reasons.append(unmeasured)
    trust = Trust.LOOK if reasons else Trust.GOOD
    if any(_is_ruining(fault) for fault in faults):
        trust = Trust.DO_NOT_USE
    return Assessed(one.name, trust, tuple(reasons))
