"""Named test sets: the pictures that papers test on, and which of them lie in a folder.

sets/NAME.csv has a row a picture. It holds its name in the dataset, its other published names, its published size, and
the prints of the photograph and of its reference, which may lack. Comments before the header say what the set is.

A print is 256 bits and a mean colour. The bits say which of the 16x16 lowest frequencies of the gray picture, brought
to 64x64 pixels, are above their median. Of 1,695 pictures of 18 folders, JPEG of quality 40, resizing to 112 pixels or
to a square changes at most 24 bits. Other pictures differ in 70 or more, neighbours in a video in 44. What 13 methods
made of 998 of them differs in at most 60, but for one picture.
"""

import csv
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import AnyArray, Array, Size
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.machine.progress import say, track
from sucre_bench.machine.text_formats import first_few

# bits in which the same picture may differ, and what a method made of it
_SAME = 24
_ALIKE = 60
_COLOURS = 4.0  # of 255: by which the same picture's mean colour may differ; JPEG changes it by 2, a restoration by 7
_SIDE = 64
_FREQUENCIES = 16
_ABOUT = ("about", "of", "source", "licence", "used_by")
_SHOWN = 4  # names in a sentence

Of = Literal["image", "reference", "either"]


class IncompleteSetError(InputError):
    """A folder does not hold all of a set. found: how many of its pictures are there."""

    found = 0


@dataclass(frozen=True, slots=True)
class Print:
    """What a picture is known by."""

    bits: bytes
    """Is 32 bytes long."""

    colour: bytes
    """The mean R, G, B in 0 to 255."""


def print_of(image: AnyArray) -> Print:
    """Return the print of a picture (H, W, 3), RGB, uint8 or in [0, 1]."""
    import cv2

    values = np.asarray(image, dtype=np.float32)
    # no copy of large pictures
    values = values if np.isfinite(values.sum()) else np.nan_to_num(values)
    small = cv2.resize(values, (_SIDE, _SIDE), interpolation=cv2.INTER_AREA)
    small = small if image.dtype == np.uint8 else small * 255
    low = cv2.dct(np.asarray(small @ np.array([0.299, 0.587, 0.114], np.float32)))[
        :_FREQUENCIES, :_FREQUENCIES
    ].ravel()
    low[0] = 0  # brightness is no structure
    colour = np.rint(small.mean(axis=(0, 1)).clip(0, 255)).astype(np.uint8)
    return Print(np.packbits(low > np.median(low[1:])).tobytes(), colour.tobytes())


@dataclass(frozen=True, slots=True)
class Member:
    """A picture of a set."""

    name: str
    other_names: tuple[str, ...]

    size: Size | None
    """Width and height as published."""

    # The prints of both, None where not public.
    image: Print | None
    reference: Print | None

    @property
    def title(self) -> str:
        """Its name, and the first of its other names."""
        return " = ".join((self.name, *self.other_names[:1]))


@dataclass(frozen=True, eq=False)
class NamedSet:
    """A test set."""

    name: str

    about: str
    """A sentence on it."""

    of: str
    """The dataset that it is a part of."""

    source: str
    licence: str

    used_by: str
    """Methods tested on it."""

    members: tuple[Member, ...]

    def as_object(self) -> dict[str, Any]:
        """Return what is known of it as plain data for lists."""
        known = sum(member.image is not None for member in self.members)
        counts = ((known, "content"), (len(self.members) - known, "name alone"))
        how = " and ".join(f"{n} by {what}" for n, what in counts if n)
        return {
            "name": self.name,
            "description": self.about,
            "pictures": len(self.members),
            "recognised": f"{how}, of {len(self.members)} pictures",
            **{key: getattr(self, key) for key in ("of", "source", "licence", "used_by")},
        }


@functools.cache
def named_sets() -> Mapping[str, NamedSet]:
    """Return the shipped sets by name."""
    tables = sorted(files(__package__).joinpath("sets").iterdir(), key=lambda file: file.name)
    sets = [
        _parsed(table.name.removesuffix(".csv"), table.read_text(encoding="utf-8"))
        for table in tables
    ]
    return {one.name: one for one in sets}


def _parsed(name: str, text: str) -> NamedSet:
    comments = [line[1:].partition(":") for line in text.splitlines() if line.startswith("#")]
    about = {key.strip(): value.strip() for key, _, value in comments}
    table = [line for line in text.splitlines() if line and not line.startswith("#")]
    members = []
    for row in csv.DictReader(table):
        size = (int(row["width"]), int(row["height"])) if row["width"] else None
        others = tuple(row["other_names"].split())
        image = _print_in(row["image"])
        members.append(Member(row["name"], others, size, image, _print_in(row["reference"])))
    said = {key: about[key] for key in _ABOUT}
    return NamedSet(name=name, members=tuple(members), **said)


