"""What an image of a scene is by default: entry 12 of its log (design of the consensus §3; specs/16-scene-log.md, Folding)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scenefold.base.image_limits import CAMERA_NAME_BYTES_MAX, DEPTH_MAX, EXPOSURE_MAX, SAMPLES_MAX, SIDE_MAX, SKY_MAX
from scenefold.wire.common import F64
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Maybe, Text, Uint


@dataclass(frozen=True, slots=True)
class RenderSettings:
    """None: the scene does not say, and whoever renders chooses. `width` and `height` in pixels; `samples`: paths for each pixel; `depth`: segments of a
    path at most; `sky`: radiance of a uniform sky, linear RGB; `exposure`: of the picture for people, in stops; `camera`: the name of one."""

    width: int | None = None
    height: int | None = None
    samples: int | None = None
    depth: int | None = None
    sky: tuple[float, ...] | None = None
    exposure: float | None = None
    camera: str | None = None


@dataclass(frozen=True, slots=True)
class Sensible:
    """An image has both sides or neither, and a sky and an exposure that a camera could meet."""

    def holds(self, value: Any) -> bool:
        has_sides = (value.width is None) == (value.height is None)
        is_colour = value.sky is None or all(0.0 <= channel <= SKY_MAX for channel in value.sky)
        return has_sides and is_colour and value.camera != "" and (value.exposure is None or abs(value.exposure) <= EXPOSURE_MAX)

    def __str__(self) -> str:
        return f"width and height both or neither, each of sky from 0 to {SKY_MAX:.0f}, exposure from -{EXPOSURE_MAX:.0f} to {EXPOSURE_MAX:.0f}, camera not empty"


RENDER_SETTINGS = Struct(
    RenderSettings,
    ("width", Maybe(Uint(16, least=1, most=SIDE_MAX))),
    ("height", Maybe(Uint(16, least=1, most=SIDE_MAX))),
    ("samples", Maybe(Uint(32, least=1, most=SAMPLES_MAX))),
    ("depth", Maybe(Uint(8, least=1, most=DEPTH_MAX))),
    ("sky", Maybe(Many(F64, counts=(3,)))),
    ("exposure", Maybe(F64)),
    ("camera", Maybe(Text(CAMERA_NAME_BYTES_MAX))),
    law=Sensible(),
)
