"""Surveys aligned in Agisoft Metashape or PhotoScan (1.3 on), from its export or its project.

root/cameras.xml            File > Export > Export Cameras, Agisoft XML; or a project: .psx with its .files/, .psz
root/images/<label>.jpg     the photographs, sub-folders are fine; or what Export > Undistort Photos wrote (undistorted)
root/depths/<label>.tif     optional: depth maps, see `loading.depth_maps`

Poses become metric by the scale of the component or chunk; large geographic coordinates are left away.

Sensors: u = w/2 + cx + f x' + b1 x' + b2 y', v = h/2 + cy + f y', pixel centres at +0.5, x' = x (1 + k1 r^2 + k2 r^4 +
k3 r^6 + k4 r^8) + (p1 (r^2 + 2 x^2) + 2 p2 x y) (1 + p3 r^2 + p4 r^4) and y' likewise: OpenCV's p1 is p2 here, its p2
p1. A fisheye has the angle from the axis in the place of r (Agisoft Metashape User Manual, appendix "Camera models").

Poses: a camera's <transform> takes points of its frame (x right, y down, z ahead) to the chunk's. The <transform> of
its component, or else of the chunk, takes those to the world: scale R X + t, geocentric where the survey is
georeferenced. t, of thousands of kilometres there, is left away. A camera with a master_id has the master's pose times
its sensor's <rotation> and <location>, which is in units of the chunk.
"""

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from sucre_bench import Camera, dataset
from sucre_bench.arrays import Array
from sucre_bench.camera import centred_camera, intrinsics, is_rigid, pose_of
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.imaging.image_files import PICTURE_READERS
from sucre_bench.loading.depth_maps import find_depths, read_depth
from sucre_bench.loading.find_folders import (
    Found,
    ImageFolder,
    check_images,
    chosen,
    existing,
    inside,
    without_suffix,
)
from sucre_bench.loading.lens import Lens, Model, lens_of
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, scaled_pose, scene_of
from sucre_bench.machine.files import check_folder, reading, regular
from sucre_bench.machine.progress import say
from sucre_bench.scene import Encoding, Scene

# Finds the chunk in Metashape's export or project.
#
# cameras.xml     <document><chunk>: sensors, components, cameras; no paths of photographs
# name.psx        <document path="{projectname}.files/project.zip">: a folder of archives with a doc.xml each:
#                 project.zip <document><chunks active_id><chunk id path>, 0/chunk.zip <chunk>..<frames><frame path>,
#                 0/0/frame.zip <frame><cameras><camera camera_id><photo path>
# name.psz        one archive whose doc.xml holds all of it, inline

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
        return regular(root / name, f"correct or drop dataset.document={name}")
    there = sorted(
        path for path in root.iterdir() if path.suffix.lower() in _SUFFIXES and path.is_file()
    )
    if not there:
        raise InputError(
            f"{root}: no cameras.xml, .psx or .psz; put Metashape's exported cameras or project there"
        )
    if len(there) > 1:
        several = ", ".join(path.name for path in there[:5])
        raise InputError(
            f"{root}: {several} are there; choose one with dataset.document={there[0].name}"
        )
    return there[0]


def read_chunk(document: Path, label: str) -> Chunk:
    """Return the chunk of that label, or the active or only one. InputError when it is not there or damaged."""
    top = _parsed(document)
    project = document
    if top.get("path") and top.find("chunk") is None:
        project = _part(
            document, document, str(top.get("path")).replace("{projectname}", document.stem)
        )
        top = _parsed(project)
    entries = top.findall("chunk") + top.findall("chunks/chunk")
    if not entries:
        raise InputError(f"{document}: holds no chunk with cameras; {_EXPORT}")
    chunks = [_chunk(document, project, entry) for entry in entries]
    if not label:
        listed = top.find("chunks")
        active = listed.get("active_id") if listed is not None else None
        numbered = [
            chunk
            for entry, chunk in zip(entries, chunks, strict=True)
            if entry.get("id") == active
        ]
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
        raise InputError(
            f"{document}: names '{named}' as a part, outside of {document.parent}; {_EXPORT}"
        )
    return document.parent / part