def _print_in(text: str) -> Print | None:
    data = bytes.fromhex(text)
    return Print(data[:32], data[32:]) if data else None


# -- which pictures are of a set ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture that may be of a set."""

    size: Size
    """Width and height."""

    print: Print | None
    """None if the picture cannot be read."""


@dataclass(frozen=True, eq=False)
class Found:
    """The pictures of a folder that are of a set."""

    of: NamedSet

    pictures: int
    """How many the folder has."""

    members: Mapping[str, Member]
    """Those of the set, by the picture's name."""

    by_name: tuple[str, ...]
    """Pictures without a public print, known by their name alone."""

    changed: tuple[str, ...]
    """Pictures that were restored, cropped or otherwise changed."""

    twice: tuple[str, ...]
    """Pictures whose member another picture is."""

    others: tuple[str, ...]
    """Pictures of no member."""

    missing: tuple[str, ...]
    """Members without a picture."""

    resized: tuple[str, ...]
    """The pictures' sizes, if none is as published."""

    @property
    def is_whole(self) -> bool:
        """Whether the folder's pictures are the set, all of it and nothing else."""
        return bool(self.pictures == len(self.members) == len(self.of.members))

    def fullness(self) -> float:
        """Return the share that the set and the folder have in common, of all their pictures."""
        n = len(self.members)
        return n / (self.pictures + len(self.of.members) - n)

    def as_object(self) -> dict[str, Any]:
        """Return it as plain data for JSON."""
        lists = ("by_name", "changed", "twice", "others", "missing", "resized")
        return {
            "name": self.of.name,
            "pictures": self.pictures,
            "found": len(self.members),
            "whole": self.is_whole,
            **{name: list(getattr(self, name)) for name in lists},
            "text": self.sentence(),
        }

    def sentence(self) -> str:
        """Return what is found, in a line."""
        n, whole = len(self.members), len(self.of.members)
        are_its = (
            f"these are its {whole} pictures"
            if self.is_whole
            else f"{n} of {self.pictures} pictures are of it"
        )
        lists = (
            (f"of its {whole} missing", self.missing),
            ("not of it", self.others),
            ("there twice", self.twice),
            ("restored, cropped or otherwise changed", self.changed),
            ("known by name alone", self.by_name),
        )
        parts = [f"{self.of.name}: {are_its}"]
        parts += [
            f"{len(names)} {verb}: {first_few(names, _SHOWN)}" for verb, names in lists if names
        ]
        if self.resized:
            parts.append(f"they are {' and '.join(self.resized[:3])}, published at other sizes")
        return "; ".join(parts)

    def place(self) -> str:
        """Return the set, or how much of it the pictures are, as a part of a sentence."""
        n, whole = len(self.members), len(self.of.members)
        return (
            f"{self.of.name} (all {whole})"
            if self.is_whole
            else f"{n} of {self.of.name}'s {whole} pictures"
        )


def found_of(named: NamedSet, pictures: Mapping[str, Picture], of: Of = "either") -> Found:
    """Return which pictures are of a set. of: whether pictures are its photographs, its references or either."""
    from scipy.optimize import linear_sum_assignment

    names = list(pictures)
    members = named.members
    bits, off = _differences(members, [pictures[name].print for name in names], of)
    # Each picture gets a member of its own: the nearest, of pictures alike in bits that of like colours.
    rows, columns = linear_sum_assignment(np.where(bits <= _ALIKE, bits + off / 256, 1e4))
    pairs = {int(i): int(k) for i, k in zip(rows, columns, strict=True) if bits[i, k] <= _ALIKE}
    changed = tuple(
        names[i] for i, k in pairs.items() if bits[i, k] > _SAME or off[i, k] > _COLOURS
    )
    kinds = ("image", "reference") if of == "either" else (of,)
    stems = {
        _stem(member.name): k
        for k, member in enumerate(members)
        if all(getattr(member, kind) is None for kind in kinds)
    }
    free = [i for i in range(len(names)) if i not in pairs]
    named_alike = {i: stems[_stem(names[i])] for i in free if _stem(names[i]) in stems}
    pairs |= named_alike
    rest = [i for i in range(len(names)) if i not in pairs]
    copies = tuple(names[i] for i in rest if (bits[i] <= _SAME).any())
    sizes = {
        pictures[names[i]].size == members[k].size for i, k in pairs.items() if members[k].size
    }
    shown = dict.fromkeys("x".join(map(str, pictures[names[i]].size)) for i in pairs)
    return Found(
        of=named,
        pictures=len(pictures),
        members={names[i]: members[k] for i, k in sorted(pairs.items())},
        by_name=tuple(names[i] for i in named_alike),
        changed=changed,
        twice=copies,
        others=tuple(names[i] for i in rest if names[i] not in copies),
        missing=tuple(
            member.title for k, member in enumerate(members) if k not in set(pairs.values())
        ),
        resized=tuple(shown) if sizes == {False} else (),
    )


