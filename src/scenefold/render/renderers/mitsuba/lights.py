"""Lights as Mitsuba emitters. Sky and suns are Mitsuba's own; surfaces and spots are here, for glTF defines them otherwise.

Mitsuba's area light shines to the side of the shading normal alone, its spot fades linearly in the angle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from scenefold.render.arrays import F32, F64, JobNumbers, LightColumn
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.renderers.mitsuba.looks import Looks

_POINT, _SPOT, _DIRECTIONAL = 0.0, 1.0, 2.0
_STEEPEST = 1e-3
_classes: dict[str, tuple[Any, Any]] = {}


def surface_light(mitsuba: Mitsuba, looks: Looks) -> Any:
    """The emitter of a mesh that wears this material."""
    return _classes_of(mitsuba)[0](looks)


def punctual_light(mitsuba: Mitsuba, row: F64) -> Any:
    """The emitter of a row of `SceneArrays.punctual_lights`, float64[LightColumn.WIDTH]."""
    mi = mitsuba.mi
    color = [float(value) for value in row[LightColumn.COLOR : LightColumn.COLOR + 3]]
    position = [float(value) for value in row[LightColumn.POSITION : LightColumn.POSITION + 3]]
    direction = [float(value) for value in row[LightColumn.DIRECTION : LightColumn.DIRECTION + 3]]
    if row[LightColumn.KIND] == _DIRECTIONAL:
        return mi.load_dict({"type": "directional", "direction": direction, "irradiance": {"type": "rgb", "value": color}})
    if row[LightColumn.KIND] == _SPOT:
        return _classes_of(mitsuba)[1](position, direction, color, float(row[LightColumn.COS_INNER]), float(row[LightColumn.COS_OUTER]))
    return mi.load_dict({"type": "point", "position": position, "intensity": {"type": "rgb", "value": color}})


def environment_light(mitsuba: Mitsuba, radiance: F32, numbers: JobNumbers) -> Any:
    """Mitsuba's own map. Its first and last rows lie at the poles and not half a texel beside: rows between ours make them the same."""
    mi = mitsuba.mi
    height = len(radiance)
    at = np.clip(np.arange(2 * height + 1) * 0.5 - 0.5, 0.0, height - 1.0)
    above = np.floor(at).astype(int)
    down = (at - above)[:, None, None]
    rows = radiance[above] * (1.0 - down) + radiance[np.minimum(above + 1, height - 1)] * down
    # Its middle is +Z, ours is -Z.
    turned = float(np.degrees(np.arctan2(numbers.environment_sine, numbers.environment_cosine))) + 180.0
    about = mi.ScalarTransform4f().rotate([0.0, 1.0, 0.0], turned)
    return mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(rows.astype(np.float32)), "to_world": about})


def _classes_of(mitsuba: Mitsuba) -> tuple[Any, Any]:
    if mitsuba.variant not in _classes:
        _classes[mitsuba.variant] = _surface_class(mitsuba), _spot_class(mitsuba)
    return _classes[mitsuba.variant]


def _surface_class(mitsuba: Mitsuba) -> Any:
    mi, dr = mitsuba.mi, mitsuba.dr

    class SurfaceLight(mi.Emitter):  # type: ignore[name-defined, misc]
        """A mesh's radiance, in front or on both sides of the geometric normal; alpha thins it."""

        def __init__(self, looks: Looks) -> None:
            mi.Emitter.__init__(self, mi.Properties("scenefold_surface_light"))
            self.m_flags = +mi.EmitterFlags.Surface
            self._looks = looks

        def _seen(self, cosine: Any) -> Any:
            """Whether the side is lit that is seen at this cosine to the geometric normal."""
            return dr.abs(cosine) > 0.0 if self._looks.double_sided or self._looks.unlit else cosine > 0.0

        def _radiance(self, si: Any, active: Any) -> Any:
            radiance = self._looks.base(si, active) if self._looks.unlit else self._looks.emission(si, active)
            return dr.select(active, radiance * self._looks.opacity(si, active), 0.0)

        def _at(self, ds: Any) -> Any:
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.uv = ds.uv
            return si

        def eval(self, si: Any, active: Any = True) -> Any:
            """See `mi.Emitter`."""
            return self._radiance(si, active & self._seen(dr.dot(si.to_world(si.wi), si.n)))

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
            """See `mi.Emitter`."""
            if self._looks.only_met:
                return dr.zeros(mi.DirectionSample3f), mi.Color3f(0.0)
            ds = self.get_shape().sample_direction(it, sample, active)
            active = active & (ds.pdf > 0.0) & self._seen(-dr.dot(ds.d, ds.n))
            ds.emitter = mi.EmitterPtr(self) if mitsuba.is_wavefront else self
            return ds, self._radiance(self._at(ds), active) / dr.maximum(ds.pdf, 1e-30)

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            """See `mi.Emitter`."""
            if self._looks.only_met:
                return mi.Float(0.0)
            return dr.select(active & self._seen(-dr.dot(ds.d, ds.n)), self.get_shape().pdf_direction(it, ds, active), 0.0)

        def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            """See `mi.Emitter`."""
            return self._radiance(self._at(ds), active & self._seen(-dr.dot(ds.d, ds.n)))

        def to_string(self) -> str:
            """See `mi.Emitter`."""
            return f"SurfaceLight[{self._looks.number}]"

    return SurfaceLight


def _spot_class(mitsuba: Mitsuba) -> Any:
    mi, dr = mitsuba.mi, mitsuba.dr

    class GltfSpot(mi.Emitter):  # type: ignore[name-defined, misc]
        """KHR_lights_punctual's spot: intensity (clamp((cos - cos_outer) / (cos_inner - cos_outer)))^2 / d^2."""

        def __init__(self, position: list[float], direction: list[float], color: list[float], inner: float, outer: float) -> None:
            mi.Emitter.__init__(self, mi.Properties("scenefold_spot"))
            self.m_flags = +mi.EmitterFlags.DeltaPosition
            self._position, self._direction, self._color = mi.Point3f(position), mi.Vector3f(direction), mi.Color3f(color)
            self._outer, self._scale = outer, 1.0 / max(inner - outer, _STEEPEST)

        def eval(self, si: Any, active: Any = True) -> Any:
            """See `mi.Emitter`."""
            return mi.Color3f(0.0)

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
            """See `mi.Emitter`."""
            ds = dr.zeros(mi.DirectionSample3f)
            way = self._position - it.p
            ds.p, ds.dist = self._position, dr.norm(way)
            ds.d = way / ds.dist
            ds.n, ds.delta, ds.pdf = self._direction, mi.Bool(True), mi.Float(1.0)
            ds.emitter = mi.EmitterPtr(self) if mitsuba.is_wavefront else self
            return ds, self.eval_direction(it, ds, active)

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            """See `mi.Emitter`."""
            return mi.Float(0.0)

        def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            """See `mi.Emitter`."""
            fade = dr.clip((-dr.dot(ds.d, self._direction) - self._outer) * self._scale, 0.0, 1.0)
            return dr.select(active, self._color * dr.square(fade) / dr.square(ds.dist), 0.0)

        def bbox(self) -> Any:
            """See `mi.Emitter`."""
            return mi.ScalarBoundingBox3f(mi.ScalarPoint3f(self._corner()))

        def _corner(self) -> list[float]:
            return [float(value) for value in dr.ravel(self._position)]

        def to_string(self) -> str:
            """See `mi.Emitter`."""
            return "GltfSpot[]"

    return GltfSpot
