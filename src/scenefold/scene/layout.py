"""Which spaces a scene's content lies in, and where in them (specs/05-scene-content.md).

All spaces share the one line. Geometry lies in a space of three dimensions at the Hilbert index of its
centre, so that neighbours in the world are neighbours on the line. Everything else is a list: item i of a
list lies at the bit reversal of i, which spreads any number of items evenly over all nodes.

    META       the scene document at the first location: where every table's pages are
    GEOMETRY   geometry atoms
    MATERIALS  pages of materials                TEXTURES   pages of texture heads, and RGBA8 tiles
    CAMERAS    pages of cameras                  LIGHTS     pages of punctual lights and of the light table
    INSTANCES  pages of the instance table       GROUPS     pages of the group table
    RENDERS    incremental renders; the nodes choose the places
    FILES      named files
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, Location

if TYPE_CHECKING:
    from scenefold.curve import Lattice

META = SpaceId(1)
GEOMETRY = SpaceId(2)
MATERIALS = SpaceId(3)
TEXTURES = SpaceId(4)
CAMERAS = SpaceId(5)
LIGHTS = SpaceId(6)
INSTANCES = SpaceId(7)
GROUPS = SpaceId(8)
RENDERS = SpaceId(9)
FILES = SpaceId(10)

DOCUMENT_LOCATION = FIRST
"""Where the scene document lies in META."""


@dataclass(frozen=True, slots=True)
class SpaceLayout:
    """A space as the first record of a scene's log creates it (scene/log/first.py).

    Its lattice there spans the unit box: places in lists have no meaning in the world, and those of an import's geometry lie
    in the lattice that the scene document names.
    """

    id: SpaceId
    name: str
    dimensions: int
    curve: Literal["hilbert", "z-order"]
    node_managed: bool = False
    render_output: bool = False


SPACES: tuple[SpaceLayout, ...] = (
    SpaceLayout(META, "meta", 1, "hilbert"),
    SpaceLayout(GEOMETRY, "geometry", 3, "hilbert"),
    SpaceLayout(MATERIALS, "materials", 1, "hilbert"),
    SpaceLayout(TEXTURES, "textures", 1, "hilbert"),
    SpaceLayout(CAMERAS, "cameras", 1, "hilbert"),
    SpaceLayout(LIGHTS, "lights", 1, "hilbert"),
    SpaceLayout(INSTANCES, "instances", 1, "hilbert"),
    SpaceLayout(GROUPS, "groups", 1, "hilbert"),
    SpaceLayout(RENDERS, "renders", 1, "hilbert", node_managed=True, render_output=True),
    SpaceLayout(FILES, "files", 1, "hilbert"),
)
SPACE_NAMES: dict[int, str] = {space.id: space.name for space in SPACES}

_ITEM_BITS = 64


def item_location(item: int) -> Location:
    """The place of item `item` (0 <= item < 2^64) of a list: its 64 bits reversed, at the top of the line."""
    if not 0 <= item < 1 << _ITEM_BITS:
        raise ValueError(f"a list has 2^{_ITEM_BITS} places, {item} is none of them")
    mirrored = int(f"{item:0{_ITEM_BITS}b}"[::-1], 2)
    return Location.from_number(mirrored << (8 * len(FIRST) - _ITEM_BITS))


def geometry_lattice(low: NDArray[np.float64], high: NDArray[np.float64]) -> Lattice:
    """The lattice of the GEOMETRY space over a box (f64[3] each, low < high)."""
    # Late, because the curves load numba, and most who need a layout need no curve.
    from scenefold.curve import Curve, Lattice

    return Lattice(Curve("hilbert", 3), low, high)
