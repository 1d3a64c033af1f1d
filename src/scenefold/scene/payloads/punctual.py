"""Punctual lights, as KHR_lights_punctual has them (specs/05-scene-content.md).

`color` has the intensity multiplied in: for points and spots what the file calls candela, for directional
lights lux. `direction` is the way that the light travels (unit length), in the world. Cone angles in radians.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.scene.payloads.values import Fields, decode_page, encode_pages, shorten

KIND, VERSION = "punctual lights", 1
LightKind = Literal["point", "spot", "directional"]
_KINDS: dict[str, LightKind] = {"point": "point", "spot": "spot", "directional": "directional"}
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class PunctualLight:
    name: str = ""
    kind: LightKind
    position: Triple = (0.0, 0.0, 0.0)
    direction: Triple = (0.0, 0.0, -1.0)
    color: Triple
    inner_cone: float = 0.0
    outer_cone: float = math.pi / 4
    range: float = 0.0
    """Beyond this distance the light ends; 0: it does not."""


def encode_punctual(lights: Sequence[PunctualLight]) -> list[bytes]:
    """Pages in order."""
    return encode_pages(KIND, VERSION, [_to_map(light) for light in lights])


def decode_punctual(payload: bytes) -> tuple[int, list[PunctualLight]]:
    """The number of a page's first light, and its lights; DamagedData if anything is off."""
    return decode_page(payload, KIND, VERSION, _from_fields)


def _to_map(light: PunctualLight) -> dict[str, Any]:
    return {
        "name": shorten(light.name),
        "kind": light.kind,
        "position": [float(value) for value in light.position],
        "direction": [float(value) for value in light.direction],
        "color": [float(value) for value in light.color],
        "inner_cone": float(light.inner_cone),
        "outer_cone": float(light.outer_cone),
        "range": float(light.range),
    }


def _from_fields(fields: Fields) -> PunctualLight:
    kind = fields.text("kind")
    fields.require(kind in _KINDS, f"has the unknown kind {kind!r}")
    position = fields.numbers("position", 3, -COORDINATE_ABS_MAX, COORDINATE_ABS_MAX)
    direction = fields.numbers("direction", 3, -1.0, 1.0)
    fields.require(abs(sum(value * value for value in direction) - 1.0) < 1e-6, "has a direction that is none")
    color = fields.numbers("color", 3, 0.0, 1e30)
    light = PunctualLight(
        name=fields.text("name"),
        kind=_KINDS[kind],
        position=(position[0], position[1], position[2]),
        direction=(direction[0], direction[1], direction[2]),
        color=(color[0], color[1], color[2]),
        inner_cone=fields.number("inner_cone", 0.0, math.pi / 2),
        outer_cone=fields.number("outer_cone", 0.0, math.pi / 2),
        range=fields.number("range", 0.0),
    )
    fields.require(light.inner_cone < light.outer_cone, "has cones that cross")
    return light
