"""What an image of a scene is by default: entry 12 of its log (design of the consensus §3; specs/16-scene-log.md, Folding)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Self

from scenefold.base.image_limits import (
    ADAPTIVE_MAX,
    CAMERA_NAME_BYTES_MAX,
    CLAMP_MAX,
    DEPTH_MAX,
    EXPOSURE_MAX,
    FOCUS_MIN,
    MIN_SAMPLES_LEAST,
    ROTATION_MAX,
    SAMPLERS,
    SAMPLES_MAX,
    SIDE_MAX,
    SKY_MAX,
)
from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.wire.common import F64
from scenefold.wire.containers import Late, Many, Struct
from scenefold.wire.kinds import Maybe, Text, Uint

_SAMPLER_BYTES_MAX = 32


@dataclass(frozen=True, slots=True)
class PathSettings:
    """How paths are drawn and ended, and through which lens. None: the scene does not say.

    `aperture`: radius of the lens, `focus`: how far everything is sharp, both in the world's unit; `sampler`: one of SAMPLERS; `roulette_from`: bounce
    from which on a path may end by chance; `clamp_direct`, `clamp_indirect`: radiance that one contribution may have; `adaptive`: error relative to
    a pixel's brightness at which it ends, `min_samples`: paths before that; `environment_rotation`: degrees about +Y.
    """

    aperture: float | None = None
    focus: float | None = None
    sampler: str | None = None
    roulette_from: int | None = None
    clamp_direct: float | None = None
    clamp_indirect: float | None = None
    adaptive: float | None = None
    min_samples: int | None = None
    environment_rotation: float | None = None


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
    paths: PathSettings = PathSettings()

    def flat(self) -> dict[str, Any]:
        """All of them by name, those of `paths` among them; None where the scene does not say."""
        own = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "paths"}
        return own | {one.name: getattr(self.paths, one.name) for one in fields(PathSettings)}

    def changed(self, given: Mapping[str, Any]) -> Self:
        """With other values under these names, of `flat`; KeyError for a name that is none."""
        names = {one.name for one in fields(PathSettings)}
        own = {name: value for name, value in given.items() if name not in names}
        if not own.keys() <= self.flat().keys():
            raise KeyError(next(iter(own.keys() - self.flat().keys())))
        paths = replace(self.paths, **{name: value for name, value in given.items() if name in names})
        return replace(self, **own, paths=paths)


@dataclass(frozen=True, slots=True)
class Sensible:
    """An image has both sides or neither, and a sky and an exposure that a camera could meet."""

    def holds(self, value: Any) -> bool:
        has_sides = (value.width is None) == (value.height is None)
        is_colour = value.sky is None or all(0.0 <= channel <= SKY_MAX for channel in value.sky)
        return has_sides and is_colour and value.camera != "" and (value.exposure is None or abs(value.exposure) <= EXPOSURE_MAX)

    def __str__(self) -> str:
        return f"width and height both or neither, each of sky from 0 to {SKY_MAX:.0f}, exposure from -{EXPOSURE_MAX:.0f} to {EXPOSURE_MAX:.0f}, camera not empty"


@dataclass(frozen=True, slots=True)
class Traceable:
    """Something is said, a lens is whole, and each number is one that a render can have."""

    def holds(self, value: Any) -> bool:
        has_lens = (value.aperture is None) == (value.focus is None)
        radius, focus = (1.0 if length is None else length for length in (value.aperture, value.focus))
        lens_fits = 0.0 < radius <= COORDINATE_ABS_MAX and FOCUS_MIN <= focus <= COORDINATE_ABS_MAX
        sampler_fits = value.sampler is None or value.sampler in SAMPLERS
        clamps_fit = all(clamp is None or 0.0 < clamp <= CLAMP_MAX for clamp in (value.clamp_direct, value.clamp_indirect))
        adaptive_fits = value.min_samples is None if value.adaptive is None else 0.0 < value.adaptive <= ADAPTIVE_MAX
        turn_fits = value.environment_rotation is None or abs(value.environment_rotation) <= ROTATION_MAX
        return value != PathSettings() and has_lens and lens_fits and sampler_fits and clamps_fit and adaptive_fits and turn_fits

    def __str__(self) -> str:
        return (
            f"some of them, aperture and focus both or neither, aperture above 0, focus from {FOCUS_MIN:g}, both up to {COORDINATE_ABS_MAX:.0f}, "
            f"sampler {' or '.join(SAMPLERS)}, clamps above 0 up to {CLAMP_MAX:.0f}, adaptive above 0 up to {ADAPTIVE_MAX:g}, "
            f"min_samples with adaptive only, environment_rotation from -{ROTATION_MAX:.0f} to {ROTATION_MAX:.0f}"
        )


PATH_SETTINGS = Struct(
    PathSettings,
    ("aperture", Maybe(F64)),
    ("focus", Maybe(F64)),
    ("sampler", Maybe(Text(_SAMPLER_BYTES_MAX))),
    ("roulette_from", Maybe(Uint(8, least=1, most=DEPTH_MAX))),
    ("clamp_direct", Maybe(F64)),
    ("clamp_indirect", Maybe(F64)),
    ("adaptive", Maybe(F64)),
    ("min_samples", Maybe(Uint(32, least=MIN_SAMPLES_LEAST, most=SAMPLES_MAX))),
    ("environment_rotation", Maybe(F64)),
    law=Traceable(),
)
RENDER_SETTINGS = Struct(
    RenderSettings,
    ("width", Maybe(Uint(16, least=1, most=SIDE_MAX))),
    ("height", Maybe(Uint(16, least=1, most=SIDE_MAX))),
    ("samples", Maybe(Uint(32, least=1, most=SAMPLES_MAX))),
    ("depth", Maybe(Uint(8, least=1, most=DEPTH_MAX))),
    ("sky", Maybe(Many(F64, counts=(3,)))),
    ("exposure", Maybe(F64)),
    ("camera", Maybe(Text(CAMERA_NAME_BYTES_MAX))),
    ("paths", Late(PATH_SETTINGS, PathSettings())),
    law=Sensible(),
)
STRUCTS = (PATH_SETTINGS,)
