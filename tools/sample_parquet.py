"""The sample scene's textured surface: a floor of oak herringbone, drawn from formulas, as PNG."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

_SIDE = 512
_PLANK = 64
"""Pixels across a plank; a plank is four times as long as wide."""


def _noise(dice: np.random.Generator, rows: int, columns: int) -> NDArray[np.float64]:
    """Smooth noise that repeats at the edges."""
    grid = dice.random((rows, columns))
    grid = np.vstack([grid, grid[:1]])
    grid = np.hstack([grid, grid[:, :1]])
    y, x = np.linspace(0, rows, _SIDE, endpoint=False), np.linspace(0, columns, _SIDE, endpoint=False)
    along = np.array([np.interp(x, np.arange(columns + 1), row) for row in grid])
    return np.array([np.interp(y, np.arange(rows + 1), column) for column in along.T]).T


def _herringbone() -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.float64]]:
    """Per pixel: the plank's number, whether it lies across, and the distance to its long edge (0 to 0.5)."""
    y, x = np.mgrid[0:_SIDE, 0:_SIDE]
    cell_x, cell_y = x // _PLANK, y // _PLANK
    # Diagonals of cells, eight of them, repeat: four belong to a plank that lies, four to one that stands.
    diagonal = (cell_x - cell_y) % 8
    lies = diagonal < 4
    number = np.where(lies, ((cell_x - diagonal) % 8) * 8 + cell_y, 64 + cell_x * 8 + (cell_y + diagonal - 4) % 8)
    across = np.where(lies, y % _PLANK, x % _PLANK) / _PLANK
    end = np.where(lies, (x % _PLANK) / _PLANK + diagonal, (y % _PLANK) / _PLANK + 7 - diagonal)
    to_end = np.minimum(end, 4 - end)
    return number, lies, np.minimum(np.minimum(across, 1 - across), to_end)


def parquet() -> tuple[bytes, bytes]:
    """Base colour, and roughness (green) with metallic (blue), both as PNG files."""
    dice = np.random.default_rng(20)
    number, lies, edge = _herringbone()
    tone = dice.random(128)[number]
    grain = np.where(lies, _noise(dice, 256, 12), _noise(dice, 12, 256))
    fine = np.where(lies, _noise(dice, 512, 40), _noise(dice, 40, 512))
    light = 0.62 + 0.30 * tone + 0.22 * (grain - 0.5) + 0.10 * (fine - 0.5)
    joint = np.clip(edge * 28, 0.25, 1)
    oak = np.array([0.74, 0.52, 0.33]) * (light * joint)[..., None]
    oak[..., 2] *= 0.92 + 0.16 * tone
    roughness = np.clip(0.30 + 0.22 * (grain - 0.5) + 0.35 * (1 - joint), 0, 1)
    rough = np.stack([np.ones_like(roughness), roughness, np.zeros_like(roughness)], -1)
    return _png(oak, 96), _png(rough, 24)


def _png(values: NDArray[np.float64], colours: int) -> bytes:
    image = Image.fromarray(np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8))
    file = io.BytesIO()
    image.quantize(colours, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return file.getvalue()
