"""Finds the chunk in Metashape's export or project.

cameras.xml     <document><chunk>: sensors, components, cameras; no paths of photographs
name.psx        <document path="{projectname}.files/project.zip">: a folder of archives with a doc.xml each:
                project.zip <document><chunks active_id><chunk id path>, 0/chunk.zip <chunk>..<frames><frame path>,
                0/0/frame.zip <frame><cameras><camera camera_id><photo path>
name.psz        one archive whose doc.xml holds all of it, inline
"""

import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from sucre_bench.errors import InputError, MissingFileError, did_you_mean, file_error
from sucre_bench.loading.find_folders import inside
from sucre_bench.machine.files import regular

_SUFFIXES = (".xml", ".psx", ".psz")
_LARGEST = 256 << 20  # bytes of XML that are read; a dive of 10,000 photographs has about 20 MB
_EXPORT = "export it again: File > Export > Export Cameras, Agisoft XML"


@dataclass(frozen=True, eq=False)
class Chunk:
    """A chunk's element, and the path of each camera's photograph by the camera's id, where the document knows it."""

    element: Element
    paths: dict[str, str] = field(default_factory=dict)


def find_document(root: Path, name: str) -> Path:
    """Return the document in a folder: the one named, or the only one. InputError when there is none or several."""
    if name:
        if not (root / name).is_file():
            raise MissingFileError("no such file", root / name, f"correct or drop dataset.document={name}")
        return root / name
    there = sorted(path for path in root.iterdir() if path.suffix.lower() in _SUFFIXES and path.is_file())
    if not there:
        raise InputError(f"{root}: no cameras.xml, .psx or .psz; put Metashape's exported cameras or project there")
    if len(there) > 1:
        several = ", ".join(path.name for path in there[:5])
        raise InputError(f"{root}: {several} are there; choose one with dataset.document={there[0].name}")
    return there[0]


def read_chunk(document: Path, label: str) -> Chunk:
    """Return the chunk of that label, or the active or only one. InputError when it is not there or damaged."""
    top = _archived(document) if document.suffix.lower() == ".psz" else _parsed(document, _bytes(document))
    project = document
    if top.get("path") and top.find("chunk") is None:
        project = _part(document, document, str(top.get("path")).replace("{projectname}", document.stem))
        top = _archived(project)
    entries = top.findall("chunk") + top.findall("chunks/chunk")
    if not entries:
        raise InputError(f"{document}: holds no chunk with cameras; {_EXPORT}")
    chunks = [_chunk(document, project, entry) for entry in entries]
    if not label:
        listed = top.find("chunks")
        active = listed.get("active_id") if listed is not None else None
        numbered = [chunk for entry, chunk in zip(entries, chunks, strict=True) if entry.get("id") == active]
        return (numbered or chunks)[0]
    for chunk in chunks:
        if chunk.element.get("label") == label:
            return chunk
    labels = [str(chunk.element.get("label")) for chunk in chunks]
    raise InputError(f"{document}: no chunk is called '{label}'; {did_you_mean(label, labels)}")


def _part(document: Path, beside: Path, named: str) -> Path:
    """Return the file of the project that another of its files names. InputError when it leads out of its folder."""
    part = inside(document.parent, beside.parent, named)
    if part is None:
        raise InputError(f"{document}: names '{named}' as a part, outside of {document.parent}; {_EXPORT}")
    return document.parent / part


def _chunk(document: Path, project: Path, entry: Element) -> Chunk:
    """Follow an entry of the list of chunks to the chunk and its first frame."""
    place = project
    if entry.get("path"):
        place = _part(document, project, str(entry.get("path")))
        entry = _archived(place)
    paths = {}
    frame = entry.find("frames/frame")
    if frame is not None and frame.get("path"):
        frame = _archived(_part(document, place, str(frame.get("path"))))
    for camera in frame.iterfind("cameras/camera") if frame is not None else ():
        photo = camera.find("photo")
        if photo is not None and photo.get("path"):
            paths[str(camera.get("camera_id"))] = str(photo.get("path"))
    return Chunk(entry, paths)


def _archived(path: Path) -> Element:
    """Parse the doc.xml of an archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo("doc.xml").file_size > _LARGEST:
                raise InputError(f"{path}: its doc.xml is larger than {_LARGEST >> 20} MiB; {_EXPORT}")
            return _parsed(path, archive.read("doc.xml"))
    except FileNotFoundError as fault:
        raise MissingFileError(
            "no such file", path, f"copy the project with its .files folder, or {_EXPORT}"
        ) from fault
    except (OSError, zipfile.BadZipFile, zlib.error, KeyError, NotImplementedError, RuntimeError) as fault:
        raise InputError(
            f"{path}: is not an archive with a doc.xml, or damaged; copy it again, or {_EXPORT}"
        ) from fault


def _bytes(path: Path) -> bytes:
    try:
        if regular(path).stat().st_size > _LARGEST:
            raise InputError(f"{path}: is larger than {_LARGEST >> 20} MiB; {_EXPORT}")
        return path.read_bytes()
    except OSError as fault:
        raise file_error(path, fault, "check its permissions") from fault


def _parsed(path: Path, content: bytes) -> Element:
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError) as fault:
        raise InputError(f"{path}: breaks off or is not XML ({fault}); {_EXPORT}") from fault