def _chunk(document: Path, project: Path, entry: Element) -> Chunk:
    """Follow an entry of the list of chunks to the chunk and its first frame."""
    place = project
    if entry.get("path"):
        place = _part(document, project, str(entry.get("path")))
        entry = _parsed(place)
    paths = {}
    frame = entry.find("frames/frame")
    if frame is not None and frame.get("path"):
        frame = _parsed(_part(document, place, str(frame.get("path"))))
    for camera in frame.iterfind("cameras/camera") if frame is not None else ():
        photo = camera.find("photo")
        if photo is not None and photo.get("path"):
            paths[str(camera.get("camera_id"))] = str(photo.get("path"))
    return Chunk(entry, paths)


def _parsed(path: Path) -> Element:
    """Parse a file that is XML itself, or the doc.xml of an archive."""
    is_xml = path.suffix.lower() in (".xml", ".psx")
    large = f"is larger than {_LARGEST >> 20} MiB; {_EXPORT}"
    with reading(
        path, _EXPORT if is_xml else f"copy the project with its .files folder, or {_EXPORT}"
    ):
        if is_xml:
            if regular(path).stat().st_size > _LARGEST:
                raise InputError(f"{path}: {large}")
            return ElementTree.fromstring(path.read_bytes())
        with zipfile.ZipFile(regular(path)) as archive:
            if archive.getinfo("doc.xml").file_size > _LARGEST:
                raise InputError(f"{path}: its doc.xml {large}")
            return ElementTree.fromstring(archive.read("doc.xml"))


_UNDISTORT = "use File > Export > Undistort Photos and dataset.undistorted=true"


@dataclass(frozen=True, eq=False)
class Aligned:
    """An aligned camera."""

    label: str
    """Without the suffix of an image."""

    named: str
    """What its image is called, with what is known of its folders."""

    lens: Lens
    cam_from_world: Array


@dataclass(frozen=True, eq=False)
class Component:
    """Cameras aligned with each other."""

    label: str
    cameras: list[Aligned]

    scale: float | None
    """Metres in a unit of the chunk; None where nothing set it."""

    is_one_of_several: bool


def read_components(chunk: Chunk, document: Path) -> list[Component]:
    """Return the components that have aligned, enabled cameras.

    InputError when there are none or one is wrong; any error for a number or a part that is not there.
    """
    sensors = {
        str(sensor.get("id")): sensor for sensor in chunk.element.iterfind("sensors/sensor")
    }
    cameras = list(_cameras(chunk.element.find("cameras")))
    poses = {str(camera.get("id")): _pose(camera) for camera, _ in cameras}
    lenses: dict[str, Lens] = {}
    members: dict[str, list[Aligned]] = {}
    worlds = {str(c.get("id")): c for c in chunk.element.iterfind("components/component")}
    for camera, group in cameras:
        number, sensor = str(camera.get("id")), str(camera.get("sensor_id"))
        if camera.get("enabled", "true") in ("false", "0") or camera.get("label") is None:
            continue
        if sensor not in sensors:
            raise ValueError(f"camera '{camera.get('label')}' has no sensor {sensor}")
        pose = poses[number]
        master = poses.get(str(camera.get("master_id")))
        if pose is None and master is not None:
            pose = master @ _offset(sensors[sensor])
        if pose is None:
            continue
        if sensor not in lenses:
            lenses[sensor] = _lens(sensors[sensor], document)
        of = str(camera.get("component_id", next(iter(worlds), "")))
        transform, scale = _world(worlds.get(of), chunk.element)
        world_from_cam = scaled_pose(transform @ pose, scale or 1.0)
        label = str(camera.get("label"))
        named = chunk.paths.get(number, f"{group}/{label}" if group else label)
        stem = without_suffix(label.replace("\\", "/").rsplit("/", 1)[-1])
        members.setdefault(of, []).append(
            Aligned(stem, named, lenses[sensor], np.linalg.inv(world_from_cam))
        )
    if not members:
        fault = f"none of its {len(cameras)} cameras is aligned"
        raise InputError(fault, document, f"run Align Photos, {_EXPORT}")
    used = sum(map(len, members.values()))
    if used < len(cameras):
        say(
            f"{document}: {used} of {len(cameras)} cameras are aligned and enabled, the others are left out"
        )
    found = []
    for of, aligned in members.items():
        label = (worlds[of].get("label") if of in worlds else None) or f"component {of or 0}"
        scale = _world(worlds.get(of), chunk.element)[1]
        found.append(Component(label, aligned, scale, len(members) > 1))
    return found


