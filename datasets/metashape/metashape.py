"""Surveys aligned in Agisoft Metashape or PhotoScan (1.3 on), from its export or its project.

root/cameras.xml            File > Export > Export Cameras, Agisoft XML; or a project: .psx with its .files/, .psz
root/images/<label>.jpg     the photographs, sub-folders are fine; or what Export > Undistort Photos wrote (undistorted)
root/depths/<label>.tif     optional: depth maps, see `loading.depth_maps`

Poses become metric by the scale of the component or chunk; large geographic coordinates are left away. Lenses, frames
and units: `chunk.py`; where the parts of a project are: `document.py`.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Literal

from sucre_bench.camera import Camera
from sucre_bench.datasets.metashape.chunk import Aligned, Component, find_document, read_chunk, read_components
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.loading.depth_maps import find_depths, read_depth
from sucre_bench.loading.find_folders import ImageFolder, chosen, existing, inner_path
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, data_id_of, straight_lens, view_of
from sucre_bench.machine.progress import say, track
from sucre_bench.plugins.decorators import dataset
from sucre_bench.scene import Encoding, Plane, Scene


@dataset(
    requires=("cv2", "PIL", "tifffile"),
    source="your own surveys: File > Export > Export Cameras in Agisoft Metashape, or the project itself",
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
        images, maps_folder = (chosen(self, root, option, "folder") for option in ("images", "depths"))
        document = find_document(root, self.document)
        chunk = read_chunk(document, self.chunk)
        components = read_components(chunk, document)
        cameras = [camera for component in components for camera in component.cameras]
        photographs = dict(zip(cameras, _photographs(images, document, cameras, self.undistorted), strict=True))
        maps = {camera: _map_name(photographs[camera].name, camera.label) for camera in cameras}
        depths, ambiguous = find_depths(maps_folder, list(maps.values()))
        for camera, name in maps.items():
            faults: dict[Plane, str] = {"depth": ambiguous[name]} if name in ambiguous else {}
            faults |= photographs[camera].faults
            photographs[camera] = replace(photographs[camera], depth=depths.get(name), faults=faults)
        for component in components:
            yield self._scene(root, document, component, [photographs[camera] for camera in component.cameras])

    def _scene(self, root: Path, document: Path, component: Component, photographs: Sequence[Photograph]) -> Scene:
        if component.scale is None:
            say(f"{document}: {component.label} has no scale, lengths are in units of its own; set a scale bar there")
        scale = component.scale or 1.0
        read = (lambda path: read_depth(path) * scale) if self.depth_units == "chunk" else read_depth
        views = []
        for camera, photograph in track(list(zip(component.cameras, photographs, strict=True)), "image sizes"):
            of = photograph.lens if self.depth_camera == "image" else straight_lens(camera.lens.camera)
            view = view_of(replace(photograph, read_depth=read, depth_lens=of), self.image_scale, self.encoding)
            views.append(view)
        views.sort(key=lambda view: view.name)
        with_depth = any(photograph.depth or "depth" in photograph.faults for photograph in photographs)
        has = frozenset({"poses", *(("depth",) if with_depth else ())})
        how = (self.depth_units, scale, self.depth_camera) if with_depth else ()
        name = root.resolve().name + (f"/{component.label}" if component.is_one_of_several else "")
        return Scene(name, views, has, data_id=data_id_of(views, *how))


def _photographs(folder: Path, document: Path, cameras: Sequence[Aligned], undistorted: bool) -> list[Photograph]:
    """Return the photograph of each camera; InputError when none of their files is there, or one is two cameras'."""
    if not folder.is_dir():
        raise MissingFileError(
            "no such folder", folder, "put the images there or name their folder with dataset.images=DIR"
        )
    files, found, owners = ImageFolder(folder), [], defaultdict(list)
    for camera in cameras:
        fits = files.find(camera.named)
        faults: dict[Plane, str] = {}
        if not fits:
            faults["rgb"] = f"{folder}: no image is named like camera '{camera.named}' of {document.name}; put it there"
        elif len(fits) > 1:
            fault = f"{fits[0]} and {fits[1]} are named like camera '{camera.named}'"
            faults["rgb"] = f"{folder}: {fault}; keep one, or use the project (.psx), which knows their folders"
        name = fits[0] if len(fits) == 1 else inner_path(camera.named) or f"camera {camera.label}"
        owners[name].append(camera)
        lens = straight_lens(_middle(camera.lens.camera)) if undistorted else camera.lens
        found.append(Photograph(name, folder / name, lens, camera.cam_from_world, faults=faults))
    if all(photograph.faults for photograph in found):
        raise InputError(found[0].faults["rgb"])
    shared = next((name for name, several in owners.items() if len(several) > 1), None)
    if shared is not None:
        raise InputError(f"{document}: two cameras have the image {shared}; give cameras labels of their own")
    return found


def _map_name(image: str, label: str) -> str:
    """What a depth map is named after: the camera's label, in the folder of its image."""
    return (PurePosixPath(image).parent / f"{label}.png").as_posix()


def _middle(camera: Camera) -> Camera:
    """The camera of what Undistort Photos writes: one focal length, the principal point in the middle."""
    K = camera.K.copy()
    K[0, 0], K[0, 1], K[0, 2], K[1, 2] = K[1, 1], 0, camera.width / 2, camera.height / 2
    return Camera(K, camera.width, camera.height)
