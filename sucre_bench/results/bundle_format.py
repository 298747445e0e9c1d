"""A bundle: a results folder's scores, configuration and hashes in one ZIP file, which anyone can check.

    bundle.json        what the bundle says of itself, and the SHA-256 of every file inside and of pictures outside
    scores.csv         the score table
    config.yaml, environment.json, experiment.yaml             as far as the folder has them
    restored/<dataset>/<method label>/.../<view stem>.json     what each method told, its estimated water say
    restored/<dataset>/<method label>/.../<view stem>.png      the restored images, if they were asked for

A bundle is data of a stranger. Opening one executes nothing, unpacks nothing onto the disk, and checks number, names,
kinds and sizes of all entries before any is read. The same content gives the same bytes: entries are sorted and have
no date.
"""

import contextlib
import hashlib
import io
import json
import shutil
import stat
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypedDict

from sucre_bench.arguments import fits
from sucre_bench.arrays import DataFrame
from sucre_bench.errors import InputError, NotAFileError
from sucre_bench.machine.files import open_atomically, reading, regular
from sucre_bench.results.rows import COLUMNS, NUMBERS, csv_text, frame, is_of_common_pixels
from sucre_bench.results.table import check_values

MANIFEST = "bundle.json"
SCORES = "scores.csv"
_FORMAT = "sucre_bench bundle"
_VERSION = 1
_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that ZIP knows
_STORED = (".png", ".jpg")  # what is compressed already
_REGULAR_FILE = stat.S_IFREG | 0o644


@dataclass(frozen=True)
class Limits:
    """What a bundle may hold at most."""

    entries: int = 200_000
    """Files."""

    file_bytes: int = 1 << 28
    """Unpacked size of one picture or record."""

    table_bytes: int = 1 << 30
    """Unpacked size of one text file at the top."""

    all_bytes: int = 1 << 36
    """Unpacked size of everything."""

    ratio: float = 300.0
    """Unpacked size over packed size, of files above 1 MiB."""

    name_bytes: int = 500
    """Of a path."""


LIMITS = Limits()


class FileHash(TypedDict):
    """What identifies the content of a file."""

    sha256: str
    """In hexadecimal digits."""

    bytes: int
    """Its size."""


class _Manifest(TypedDict):
    """The content of bundle.json."""

    format: str
    version: int
    by: str
    sucre_bench: str
    inside: dict[str, FileHash]
    outside: dict[str, FileHash]


@dataclass(frozen=True, eq=False)
class Bundle:
    """An opened bundle; files are read when they are asked for."""

    path: Path

    entries: Mapping[str, int] = field(repr=False)
    """The unpacked size of every file, by its name."""

    archive: zipfile.ZipFile = field(repr=False, compare=False)

    id: str = ""
    """The first 16 digits of the SHA-256 of bundle.json, which names every other hash: it identifies the bundle."""

    by: str = ""
    """Who made it, in their own words."""

    version: str = ""
    """Of sucre_bench."""

    inside: Mapping[str, FileHash] = field(default_factory=dict)
    """The hash of every file in the bundle but bundle.json."""

    outside: Mapping[str, FileHash] = field(default_factory=dict)
    """The hashes of pictures that stayed where they were made."""

    def read(self, name: str) -> bytes:
        """Return a file's content. Raises InputError if it is not there, is damaged or has another hash."""
        try:
            return self._content(name)
        except InputError as fault:
            again = "get the bundle again from who made it"
            raise InputError(fault.without_remedy, self.path, again) from fault

    def fault_of(self, name: str) -> str:
        """Say what is wrong with a file that the bundle lists; empty if nothing is."""
        try:
            self._content(name)
        except InputError as fault:
            return fault.fault
        return ""

    def _content(self, name: str) -> bytes:
        if name not in self.entries:
            raise InputError("is missing", name)
        with reading(Path(name), ""), self.archive.open(name) as file:
            content = file.read(self.entries[name] + 1)
        if name != MANIFEST and name not in self.inside:
            raise InputError("is not in the bundle's list of files", name)
        if name != MANIFEST and hash_of(content) != self.inside[name]:
            raise InputError("is not what its hash says", name)
        return content

    @cached_property
    def rows(self) -> DataFrame:
        """The score table, as `results.read` returns it. Raises InputError if it is none."""
        return self._table[~is_of_common_pixels(self._table)].reset_index(drop=True)

    @cached_property
    def common(self) -> DataFrame:
        """The rows about common pixels, as `read_both` returns them. Raises InputError if the table is none."""
        return self._table[is_of_common_pixels(self._table)].reset_index(drop=True)

    @cached_property
    def _table(self) -> DataFrame:
        """All rows: text as it stands, numbers as numbers."""
        import pandas as pd
        from pyarrow import Table

        path = self.path / SCORES
        content = io.BytesIO(self.read(SCORES))
        with reading(path, "bundle again"):
            read = pd.read_csv(
                content, dtype="str", keep_default_na=False, usecols=list(COLUMNS)
            )
            # Not by pandas: some of its versions lose the last digits of a number.
            numbers = {name: [float(text or "nan") for text in read[name]] for name in NUMBERS}
            rows = read.assign(**numbers).astype(frame([]).dtypes.to_dict())
        check_values(path, Table.from_pandas(rows, preserve_index=False))
        return rows


