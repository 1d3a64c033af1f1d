"""A material of `SceneArrays` as Mitsuba sees it: numbers, and Mitsuba's own bitmap textures in place of ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenefold.render.arrays import F32, I64, U8, Feature, MaterialColumn, SceneArrays, TextureColumn, TextureUseColumn
from scenefold.render.renderers.mitsuba.library import Mitsuba

_WRAPS = ("repeat", "clamp", "mirror")
_MASK, _BLEND = 1.0, 2.0


class Looks:
    """What a material is at a point. Numbers are opaque to the compiler, so that materials of one kind share their code."""

    def __init__(self, mitsuba: Mitsuba, arrays: SceneArrays, number: int) -> None:
        mi, dr = mitsuba.mi, mitsuba.dr
        self._mitsuba, self.number = mitsuba, number
        row = arrays.materials[number]
        self._color = mi.Color3f(*(float(value) for value in row[MaterialColumn.BASE : MaterialColumn.BASE + 3]))
        self._alpha = mi.Float(float(row[MaterialColumn.BASE + 3]))
        self._metallic = mi.Float(float(row[MaterialColumn.METALLIC]))
        self._roughness = mi.Float(float(row[MaterialColumn.ROUGHNESS]))
        self._cutoff = mi.Float(float(row[MaterialColumn.ALPHA_CUTOFF]))
        emission = MaterialColumn.EMISSION if row[MaterialColumn.EMISSIVE_USE] < 0 else MaterialColumn.EMISSIVE
        self._radiance = mi.Color3f(*(float(value) for value in row[emission : emission + 3]))
        self._transmission = mi.Float(float(row[MaterialColumn.TRANSMISSION]))
        self._specular = mi.Float(float(row[MaterialColumn.SPECULAR]))
        self._tint = mi.Color3f(*(float(value) for value in row[MaterialColumn.SPECULAR_COLOR : MaterialColumn.SPECULAR_COLOR + 3]))
        self._coat = mi.Float(float(row[MaterialColumn.CLEARCOAT]))
        self._coat_roughness = mi.Float(float(row[MaterialColumn.CLEARCOAT_ROUGHNESS]))
        self.coated = row[MaterialColumn.CLEARCOAT] > 0.0
        self.unlit = row[MaterialColumn.UNLIT] != 0.0
        self.ior = mi.Float(float(row[MaterialColumn.IOR]))
        features = int(row[MaterialColumn.FEATURES])
        self.solid, self.rough_wall = bool(features & Feature.SOLID), bool(features & Feature.ROUGH_TRANSMISSION)
        with np.errstate(divide="ignore"):
            colour = row[MaterialColumn.ATTENUATION_COLOR : MaterialColumn.ATTENUATION_COLOR + 3].astype(np.float64)
            extinction = np.minimum(-np.log(colour) / float(row[MaterialColumn.ATTENUATION_DISTANCE]), 1e30)
        self.extinction = mi.Color3f(*extinction.tolist())
        """Of the inside of a solid body, per unit of the world."""
        for value in (
            self._color,
            self._alpha,
            self._metallic,
            self._roughness,
            self._cutoff,
            self._radiance,
            self._transmission,
            self._specular,
            self._tint,
            self._coat,
            self._coat_roughness,
            self.ior,
            self.extinction,
        ):
            dr.make_opaque(value)
        self.shines = self.unlit or bool((row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3] > 0.0).any())
        self.double_sided = row[MaterialColumn.DOUBLE_SIDED] != 0.0
        self._mode = float(row[MaterialColumn.ALPHA_MODE])
        wholly_metal = row[MaterialColumn.METALLIC] >= 1.0 and row[MaterialColumn.METALLIC_ROUGHNESS_USE] < 0
        straight = row[MaterialColumn.TRANSMISSION] > 0.0 and not (wholly_metal or self.solid or self.rough_wall)
        self.may_pass = self._mode != 0.0 or bool(straight)
        base, rough = int(row[MaterialColumn.BASE_USE]), int(row[MaterialColumn.METALLIC_ROUGHNESS_USE])
        self._base = _Read.of(mitsuba, arrays, base, slice(0, 3))
        self._base_alpha = _Read.of(mitsuba, arrays, base, slice(3, 4)) if self._mode else None
        self._rough = _Read.of(mitsuba, arrays, rough, slice(0, 3))
        self._clear = _Read.of(mitsuba, arrays, int(row[MaterialColumn.TRANSMISSION_USE]), slice(0, 3))
        self._weight = _Read.of(mitsuba, arrays, int(row[MaterialColumn.SPECULAR_USE]), slice(3, 4))
        self._tints = _Read.of(mitsuba, arrays, int(row[MaterialColumn.SPECULAR_COLOR_USE]), slice(0, 3))
        self._glow = _Read.of(mitsuba, arrays, int(row[MaterialColumn.EMISSIVE_USE]) if self.shines else -1, slice(0, 3))
        self._coats = _Read.of(mitsuba, arrays, int(row[MaterialColumn.CLEARCOAT_USE]), slice(0, 3))
        self._coat_roughs = _Read.of(mitsuba, arrays, int(row[MaterialColumn.CLEARCOAT_ROUGHNESS_USE]), slice(0, 3))
        self._reads = [
            read
            for read in (
                self._base,
                self._base_alpha,
                self._rough,
                self._clear,
                self._weight,
                self._tints,
                self._coats,
                self._coat_roughs,
                self._glow,
            )
            if read is not None
        ]
        self.tilt = _Tilt.of(mitsuba, arrays, row, MaterialColumn.NORMAL_USE, MaterialColumn.NORMAL_SCALE)
        self.coat_tilt = _Tilt.of(mitsuba, arrays, row, MaterialColumn.CLEARCOAT_NORMAL_USE, MaterialColumn.CLEARCOAT_NORMAL_SCALE)
        self._reads += [tilt.read for tilt in (self.tilt, self.coat_tilt) if tilt is not None]
        self.coloured = arrays.has_colors
        """Whether its meshes have the attributes vertex_color and vertex_alpha."""
        self.only_met = self.unlit or bool(self._mode and self.coloured) or bool(self._glow and self._glow.second_set)
        """Whether its light is for rays that meet it: a sample of a light has no attributes of vertices."""

    @property
    def textured(self) -> bool:
        """Whether its meshes need texture coordinates."""
        return bool(self._reads)

    @property
    def reads_second_set(self) -> bool:
        """Whether its meshes need the attribute vertex_second: u, v, 0."""
        return any(read.second_set for read in self._reads)

    def base(self, si: Any, active: Any) -> Any:
        """Color3f, linear."""
        color = self._color if self._base is None else self._color * self._base.eval(si, active)
        return color * si.shape.eval_attribute_3("vertex_color", si, active) if self.coloured else color

    def roughness_metallic(self, si: Any, active: Any) -> tuple[Any, Any]:
        """Green and blue of their texture, times the factors."""
        if self._rough is None:
            return self._roughness, self._metallic
        texel = self._rough.eval(si, active)
        return self._roughness * texel.y, self._metallic * texel.z

    def transmission(self, si: Any, active: Any) -> Any:
        """Float, with red of its texture."""
        return self._transmission if self._clear is None else self._transmission * self._clear.eval(si, active).x

    def specular(self, si: Any, active: Any) -> tuple[Any, Any]:
        """Weight and tint of the dielectric's reflection."""
        weight = self._specular if self._weight is None else self._specular * self._weight.eval_1(si, active)
        return weight, self._tint if self._tints is None else self._tint * self._tints.eval(si, active)

    def emission(self, si: Any, active: Any) -> Any:
        """Radiance, Color3f."""
        return self._radiance if self._glow is None else self._radiance * self._glow.eval(si, active)

    def coat(self, si: Any, active: Any) -> tuple[Any, Any]:
        """Strength and roughness of the clear coat."""
        strength = self._coat if self._coats is None else self._coat * self._coats.eval(si, active).x
        return strength, self._coat_roughness if self._coat_roughs is None else self._coat_roughness * self._coat_roughs.eval(si, active).y

    def opacity(self, si: Any, active: Any) -> Any:
        """What alpha and its mode make of it, 0 to 1."""
        mi, dr = self._mitsuba.mi, self._mitsuba.dr
        if not self._mode:
            return mi.Float(1.0)
        alpha = self._alpha if self._base_alpha is None else self._alpha * self._base_alpha.eval_1(si, active)
        if self.coloured:
            alpha = alpha * si.shape.eval_attribute_1("vertex_alpha", si, active)
        if self._mode == _MASK:
            return dr.select(alpha >= self._cutoff, mi.Float(1.0), mi.Float(0.0))
        return dr.clip(alpha, 0.0, 1.0)


