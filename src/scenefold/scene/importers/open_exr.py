"""OpenEXR as environment maps come in it: of many channels and parts that a file may have, the picture in the first part.

Nothing else is decoded. What the headers claim of all parts is held against a bound first: a tile of any size is decoded with all of its channels.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from scenefold.base.limits import TEXTURE_PIXELS_MAX, TEXTURE_SIDE_MAX
from scenefold.scene.importers.faults import bad_file
from scenefold.scene.importers.source import NotCarried

F32 = NDArray[np.float32]
_CHROMA = ("RY", "BY")
_KINDS: dict[str, DTypeLike] = {"HALF": np.float16, "FLOAT": np.float32, "UINT": np.uint32}
_NUMBER_BYTES = 4
"""Of the widest of them."""
_DECODED_BYTES_MAX = 2 << 30
"""All channels of all parts: some sixty at 4096 x 2048."""
_ROWS = 256
"""At a time: as many as the largest chunk of any compression has."""


def read_exr(path: Path, left: NotCarried) -> F32:
    """Linear radiance f32[height, width, 3], row 0 on top; LocalFault if the file is none, or holds too much."""
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            parts = [(_size(part.header["dataWindow"]), len(part.header["channels"])) for part in file.parts]
            top = int(file.header()["dataWindow"][0][1])
        _check_sizes(path, parts)
        left.note("parts of the OpenEXR file beside the first", len(parts) - 1)
        # Its File would decode all channels of all parts.
        with closing(OpenEXR.InputFile(str(path))) as picture:
            channels = picture.header()["channels"]
            kinds = {name: _kind_of(path, name, channels[name]) for name in _chosen(path, channels)}
            left.note(
                "colours of an OpenEXR picture in luminance and chroma, grey here",
                int("Y" in kinds and not channels.keys().isdisjoint(_CHROMA)),
            )
            return _read_rows(picture, kinds, parts[0][0], top)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        raise bad_file(path, f"the OpenEXR file cannot be read, {error}") from error


def _read_rows(picture: Any, kinds: dict[str, DTypeLike], size: tuple[int, int], top: int) -> F32:
    """All rows of these channels, of which one stands for all three; `top` is the number of the first row."""
    width, height = size
    radiance = np.empty((height, width, 3), np.float32)
    for first in range(0, height, _ROWS):
        rows = radiance[first : first + _ROWS]
        found = picture.channels(list(kinds), scanLine1=top + first, scanLine2=top + first + len(rows) - 1)
        for at, (content, kind) in enumerate(zip(found, kinds.values(), strict=True)):
            colours = rows if len(kinds) == 1 else rows[:, :, at : at + 1]
            colours[:] = np.frombuffer(content, kind).reshape(len(rows), width, 1)
    return radiance


def _size(window: tuple[NDArray[np.int32], NDArray[np.int32]]) -> tuple[int, int]:
    width, height = (int(last) - int(first) + 1 for first, last in zip(*window, strict=True))
    return width, height


def _check_sizes(path: Path, parts: list[tuple[tuple[int, int], int]]) -> None:
    """LocalFault if the picture is too large, or all parts, with so many channels each, would be."""
    (width, height), _ = parts[0]
    if max(width, height) > TEXTURE_SIDE_MAX or width * height > TEXTURE_PIXELS_MAX:
        raise bad_file(path, f"the map has {width} x {height} pixels", "make it smaller")
    decoded = sum(width * height * channels * _NUMBER_BYTES for (width, height), channels in parts)
    if decoded > _DECODED_BYTES_MAX:
        what = f"all channels and parts of the OpenEXR file have {decoded} bytes, over {_DECODED_BYTES_MAX}"
        raise bad_file(path, what, "save it with the channels R, G and B alone")


def _chosen(path: Path, channels: Collection[str]) -> str:
    if set("RGB") <= set(channels):
        return "RGB"
    if "Y" in channels:
        return "Y"
    raise bad_file(path, "the OpenEXR file has no channels R, G and B in its first part", "give one with a picture in it")


def _kind_of(path: Path, name: str, channel: Any) -> DTypeLike:
    if (channel.xSampling, channel.ySampling) != (1, 1):
        raise bad_file(path, f"the channel {name} of the OpenEXR file is not there for every pixel", "save it in full resolution")
    return _KINDS[str(channel.type)]
