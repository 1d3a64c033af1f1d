"""Finished images that stay in their scene: encrypted like all of it, with as many copies, under a name (specs/35-kept-images.md)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.image_limits import SIDE_MAX
from scenefold.base.plain_values import text, whole
from scenefold.client import Cluster, Scene
from scenefold.client.blobs import BLOB_BYTES_MAX, Blob, Blobs
from scenefold.render.image_files import check_writable, write_atomically
from scenefold.scene.layout import RENDERS
from scenefold.wire import Value

KIND = "image"
_SHA256 = "scenefold.image_sha256"
_SECONDS_MAX = 2**63 - 1
Progress = Callable[[int, int], object]
"""Called with so many bytes of so many."""


@dataclass(frozen=True, slots=True)
class SceneImage:
    """What is known of one without reading it."""

    name: str
    size: int
    """Bytes of the EXR file."""
    width: int
    height: int
    image_sha256: str
    """Of the beauty layer, as the report of its render has it; empty if the file does not say."""
    saved_at: int
    """Seconds since 1970, by the clock of whoever saved it."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "image": self.name,
            "size": [self.width, self.height],
            "bytes": self.size,
            "image_sha256": self.image_sha256 or None,
            "saved_at": self.saved_at,
        }


def images_of(scene: Scene) -> Blobs:
    """Where a scene has its images."""
    return Blobs(scene.access, RENDERS, KIND)


async def save_image(cluster: Cluster, scene: Scene, name: str, path: Path, progress: Progress) -> SceneImage:
    """Keep an EXR file under a name, in place of what is there. LocalFault if it is none, or the user may not write; Refused if another one writes that name."""
    scene.access.check_writer()
    payload, about = await cluster.in_worker("import", _read, path)
    about["saved_at"] = int(cluster.calls.world.clock.wall())
    return _image_of(await images_of(scene).write(name, payload, about, progress))


@dataclass(frozen=True, slots=True)
class Images:
    """Of one scene, by their names. `unfinished`: names of those that were begun to be saved, or to be deleted; `damaged`: of those that make no sense."""

    whole: tuple[SceneImage, ...]
    unfinished: tuple[str, ...]
    damaged: tuple[str, ...]


async def list_images(scene: Scene) -> Images:
    """All that there are. DamagedData if the list of them makes no sense."""
    blobs, found = images_of(scene), list[SceneImage]()
    unfinished, damaged = list[str](), list[str]()
    for name in await blobs.names():
        try:
            blob = await blobs.look(name)
            if blob is None:
                unfinished.append(name)
            else:
                found.append(_image_of(blob))
        except DamagedData:
            damaged.append(name)
    return Images(tuple(found), tuple(unfinished), tuple(damaged))


async def fetch_image(cluster: Cluster, scene: Scene, name: str, path: Path, progress: Progress) -> SceneImage:
    """Write an image as the EXR file that it was. LocalFault if there is none of that name, or it cannot be written."""
    check_writable(path)
    blob, payload = await images_of(scene).read(name, progress)
    await cluster.in_worker("import", write_atomically, path, lambda draft: draft.write_bytes(payload))
    return _image_of(blob)


async def remove_image(scene: Scene, name: str) -> None:
    """LocalFault if there is none of that name."""
    await images_of(scene).remove(name)


def _image_of(blob: Blob) -> SceneImage:
    about = blob.about
    try:
        return SceneImage(
            blob.name,
            blob.size,
            whole(about["width"], 1, SIDE_MAX),
            whole(about["height"], 1, SIDE_MAX),
            text(about["image_sha256"]),
            whole(about["saved_at"], 0, _SECONDS_MAX),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DamagedData("what is said of an image makes no sense", where=blob.name, remedy="save it anew") from error


def _read(path: Path) -> tuple[bytes, dict[str, Value]]:
    """The file, and what its header says of the image."""
    import OpenEXR

    if not path.is_file():
        raise LocalFault("there is no such image file", where=str(path), remedy="check the path")
    if path.stat().st_size > BLOB_BYTES_MAX:
        raise LocalFault("the image is too large to be kept in a scene", where=str(path), remedy=f"at most {BLOB_BYTES_MAX >> 30} GiB")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            header = file.header()
            low, high = header["dataWindow"]
            width, height = (int(high[axis]) - int(low[axis]) + 1 for axis in (0, 1))
            # It is empty once the file is closed.
            sha256 = header.get(_SHA256)
        payload = path.read_bytes()
    except OSError as error:
        raise LocalFault(f"the image cannot be read: {error.strerror or error}", where=str(path), remedy="check its rights") from error
    except (RuntimeError, ValueError, KeyError, TypeError) as error:
        raise LocalFault("that is no OpenEXR image", where=str(path), remedy="give one that `scenectl render` has written") from error
    if not (1 <= width <= SIDE_MAX and 1 <= height <= SIDE_MAX):
        raise LocalFault(f"an image of {width}x{height} is none that can be kept", where=str(path), remedy=f"at most {SIDE_MAX} a side")
    return payload, {"width": width, "height": height, "image_sha256": sha256 if isinstance(sha256, str) else ""}