class _Read:
    """How a material reads some channels of a texture."""

    def __init__(self, mitsuba: Mitsuba, arrays: SceneArrays, use: int, channels: slice) -> None:
        row = arrays.texture_uses[use]
        self._mi, self.second_set = mitsuba.mi, bool(row[TextureUseColumn.UV_SET])
        m = row[TextureUseColumn.M00 : TextureUseColumn.M12 + 1].reshape(2, 3).tolist()
        how = {
            "wrap_mode": _WRAPS[int(row[TextureUseColumn.WRAP_S])],
            "filter_type": "nearest" if row[TextureUseColumn.NEAREST] else "bilinear",
            "to_uv": mitsuba.mi.ScalarTransform3f([*m, [0.0, 0.0, 1.0]]),
        }
        self._bitmap = _bitmap(mitsuba, arrays.textures[int(row[TextureUseColumn.TEXTURE])], arrays.texels, channels, how)

    @classmethod
    def of(cls, mitsuba: Mitsuba, arrays: SceneArrays, use: int, channels: slice) -> _Read | None:
        """None if there is no such use."""
        return cls(mitsuba, arrays, use, channels) if use >= 0 else None

    def _at(self, si: Any, active: Any) -> Any:
        if not self.second_set:
            return si
        moved = self._mi.SurfaceInteraction3f(si)
        place = si.shape.eval_attribute_3("vertex_second", si, active)
        moved.uv = self._mi.Point2f(place.x, place.y)
        return moved

    def eval(self, si: Any, active: Any) -> Any:
        """Three channels."""
        return self._bitmap.eval(self._at(si, active), active)

    def eval_1(self, si: Any, active: Any) -> Any:
        """One channel."""
        return self._bitmap.eval_1(self._at(si, active), active)


