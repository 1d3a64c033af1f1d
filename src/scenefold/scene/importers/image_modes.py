"""Any image that Pillow opens as RGBA of 8 bits a channel, whatever its file has: greys, palettes, CMYK, 16 bits, floats.

Pillow keeps of 16 bits in several channels only the higher 8. An image is decoded a second time here with the bytes of each
number exchanged, which gives the lower 8; so numbers are rounded (v / 257) and not cut off. Wide numbers exist for some rows at a
time: of the whole image there are what Pillow decoded, once or twice, and the result, 4 bytes a pixel each.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile, UnidentifiedImageError

from scenefold.scene.importers.source import Pixels

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF")
_EXCHANGED = {
    "RGB;16B": "RGB;16L", "RGB;16L": "RGB;16B", "RGB;16N": "RGB;16B",
    "RGBA;16B": "RGBA;16L", "RGBA;16L": "RGBA;16B", "RGBA;16N": "RGBA;16B",
}  # fmt: skip
"""The layout of a file's pixels, as Pillow names it, and the one whose upper bytes are its lower ones. N is as this machine has it: L."""
_GREY_AND_ALPHA = "LA;16B"
_AS_BYTES = "RGBA"
"""Four bytes a pixel: two of grey, two of alpha."""
_BLOCK_PIXELS = 1 << 16


def opened(content: bytes | memoryview) -> ImageFile.ImageFile:
    """The image, not decoded yet; ValueError if no format begins so, and whatever Pillow raises of a damaged head."""
    with warnings.catch_warnings():
        # Pillow warns of sizes beyond our own limit, which we turn into an error anyway.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            return Image.open(io.BytesIO(content), formats=FORMATS)
        except UnidentifiedImageError as error:
            # Pillow would name the object that holds the bytes.
            raise ValueError(f"it is none of {', '.join(FORMATS)}") from error


def rgba_of(image: ImageFile.ImageFile, content: bytes | memoryview) -> tuple[Pixels, bool]:
    """u8[height, width, 4], and whether the file has more than 8 bits a channel. `image` is what `opened` gave for `content`."""
    layout = _layout_of(image)
    key = image.info.get("transparency")
    if image.mode == "F":
        return _by_rows(image, lambda rows: _of_grey(_of_floats(_rows(image, rows)))), True
    if image.mode.startswith("I"):
        return _by_rows(image, lambda rows: _of_deep_grey(_rows(image, rows), key)), True
    if layout == _GREY_AND_ALPHA:
        parts = _decoded_as(content, _AS_BYTES)
        return _by_rows(image, lambda rows: _of_grey_and_alpha(_rows(parts, rows))), True
    if layout in _EXCHANGED:
        lower = _decoded_as(content, _EXCHANGED[layout])
        return _by_rows(image, lambda rows: _of_deep_colours(_words(_rows(image, rows), _rows(lower, rows)), key)), True
    return np.asarray(image.convert("RGBA")), False


def _by_rows(image: Image.Image, block: Callable[[range], Pixels]) -> Pixels:
    """The image out of what `block` makes of each few of its rows."""
    pixels = np.empty((image.height, image.width, 4), np.uint8)
    step = max(_BLOCK_PIXELS // image.width, 1)
    for first in range(0, image.height, step):
        rows = range(first, min(first + step, image.height))
        pixels[first : rows.stop] = block(rows)
    return pixels


def _rows(image: Image.Image, rows: range) -> NDArray[Any]:
    return np.asarray(image.crop((0, rows.start, image.width, rows.stop)))


def _layout_of(image: ImageFile.ImageFile) -> str:
    """As Pillow names it; empty where it depends on the place, or is not said."""
    names = {_name_of(tile.args) for tile in image.tile}
    return names.pop() if len(names) == 1 else ""


def _name_of(arguments: Any) -> str:
    first = arguments[0] if isinstance(arguments, tuple) and arguments else arguments
    return first if isinstance(first, str) else ""


def _decoded_as(content: bytes | memoryview, layout: str) -> Image.Image:
    """The image, decoded as if its pixels lay otherwise."""
    image = opened(content)
    renamed: list[Any] = [tile._replace(args=(layout, *tile.args[1:]) if isinstance(tile.args, tuple) else layout) for tile in image.tile]
    image.tile = renamed
    return image


def _words(upper: Pixels, lower: Pixels) -> NDArray[np.uint16]:
    return upper.astype(np.uint16) * np.uint16(256) + lower


def _rounded(words: NDArray[np.uint16]) -> Pixels:
    """u8 of 16 bits: 65,535 becomes 255."""
    return ((words.astype(np.uint32) + np.uint32(128)) // np.uint32(257)).astype(np.uint8)


def _of_floats(values: NDArray[Any]) -> Pixels:
    """u8 of floats, of which 1 is white: what is beyond is white too, and what is no number is black."""
    shares = np.clip(np.nan_to_num(values.astype(np.float64), nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.rint(shares * 255.0).astype(np.uint8)


def _of_grey(grey: Pixels, clear: NDArray[np.bool_] | None = None) -> Pixels:
    alpha = np.full_like(grey, 255)
    if clear is not None:
        alpha[clear] = 0
    return np.dstack([grey, grey, grey, alpha])


def _of_deep_grey(values: NDArray[Any], key: Any) -> Pixels:
    """RGBA of whole numbers of which 65,535 is white; `key` is the one that is clear, if it is one."""
    words = np.clip(values, 0, 65_535).astype(np.uint16)
    return _of_grey(_rounded(words), words == key if isinstance(key, int) else None)


def _of_grey_and_alpha(parts: Pixels) -> Pixels:
    return _rounded(_words(parts[..., 0::2], parts[..., 1::2]))[..., [0, 0, 0, 1]]


def _of_deep_colours(words: NDArray[np.uint16], key: Any) -> Pixels:
    """RGBA of RGB or RGBA; `key` is the one colour that is clear, in 16 bits, if it is one."""
    pixels = _rounded(words)
    if pixels.shape[2] == 4:
        return pixels
    alpha = np.full(pixels.shape[:2], 255, np.uint8)
    if isinstance(key, tuple) and len(key) == 3:
        alpha[(words == np.array(cast("tuple[int, int, int]", key))).all(axis=2)] = 0
    return np.dstack([pixels, alpha])