def _differences(
    members: Sequence[Member], prints: Sequence[Print | None], of: Of
) -> tuple[Array, Array]:
    """Return in how many bits, and by how much of 255 in a colour, pictures differ from members, both (P, M).

    Of a member's photograph and reference, the one that is nearer in both counts.
    """
    bits = np.full((len(prints), len(members)), 256.0)
    off = np.full((len(prints), len(members)), 255.0)
    ours = [i for i, one in enumerate(prints) if one is not None]
    for kind in ("image", "reference"):
        theirs = [k for k, member in enumerate(members) if getattr(member, kind) is not None]
        is_asked = of in (kind, "either")
        if not (is_asked and ours and theirs):
            continue
        our_bits, our_colours = _arrays([prints[i] for i in ours])
        their_bits, their_colours = _arrays([getattr(members[k], kind) for k in theirs])
        differing = np.bitwise_count(our_bits[:, None] ^ their_bits).sum(-1)
        apart = np.abs(our_colours[:, None] - their_colours).max(-1)
        at = np.ix_(ours, theirs)
        is_nearer = differing + apart < bits[at] + off[at]
        bits[at] = np.where(is_nearer, differing, bits[at])
        off[at] = np.where(is_nearer, apart, off[at])
    return bits, off


def _arrays(prints: Sequence[Any]) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.int16]]:
    """The bits (N, 32) and colours (N, 3) of prints."""
    bits = np.array([np.frombuffer(one.bits, np.uint8) for one in prints])
    colours = np.array([np.frombuffer(one.colour, np.uint8) for one in prints])
    return bits, colours.astype(np.int16)


def members_in(folder: Path, images: Sequence[str], split: str) -> list[str]:
    """Return the images of a folder that are the pictures of a set.

    Pictures are known by their content, whatever their names. If the folder has all names of the set, only these are
    read. Raises IncompleteSetError if a picture is missing, InputError if one is twice there or changed, and for a
    `split` that is no set.
    """
    if split not in named_sets():
        raise unknown_name("dataset.split", split, named_sets(), "test set")
    named = named_sets()[split]
    by_stem = {_stem(image): image for image in images}
    stems = [_stem(member.name) for member in named.members]
    if all(stem in by_stem for stem in stems):
        images = [by_stem[stem] for stem in stems]
    pictures = {}
    for image in track(images, f"looking for {split}"):
        try:
            pictures[image] = picture_of(read_rgb(folder / image))
        except InputError:
            pictures[image] = Picture((0, 0), None)  # it counts by its name
    found = found_of(named, pictures, "image")

    def fault_of(names: Sequence[str], said: str) -> str:
        shown = first_few(names, _SHOWN)
        return f"of the {len(named.members)} pictures of {split}, {len(names)} {said}: {shown}"

    if found.missing:
        source = named.source.partition(";")[0] or split
        remedy = f"copy them there, see {source}, or leave out dataset.split"
        incomplete = IncompleteSetError(fault_of(found.missing, "missing"), folder, remedy)
        incomplete.found = len(found.members)
        raise incomplete
    if found.changed:
        fault = fault_of(found.changed, "restored, cropped or changed")
        raise InputError(fault, folder, "copy the originals there")
    if found.twice:
        raise InputError(fault_of(found.twice, "there twice"), folder, "keep one of each")
    if found.resized:
        sizes = " and ".join(found.resized[:3])
        say(f"{folder}: the pictures are {sizes}, and of {split} published at other sizes")
    return sorted(found.members)


def picture_of(rgb: AnyArray) -> Picture:
    """Return what is known of a picture (H, W, 3)."""
    return Picture((rgb.shape[1], rgb.shape[0]), print_of(rgb))


def recognised_sets(pictures: Mapping[str, Picture]) -> list[Found]:
    """Return the sets of which half is there, or that half of the pictures are of, the fullest first.

    Names alone tell a set only if the pictures have nine of ten of its names.
    """
    found = []
    for named in named_sets().values():
        one = found_of(named, pictures)
        least = 0.5 * min(one.pictures, len(named.members))
        if len(one.by_name) > len(one.members) / 2:
            least = 0.9 * len(named.members)
        if len(one.members) >= max(1, least):
            found.append(one)
    return sorted(found, key=Found.fullness, reverse=True)


def _stem(name: str) -> str:
    return PurePosixPath(name.replace("\\", "/")).stem.casefold()
