"""View transforms: linear light to the 8-bit sRGB that a screen shows. Pure; for looking at: the EXR holds the truth.

`agx`     AgX by Troy Sobotka (https://github.com/sobotka/AgX), written from its description: light is mixed towards grey
          as if the primaries of Rec.709 were moved a fifth of the way to white, so that no channel is ever alone;
          log2 from 10 stops below middle grey to 6.5 above; a sigmoid through the middle; and mixed back. What grows
          brighter grows paler and ends in white, instead of in the nearest corner of the cube.
`filmic`  everything up to SHOULDER_START as it is (a grey card looks like a grey card), what is brighter is rolled
          off, very bright colours fade to white, as on film.
`srgb`    no transform at all: what is brighter than white is clipped, channel by channel.

Middle grey, 0.18, becomes 0.5 of the screen's range (128 of 255) in `agx`, and stays 0.18 of the screen's light (118) in
the others. Pixels that are no number are shown black, infinite ones as the brightest there is, and counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

AGX = "agx"
MIDDLE_GREY = 0.18

EXPOSED_QUANTILE = 0.85
EXPOSED_TO = 0.6
"""Automatic exposure brings this quantile of the lit pixels' luminance to this value."""
EXPOSURE_LEFT_ALONE = 1.0
"""Stops by which an image may be off before it is corrected."""

SHOULDER_START = 0.6
"""Linear display value up to which `filmic` changes nothing."""
WHITE_STOPS = 8.0
"""Stops above 1 at which a saturated colour has faded to white in `filmic`."""

_PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_WHITE = (0.3127, 0.3290)
"""Rec.709, CIE x and y: red, green, blue, and D65."""
_INSET = 0.2
"""How far the primaries are moved towards white."""
_STOPS_BELOW, _STOPS_ABOVE = 10.0, 6.5
"""Of middle grey, that the sigmoid has room for."""
_PIVOT_X = _STOPS_BELOW / (_STOPS_BELOW + _STOPS_ABOVE)
_PIVOT_Y = 0.5
_SLOPE = 2.0
"""Of the sigmoid where it passes middle grey."""
_TOE, _SHOULDER = 3.0, 3.25
"""How sharply it bends below and above."""

_BLACK = 1e-10
"""The least light that has a logarithm here: far below the toe's end."""
_BRIGHTEST = 1e30


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture for a screen."""

    pixels: npt.NDArray[np.uint8]
    """uint8[H, W, 3]"""
    exposure: float
    """In stops: what it was brightened by."""
    not_finite: int
    """Pixels of the image that were infinite, or no number."""


def shown(beauty: npt.NDArray[np.float32], view: str, exposure: float | None = None) -> Shown:
    """An image, float32[H, W, 3], through one of `VIEWS`; `exposure` in stops, None: as the image asks."""
    finite = np.isfinite(beauty).all(axis=-1)
    stops = automatic_exposure(beauty) if exposure is None else exposure
    light = np.nan_to_num(beauty.astype(np.float64), nan=0.0, posinf=_BRIGHTEST, neginf=0.0)
    encoded = VIEWS[view](np.clip(light * 2.0**stops, 0.0, _BRIGHTEST))
    pixels = (np.clip(encoded, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return Shown(pixels, stops, int(finite.size - np.count_nonzero(finite)))


def automatic_exposure(beauty: npt.NDArray[np.float32]) -> float:
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


def agx(light: F64) -> F64:
    """Linear Rec.709 light [..., 3], from 0 on, to the screen's signal."""
    mixed = light @ _INSET_MATRIX.T
    stops = np.log2(np.maximum(mixed, _BLACK) / MIDDLE_GREY)
    return _sigmoid(np.clip((stops + _STOPS_BELOW) / (_STOPS_BELOW + _STOPS_ABOVE), 0.0, 1.0)) @ _OUTSET_MATRIX.T


def filmic(light: F64) -> F64:
    """Linear light [..., 3], from 0 on, to the screen's signal."""
    peak = light.max(axis=-1, keepdims=True)
    stops = np.clip(np.log2(np.maximum(peak, 1.0)) / WHITE_STOPS, 0.0, 1.0)
    fade = stops * stops * (3.0 - 2.0 * stops)
    return srgb(_shoulder(light + (peak - light) * fade))


def srgb(light: F64) -> F64:
    """IEC 61966-2-1: linear light [..., 3] to the screen's signal; above 1 it is left to whoever clips."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.power(np.maximum(light, 1e-9), 1 / 2.4) - 0.055)


VIEWS: Mapping[str, Callable[[F64], F64]] = {AGX: agx, "filmic": filmic, "srgb": srgb}


def _xyz_of_rgb(inset: float) -> F64:
    """The matrix that turns RGB into XYZ, [3, 3], the primaries of Rec.709 being moved so far towards white (SMPTE RP 177)."""
    white = np.array(_WHITE)
    primaries = white + (np.array(_PRIMARIES) - white) * (1.0 - inset)
    columns = np.array([[x / y, 1.0, (1.0 - x - y) / y] for x, y in (*primaries, white)]).T
    scale = np.linalg.solve(columns[:, :3], columns[:, 3])
    matrix: F64 = (columns[:, :3] * scale).astype(np.float64)
    return matrix


def _inset_matrix() -> F64:
    """Linear Rec.709 to the same mixed towards grey; its rows sum up to 1, so greys stay as they are."""
    matrix = np.linalg.solve(_xyz_of_rgb(0.0), _xyz_of_rgb(_INSET)).astype(np.float64)
    mixed: F64 = matrix / matrix.sum(axis=1, keepdims=True)
    return mixed


def _sigmoid(x: F64) -> F64:
    """From (0, 0) through the pivot to (1, 1): y = s h / (1 + h^p)^(1/p), h = slope (x - pivot) / s, on either side with its p.

    s is chosen so that the curve meets its end.
    """
    above = x >= _PIVOT_X
    power = np.where(above, _SHOULDER, _TOE)
    scale = np.where(above, _reach(1.0 - _PIVOT_X, 1.0 - _PIVOT_Y, _SHOULDER), _reach(_PIVOT_X, _PIVOT_Y, _TOE))
    h = _SLOPE * np.abs(x - _PIVOT_X) / scale
    return _PIVOT_Y + np.where(above, 1.0, -1.0) * scale * h / np.power(1.0 + np.power(h, power), 1.0 / power)


def _reach(width: float, height: float, power: float) -> float:
    """The s of half a sigmoid that rises by `height` over `width`: from height = s h / (1 + h^p)^(1/p) with h = slope width / s."""
    straight = _SLOPE * width
    return float((height**-power - straight**-power) ** (-1.0 / power))


def _shoulder(light: F64) -> F64:
    """Identity up to SHOULDER_START, then towards 1 with the same slope at the join."""
    room = 1.0 - SHOULDER_START
    return np.where(light <= SHOULDER_START, light, 1.0 - room * np.exp(-np.maximum(light - SHOULDER_START, 0.0) / room))


_INSET_MATRIX = _inset_matrix()
_OUTSET_MATRIX: F64 = np.linalg.inv(_INSET_MATRIX).astype(np.float64)