def hash_of(content: bytes | Path) -> FileHash:
    """Return the hash of some bytes, or of a file."""
    if isinstance(content, bytes):
        return {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
    with content.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"sha256": digest, "bytes": content.stat().st_size}


# -- writing -----------------------------------------------------------------------------------------------


def write_bundle(
    path: Path,
    rows: DataFrame,
    files: Mapping[str, bytes | Path],
    outside: Mapping[str, FileHash],
    by: str,
    version: str,
) -> str:
    """Write a bundle and return its id. files: by their name in the bundle. Raises OutputError if that fails."""
    files = {SCORES: csv_text(rows).encode(), **files}
    about = {
        "format": _FORMAT,
        "version": _VERSION,
        "by": by,
        "sucre_bench": version,
        "inside": {name: hash_of(content) for name, content in sorted(files.items())},
        "outside": dict(sorted(outside.items())),
    }
    manifest = (json.dumps(about, indent=1, ensure_ascii=False) + "\n").encode()
    with open_atomically(path) as file, zipfile.ZipFile(file, "w") as archive:
        for name, content in sorted({MANIFEST: manifest, **files}.items()):
            entry = zipfile.ZipInfo(name, _DATE)  # no date and no owner
            entry.create_system = 3
            entry.external_attr = _REGULAR_FILE << 16
            entry.compress_type = (
                zipfile.ZIP_STORED if name.endswith(_STORED) else zipfile.ZIP_DEFLATED
            )
            source = io.BytesIO(content) if isinstance(content, bytes) else content.open("rb")
            with source, archive.open(entry, "w", force_zip64=True) as target:
                shutil.copyfileobj(source, target)
    return _id(manifest)


def _id(manifest: bytes) -> str:
    return hashlib.sha256(manifest).hexdigest()[:16]


# -- opening -----------------------------------------------------------------------------------------------


@contextlib.contextmanager
def open_bundle(path: Path, limits: Limits = LIMITS) -> Iterator[Bundle]:
    """Open a bundle for this block: check its entries, and read what it says of itself.

    Raises InputError if the file is no bundle, or an entry's name, kind or size is not one that a bundle may have.
    """
    if path.is_dir():
        raise NotAFileError(
            "is a folder, not a bundle",
            path,
            f"`sucre-bench bundle {path} FILE.zip` makes one of it",
        )
    regular(path, "give a bundle that `sucre-bench bundle` wrote")
    with reading(path, "give a file that `sucre-bench bundle` wrote"):
        archive = zipfile.ZipFile(path)
    with archive:
        infos = archive.infolist()
        if fault_found := _fault_of_entries(infos, limits):
            raise InputError(fault_found, path, "do not unpack it, ask who made it for another")
        unread = Bundle(path, {info.filename: info.file_size for info in infos}, archive)
        yield _described(unread, unread.read(MANIFEST))


def _fault_of_entries(infos: Sequence[zipfile.ZipInfo], limits: Limits) -> str:
    """What a bundle may not have, or ""."""
    if len(infos) > limits.entries:
        return f"holds {len(infos)} files, more than {limits.entries}"
    seen: set[str] = set()
    for info in infos:
        if fault := _fault_of_entry(info, limits):
            return f"{info.filename[:80]!r} {fault}"
        if info.filename.casefold() in seen:
            return f"{info.filename!r} is there twice"
        seen.add(info.filename.casefold())
    total = sum(info.file_size for info in infos)
    return f"would unpack to {total / 1e9:.0f} GB" if total > limits.all_bytes else ""


def _fault_of_entry(info: zipfile.ZipInfo, limits: Limits) -> str:
    name = info.orig_filename
    kind = stat.S_IFMT(info.external_attr >> 16)
    parts = name.split("/")
    size = info.file_size
    faults = {
        "is no plain path": name != info.filename
        or not name.isprintable()
        or "\\" in name
        or ":" in parts[0],
        "is a link or a folder, not a file": name.endswith("/")
        or kind not in (0, stat.S_IFREG),
        "leads out of the bundle": any(part in ("", ".", "..") for part in parts),
        "has too long a name": len(name.encode(errors="replace")) > limits.name_bytes,
        "is encrypted": info.flag_bits & 0x1,
        "is packed in an unknown way": info.compress_type
        not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED),
        f"would unpack to {size / 1e6:.0f} MB": size
        > (limits.file_bytes if len(parts) > 1 else limits.table_bytes),
        "would unpack to far more than its size": size > 1 << 20
        and size > limits.ratio * info.compress_size,
    }
    return next((fault for fault, is_so in faults.items() if is_so), "")


def _described(bundle: Bundle, manifest: bytes) -> Bundle:
    """The bundle with what its bundle.json says."""
    with reading(bundle.path / MANIFEST, "bundle again"):
        told = json.loads(manifest)
        if (told["format"], told["version"]) != (_FORMAT, _VERSION):
            raise ValueError(f"it says {told['format']!r}, version {told['version']!r}")
        if not fits(told, _Manifest):
            raise ValueError("a part is missing, or is of another kind")
    return replace(
        bundle,
        id=_id(manifest),
        by=told["by"][:200],
        version=told["sucre_bench"][:40],
        inside=told["inside"],
        outside=told["outside"],
    )