class _Tilt:
    """A normal map. Its tangents follow from set 0 of the coordinates: a flattened mesh has no others."""

    def __init__(self, mitsuba: Mitsuba, arrays: SceneArrays, use: int, scale: float) -> None:
        self._mitsuba, self._scale = mitsuba, scale
        self.read = _Read(mitsuba, arrays, use, slice(0, 3))
        m = arrays.texture_uses[use, TextureUseColumn.M00 : TextureUseColumn.M12 + 1].reshape(2, 3)[:, :2]
        self._along_u, self._turn = (m[1, 1], -m[1, 0]), float(np.linalg.det(m))

    @classmethod
    def of(cls, mitsuba: Mitsuba, arrays: SceneArrays, row: F32, use: int, scale: int) -> _Tilt | None:
        """None if the material has no such map."""
        return cls(mitsuba, arrays, int(row[use]), float(row[scale])) if row[use] >= 0 else None

    def normal(self, si: Any, n: Any) -> Any:
        """What the map makes of the unit normal n, which looks to where corners are seen counter-clockwise."""
        dr = self._mitsuba.dr
        sign = -1.0 if self._turn < 0.0 else 1.0
        tangent = (si.dp_du * float(self._along_u[0]) + si.dp_dv * float(self._along_u[1])) * sign
        tangent = dr.normalize(tangent - n * dr.dot(n, tangent))
        against = dr.select(dr.dot(dr.cross(si.dp_du, si.dp_dv), n) * sign > 0.0, -1.0, 1.0)
        texel = self.read.eval(si, True) * 2.0 - 1.0
        return dr.normalize(tangent * (texel.x * self._scale) + dr.cross(n, tangent) * (against * texel.y * self._scale) + n * texel.z)


def _bitmap(mitsuba: Mitsuba, row: I64, texels: U8, channels: slice, how: dict[str, Any]) -> Any:
    """A bitmap of some channels of a texture."""
    start, width, height = int(row[TextureColumn.OFFSET]), int(row[TextureColumn.WIDTH_PX]), int(row[TextureColumn.HEIGHT_PX])
    pixels: U8 = texels[start : start + width * height * 4].reshape(height, width, 4)[:, :, channels]
    is_coded = bool(row[TextureColumn.SRGB]) and channels.stop <= 3
    mi = mitsuba.mi
    form = mi.Bitmap.PixelFormat.RGB if channels.stop <= 3 else mi.Bitmap.PixelFormat.Y
    bitmap = mi.Bitmap(np.ascontiguousarray(pixels), form)
    bitmap.set_srgb_gamma(is_coded)
    return mi.load_dict({"type": "bitmap", "bitmap": bitmap, "raw": not is_coded, "format": "variant", **how})