def _cameras(parent: Element | None, group: str = "") -> Iterator[tuple[Element, str]]:
    """Every camera and the label of the group that it is in."""
    for element in parent if parent is not None else ():
        if element.tag == "camera":
            yield element, group
        elif element.tag == "group":
            yield from _cameras(element, element.get("label", ""))


def _numbers(element: Element, tag: str, *shape: int) -> Array | None:
    """The numbers of a part of an element, in a shape; None if it has no such part."""
    text = element.findtext(tag)
    return None if text is None else np.array(text.split(), dtype=np.float64).reshape(shape)


def _pose(camera: Element) -> Array | None:
    pose = _numbers(camera, "transform", 4, 4)
    if pose is not None and not is_rigid(pose):
        raise ValueError(f"the transform of camera '{camera.get('label')}' is not rigid")
    return pose


def _offset(sensor: Element) -> Array:
    """The pose (4, 4) of a rig's camera in its master's frame."""
    rotation, location = _numbers(sensor, "rotation", 3, 3), _numbers(sensor, "location", 3)
    if rotation is None and location is None:
        raise ValueError(f"sensor '{sensor.get('label')}' has no place on its rig")
    turn = np.eye(3) if rotation is None else rotation
    offset = pose_of(turn, np.zeros(3) if location is None else location)
    if not is_rigid(offset):
        raise ValueError(f"the rotation of sensor '{sensor.get('label')}' is none")
    return offset


def _world(component: Element | None, chunk: Element) -> tuple[Array, float | None]:
    """The rotation, as (4, 4), and the scale from the chunk's frame to the world; None where there is no scale."""
    of_component = component.find("transform") if component is not None else None
    transform = of_component if of_component is not None else chunk.find("transform")
    if transform is None:
        return np.eye(4), None
    rotation, scale = _numbers(transform, "rotation", 3, 3), transform.findtext("scale")
    turn = pose_of(np.eye(3) if rotation is None else rotation, np.zeros(3))
    if not is_rigid(turn) or (scale is not None and not 0 < float(scale) < np.inf):
        raise ValueError(f"a transform with rotation {rotation} and scale {scale}")
    return turn, None if scale is None else float(scale)


def _lens(sensor: Element, document: Path) -> Lens:
    """The lens of a sensor: adjusted calibration where there is one, else the initial."""
    place = f"{document}: sensor '{sensor.get('label')}'"
    every = {element.get("class"): element for element in sensor.iterfind("calibration")}
    calibration = every.get("adjusted", next(iter(every.values()), None))
    kind = (
        sensor.get("type", "frame")
        if calibration is None
        else calibration.get("type", sensor.get("type", "frame"))
    )
    fisheye = kind in ("fisheye", "equidistant_fisheye")
    if not fisheye and kind != "frame":
        raise InputError(
            f"{place} is {kind}, which is not usable here; leave its cameras out, or {_UNDISTORT}"
        )
    if calibration is None or calibration.find("f") is None:
        raise InputError(
            f"{place} has no calibration with a focal length; align in Metashape 1.3 or later, {_EXPORT}"
        )
    terms = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")
    f, cx, cy, b1, b2, k1, k2, k3, k4, p1, p2, p3, p4 = (
        float(calibration.findtext(term, "0")) for term in terms
    )
    size = calibration.find("resolution")
    size = size if size is not None else sensor.find("resolution")
    if size is None:
        raise InputError(f"{place} has no resolution; {_EXPORT}")
    width, height = int(size.get("width", "")), int(size.get("height", ""))
    K = intrinsics(f + b1, f, width / 2 + cx, height / 2 + cy, b2)
    if not (min(f, f + b1, width, height) > 0 and np.isfinite(K).all()):
        fault = f"has {width}x{height} pixels and f = {f:g}, which no camera has"
        raise InputError(fault, place, _EXPORT)
    model: Model = "fisheye" if fisheye else "perspective"
    return lens_of(Camera(K, width, height), model, (k1, k2, k3, k4), (p2, p1, p3, p4))


