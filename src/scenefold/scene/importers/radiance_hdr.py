"""Radiance's picture format, as environment maps come in it: four bytes a pixel, of which the last is a common exponent.

    #?RADIANCE
    FORMAT=32-bit_rle_rgbe
    EXPOSURE=1.0                    what the pixels were multiplied by; several multiply

    -Y 512 +X 1024                  rows from the top, pixels from the left: the only order that is read
    rows                            run lengths a channel, or plain pixels

A row in run lengths begins with 2, 2 and its width as u16, big endian; then for each of the four channels: n > 128 and a byte that stands
there n - 128 times, or n <= 128 and so many bytes. (Greg Ward, Real Pixels, Graphics Gems II, 1991; Radiance's color.c as the reference.)
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import TEXTURE_PIXELS_MAX, TEXTURE_SIDE_MAX
from scenefold.scene.importers.faults import bad_file
from scenefold.scene.importers.source import NotCarried

_HEADER_BYTES_MAX = 1 << 16
_RUN_WIDTHS = range(8, 32768)
"""Rows of other widths are never in run lengths."""


def read_hdr(path: Path, _left: NotCarried) -> NDArray[np.float32]:
    """Linear radiance f32[height, width, 3], row 0 on top; LocalFault if the file is none."""
    content = path.read_bytes()
    match = re.match(rb"#\?[^\n]*\n((?:[^\n]*\n)*?)\n-Y (\d{1,6}) \+X (\d{1,6})\n", content[:_HEADER_BYTES_MAX])
    if match is None:
        raise bad_file(path, "the file is no Radiance picture with rows from the top and pixels from the left")
    if re.search(rb"^FORMAT=(?!32-bit_rle_rgbe)", match[1], re.MULTILINE):
        raise bad_file(path, "the Radiance picture is not in RGB", "save it as 32-bit_rle_rgbe, or as OpenEXR")
    height, width = int(match[2]), int(match[3])
    if not (0 < width <= TEXTURE_SIDE_MAX and 0 < height <= TEXTURE_SIDE_MAX and width * height <= TEXTURE_PIXELS_MAX):
        raise bad_file(path, f"the Radiance picture has {width} x {height} pixels", "make it smaller")
    exposure = 1.0
    for said in re.findall(rb"^EXPOSURE=\s*([0-9.eE+-]+)\s*$", match[1], re.MULTILINE):
        exposure *= _exposure(path, said)
    scales = np.ldexp(1.0, np.arange(256) - 136) / exposure
    scales[0] = 0.0
    radiance = np.empty((height, width, 3), np.float32)
    pixels = np.empty((width, 4), np.uint8)
    at = match.end()
    try:
        for row in range(height):
            at = _read_row(content, at, pixels)
            radiance[row] = pixels[:, :3] * scales[pixels[:, 3], None]
    except (IndexError, ValueError) as error:
        raise bad_file(path, f"the Radiance picture is damaged or cut short, in row {row}") from error
    return radiance


def _exposure(path: Path, said: bytes) -> float:
    try:
        value = float(said)
    except ValueError:
        value = 0.0
    if not 1e-30 < value < 1e30:
        raise bad_file(path, "the Radiance picture has an odd exposure")
    return value


def _read_row(content: bytes, at: int, row: NDArray[np.uint8]) -> int:
    """Fill u8[width, 4] from `at` on; where the next row begins. IndexError or ValueError if it is not all there."""
    width = len(row)
    if width not in _RUN_WIDTHS or content[at : at + 2] != b"\x02\x02" or content[at + 2] & 0x80:
        plain = np.frombuffer(content, np.uint8, 4 * width, at).reshape(width, 4)
        if (plain[:, :3] == 1).all(axis=1).any():
            raise ValueError("run lengths of the oldest kind")
        row[:] = plain
        return at + 4 * width
    if content[at + 2] << 8 | content[at + 3] != width:
        raise ValueError("a row of another width")
    at += 4
    for channel in range(4):
        column = 0
        while column < width:
            count = content[at]
            run = count > 128
            count = count - 128 if run else count
            if count == 0 or column + count > width:
                raise ValueError("a run that is too long or none")
            row[column : column + count, channel] = content[at + 1] if run else np.frombuffer(content, np.uint8, count, at + 1)
            at += 2 if run else 1 + count
            column += count
    return at
