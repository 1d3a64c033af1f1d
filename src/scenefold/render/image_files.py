"""Finished images as files: linear EXR with named layers, PNG for eyes, and the hash that runs are compared by
(rendering.md, *Bits* and *Materials and light*).

A layer is an f32 array, H x W x C or H x W, top row first. The beauty layer has the plain names R, G, B, so
that every viewer shows it; the others are `albedo.R`, `normal.X`, `depth.Z`. Files are written beside their
final name and renamed when they are complete, so that a watcher never opens half an image, and a failed
write leaves an older image as it was.

The view transform of the PNG leaves everything up to SHOULDER_START as it is (a grey card looks like a grey
card), rolls off what is brighter, and lets very bright colours fade to white as film does, because a
clipped channel would turn an orange lamp yellow. It is for looking at; the EXR holds the truth.
"""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault

Layer = NDArray[np.float32]

SHOULDER_START = 0.6
"""Linear display value up to which the view transform changes nothing."""
EXPOSED_QUANTILE = 0.85
EXPOSED_TO = 0.6
"""Automatic exposure brings this quantile of the lit pixels' luminance to this value."""
EXPOSURE_LEFT_ALONE = 1.0
"""Stops by which an image may be off before it is corrected."""
WHITE_STOPS = 8.0
"""Stops above 1 at which a saturated colour has faded to white."""

_CHANNELS = {"beauty": "RGB", "albedo": "RGB", "normal": "XYZ", "depth": "Z"}


def write_exr(path: Path, layers: Mapping[str, Layer], metadata: Mapping[str, str | int | float]) -> None:
    """Write all layers as 32-bit floats. Metadata become attributes of the header; LocalFault if it fails."""
    import OpenEXR

    channels: dict[str, Layer] = {}
    for layer, pixels in layers.items():
        planes = _planes(layer, pixels)
        prefix = "" if layer == "beauty" else f"{layer}."
        for name, plane in zip(_channel_names(layer, len(planes)), planes, strict=True):
            channels[prefix + name] = plane
    header: dict[str, object] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {name: str(value) for name, value in metadata.items()}

    def write(temporary: Path) -> None:
        with OpenEXR.File(header, channels) as file:
            file.write(str(temporary))

    _write_atomically(path, write)


def write_png(path: Path, beauty: Layer, exposure: float | None = None) -> None:
    """Write the beauty layer as 8-bit sRGB through the view transform; `exposure` in stops, None: as the image asks."""
    from PIL import Image

    stops = automatic_exposure(beauty) if exposure is None else exposure
    image = Image.fromarray(display_bytes(beauty, stops))
    _write_atomically(path, lambda temporary: image.save(temporary, format="PNG"))


def image_sha256(beauty: Layer) -> str:
    """SHA-256 of the beauty layer as little-endian f32, H x W x 3, top row first; in hexadecimal."""
    assert beauty.shape[2:] == (3,), "the beauty layer is H x W x 3"
    return hashlib.sha256(np.ascontiguousarray(beauty, dtype="<f4").tobytes()).hexdigest()


def automatic_exposure(beauty: Layer) -> float:
    """Stops that bring the brighter part of an image to just below white; 0 for an image without light.

    Scenes come in radiometric units of their authors' choice: a sun of 4,000 and a lamp of 1 both want to be seen.
    An image that is well exposed as it is stays as it is.
    """
    light = np.nan_to_num(beauty.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0) @ np.array([0.2126, 0.7152, 0.0722])
    lit = light[light > 0.0]
    if not len(lit):
        return 0.0
    stops = math.log2(EXPOSED_TO / float(np.quantile(lit, EXPOSED_QUANTILE)))
    return 0.0 if abs(stops) <= EXPOSURE_LEFT_ALONE else min(max(stops, -64.0), 64.0)


def display_bytes(beauty: Layer, exposure: float = 0.0) -> NDArray[np.uint8]:
    """The view transform: linear light to 8-bit sRGB. What is no number is shown black."""
    light = np.nan_to_num(beauty.astype(np.float64), nan=0.0, posinf=1e30, neginf=0.0)
    light = np.maximum(light * 2.0**exposure, 0.0)
    peak = light.max(axis=-1, keepdims=True)
    stops = np.clip(np.log2(np.maximum(peak, 1.0)) / WHITE_STOPS, 0.0, 1.0)
    fade = stops * stops * (3.0 - 2.0 * stops)
    rolled = _shoulder(light + (peak - light) * fade)
    encoded = np.where(rolled <= 0.0031308, 12.92 * rolled, 1.055 * np.power(np.maximum(rolled, 1e-9), 1 / 2.4) - 0.055)
    return (np.clip(encoded, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def check_writable(path: Path) -> None:
    """LocalFault unless a file can be made in the folder of `path`: asked before the work, not after it."""
    folder = path.parent
    if path.is_dir():
        raise LocalFault("the output is a folder", where=str(path), remedy="name a file in it")
    if not folder.is_dir():
        raise LocalFault("the output folder does not exist", where=str(folder), remedy="make it first")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise LocalFault(f"cannot write there: {error.strerror}", where=str(folder), remedy="choose another output folder") from error


def _shoulder(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """Identity up to SHOULDER_START, then towards 1 with the same slope at the join."""
    room = 1.0 - SHOULDER_START
    return np.where(light <= SHOULDER_START, light, 1.0 - room * np.exp(-np.maximum(light - SHOULDER_START, 0.0) / room))


def _planes(layer: str, pixels: Layer) -> list[Layer]:
    assert pixels.ndim in (2, 3), f"layer {layer} has {pixels.ndim} dimensions"
    planes = [pixels] if pixels.ndim == 2 else [pixels[..., index] for index in range(pixels.shape[2])]
    return [np.ascontiguousarray(plane, dtype=np.float32) for plane in planes]


def _channel_names(layer: str, count: int) -> str:
    known = _CHANNELS.get(layer, "")
    if len(known) == count:
        return known
    return {1: "Y", 3: "RGB", 4: "RGBA"}.get(count, "0123456789"[:count])


def _write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(temporary)
        temporary.replace(path)
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LocalFault(f"cannot write the image: {reason}", where=str(path), remedy="check the folder and the free space") from error
    finally:
        temporary.unlink(missing_ok=True)