@dataset(
    requires=PICTURE_READERS,
    source="your own surveys: File > Export > Export Cameras in Agisoft Metashape, or the project itself",
    proven="has read depth maps that Metashape exported (float16, Deflate), but no document of cameras that it wrote",
    has=("poses", "depth"),
    signs=("*.psx", "*.psz", "cameras.xml"),
)
@dataclass(frozen=True)
class Metashape(ImageScaleOption):
    """A survey aligned in Agisoft Metashape: one scene an aligned component, one view a photograph."""

    root: Path
    """The folder that holds the document, images/ and, if there are any, depths/."""
    document: str = ""
    """File of the exported cameras or project, in root; empty: the only .xml, .psx or .psz there."""
    chunk: str = ""
    """Label of the chunk, where the project has several; empty: the one that was active."""
    images: str = "images"
    """Folder of the images, in root."""
    undistorted: bool = False
    """true: Undistort Photos wrote the images (principal point, aspect and skew fixed); false: they are the
    photographs."""
    depths: str = "depths"
    """Folder of the depth maps, named after the cameras' labels, in root; need not exist."""
    depth_units: Literal["metres", "chunk"] = "metres"
    """Units of the depth maps: "metres", as Agisoft's export script writes, or "chunk", as the Python API has them."""
    depth_camera: Literal["undistorted", "image"] = "undistorted"
    """Depth maps are of the sensor without distortion, as Metashape makes them, or match the images pixel by pixel."""
    encoding: Encoding = "gamma"
    """How images are encoded: "gamma" (sRGB-like) or "linear"."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each component with aligned, enabled cameras. Reads the document, headers and samples.

        Raises InputError for what concerns all views: no document, a damaged one, a lens that cannot be used, no image
        at all. What is wrong with the files of one view is raised when they are loaded.
        """
        root = existing(self.root, "cameras.xml")
        images, maps_folder = (
            chosen(self, root, option, "folder") for option in ("images", "depths")
        )
        document = find_document(root, self.document)
        chunk = read_chunk(document, self.chunk)
        with reading(document, _EXPORT):
            components = read_components(chunk, document)
        check_folder(
            images, "put the images there or name their folder with dataset.images=DIR"
        )
        files = ImageFolder(images)
        remedy = "keep one, or use the project (.psx), which knows their folders"
        cameras = [camera for component in components for camera in component.cameras]
        named = {
            camera: files.find_one(camera.named, document.name, remedy) for camera in cameras
        }
        check_images(
            (f"{document}: camera '{camera.named}'", *of) for camera, of in named.items()
        )
        # A depth map is named after the camera's label, in the folder of its image.
        folders = {camera: PurePosixPath(name).parent for camera, (name, _) in named.items()}
        maps = {
            camera: (folder / f"{camera.label}.png").as_posix()
            for camera, folder in folders.items()
        }
        depths = find_depths(maps_folder, list(maps.values()))
        for component in components:
            if component.scale is None:
                lack = f"{component.label} has no scale, lengths are in units of its own"
                say(f"{document}: {lack}; set a scale bar there")
            photographs = [
                self._photograph(
                    images,
                    camera,
                    *named[camera],
                    depths.get(maps[camera]),
                    component.scale or 1.0,
                )
                for camera in component.cameras
            ]
            with_depth = any(photograph.depth for photograph in photographs)
            how = (
                (self.depth_units, component.scale or 1.0, self.depth_camera)
                if with_depth
                else ()
            )
            name = root.resolve().name + (
                f"/{component.label}" if component.is_one_of_several else ""
            )
            yield scene_of(name, photographs, self.image_scale, self.encoding, *how)

    def _photograph(
        self, folder: Path, camera: Aligned, name: str, fault: str, depth: Found, scale: float
    ) -> Photograph:
        lens = camera.lens
        if self.undistorted:
            # Undistort Photos makes one focal length, and the principal point the middle
            lens = Lens(centred_camera(lens.camera.K[1, 1], *lens.camera.size))
        read = (
            (lambda path: read_depth(path) * scale)
            if self.depth_units == "chunk"
            else read_depth
        )
        of_depth = lens if self.depth_camera == "image" else Lens(camera.lens.camera)
        return Photograph(
            name, folder / name, lens, camera.cam_from_world, depth, read, of_depth, fault=fault
        )
