"""Finished images as files: linear EXR with named layers, PNG for eyes, and the hash that runs are compared by
(rendering.md, *Bits* and *Materials and light*).

A layer is an array, H x W x C or H x W, top row first, float32, or uint32 where it counts or numbers something. The beauty
layer has the plain names R, G, B, so that every viewer shows it; the others are `albedo.R`, `normal.X`, `depth.Z`, `samples.N`. Files are written beside their
final name and renamed when they are complete, so that a watcher never opens half an image, and a failed
write leaves an older image as it was.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault
from scenefold.render.layers import BEAUTY, KINDS, Pixels
from scenefold.render.view import AGX, Shown, shown
from scenefold.render.window import Window

Layer = NDArray[np.float32]


def write_exr(
    path: Path,
    layers: Mapping[str, Pixels],
    metadata: Mapping[str, str | int | float],
    crop: Window | None = None,
    size: tuple[int, int] | None = None,
) -> None:
    """Write all layers, 32 bits a value; if they are a crop, with where it lies in an image of width and height `size`. Metadata become attributes of the header; LocalFault if it fails."""
    import OpenEXR

    channels: dict[str, Pixels] = {}
    for layer, pixels in layers.items():
        planes = _planes(layer, pixels)
        prefix = "" if layer == BEAUTY else f"{layer}."
        for name, plane in zip(KINDS[layer].channels, planes, strict=True):
            channels[prefix + name] = plane
    header: dict[str, object] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if crop is not None:
        assert size is not None and layers[BEAUTY].shape[:2] == (crop.height, crop.width), "the layers are not that crop"
        header["dataWindow"] = ((crop.x, crop.y), (crop.x + crop.width - 1, crop.y + crop.height - 1))
        header["displayWindow"] = ((0, 0), (size[0] - 1, size[1] - 1))
    header |= {name: str(value) for name, value in metadata.items()}

    def write(temporary: Path) -> None:
        with OpenEXR.File(header, channels) as file:
            file.write(str(temporary))

    write_atomically(path, write)


def write_png(path: Path, beauty: Layer, exposure: float | None = None, view: str = AGX) -> Shown:
    """Write the beauty layer through a view transform as 8-bit sRGB; `exposure` in stops, None: as the image asks. What was written."""
    from PIL import Image

    picture = shown(beauty, view, exposure)
    image = Image.fromarray(picture.pixels)
    write_atomically(path, lambda temporary: image.save(temporary, format="PNG"))
    return picture


def image_sha256(beauty: Layer) -> str:
    """SHA-256 of the beauty layer as little-endian f32, H x W x 3, top row first; in hexadecimal."""
    assert beauty.shape[2:] == (3,), "the beauty layer is H x W x 3"
    return hashlib.sha256(np.ascontiguousarray(beauty, dtype="<f4").tobytes()).hexdigest()


def check_writable(*paths: Path) -> None:
    """LocalFault unless a file can be made at each of these places: asked before the work, not after it."""
    probed: set[Path] = set()
    for path in paths:
        folder = path.parent
        try:
            is_folder = stat.S_ISDIR(path.stat().st_mode)
        except (FileNotFoundError, NotADirectoryError):
            is_folder = False
        except OSError as error:
            raise LocalFault(f"cannot write there: {error.strerror}", where=str(path), remedy="give the output another name") from error
        if is_folder:
            raise LocalFault("the output is a folder", where=str(path), remedy="name a file in it")
        # Frames are many, and most of them lie in one folder.
        if folder not in probed:
            _check_folder(folder, _draft_of(path))
            probed.add(folder)


def _check_folder(folder: Path, draft: Path) -> None:
    if not folder.is_dir():
        raise LocalFault("the output folder does not exist", where=str(folder), remedy="make it first")
    try:
        try:
            draft.touch()
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise LocalFault(f"cannot write there: {error.strerror}", where=str(folder), remedy="choose another output folder") from error


def write_atomically(path: Path, write: Callable[[Path], object], what: str = "the image") -> None:
    """Have `write` write a file beside it, and put that in its place; LocalFault, with what was there as it was, if one of both fails."""
    temporary = _draft_of(path)
    try:
        write(temporary)
        temporary.replace(path)
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LocalFault(f"cannot write {what}: {reason}", where=str(path), remedy="check the folder and the free space") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _draft_of(path: Path) -> Path:
    """A short name, so that the target's may be as long as the system lets it be; another one for each target and process."""
    return path.with_name(f".{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]}.{os.getpid()}.part")


def _planes(layer: str, pixels: Pixels) -> list[Pixels]:
    assert pixels.ndim in (2, 3), f"layer {layer} has {pixels.ndim} dimensions"
    planes = [pixels] if pixels.ndim == 2 else [pixels[..., index] for index in range(pixels.shape[2])]
    return [np.ascontiguousarray(plane, dtype=KINDS[layer].dtype.newbyteorder("=")) for plane in planes]
