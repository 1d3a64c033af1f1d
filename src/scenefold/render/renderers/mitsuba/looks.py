"""A material of `SceneArrays` as Mitsuba sees it: numbers, and Mitsuba's own bitmap textures in place of ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenefold.render.arrays import U8, MaterialColumn, SceneArrays, TextureColumn
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
        self.radiance = mi.Color3f(*(float(value) for value in row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3]))
        self.transmission = mi.Float(float(row[MaterialColumn.TRANSMISSION]))
        self.ior = mi.Float(float(row[MaterialColumn.IOR]))
        for value in (self._color, self._alpha, self._metallic, self._roughness, self._cutoff, self.radiance, self.transmission, self.ior):
            dr.make_opaque(value)
        self.shines = bool((row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3] > 0.0).any())
        self.double_sided = row[MaterialColumn.DOUBLE_SIDED] != 0.0
        self._mode = float(row[MaterialColumn.ALPHA_MODE])
        wholly_metal = row[MaterialColumn.METALLIC] >= 1.0 and row[MaterialColumn.METALLIC_ROUGHNESS_TEXTURE] < 0
        self.may_pass = self._mode != 0.0 or bool(row[MaterialColumn.TRANSMISSION] > 0.0 and not wholly_metal)
        wrap = _WRAPS[int(row[MaterialColumn.WRAP_S])]
        how = {"wrap_mode": wrap, "filter_type": "nearest" if row[MaterialColumn.NEAREST] else "bilinear"}
        base, rough = int(row[MaterialColumn.BASE_TEXTURE]), int(row[MaterialColumn.METALLIC_ROUGHNESS_TEXTURE])
        self._base = _texture(mitsuba, arrays, base, slice(0, 3), how)
        self._base_alpha = _texture(mitsuba, arrays, base, slice(3, 4), how) if self._mode else None
        self._rough = _texture(mitsuba, arrays, rough, slice(0, 3), how)

    @property
    def textured(self) -> bool:
        """Whether its meshes need texture coordinates."""
        return self._base is not None or self._rough is not None

    def base(self, si: Any, active: Any) -> Any:
        """Color3f, linear."""
        return self._color if self._base is None else self._color * self._base.eval(si, active)

    def roughness_metallic(self, si: Any, active: Any) -> tuple[Any, Any]:
        """Green and blue of their texture, times the factors."""
        if self._rough is None:
            return self._roughness, self._metallic
        texel = self._rough.eval(si, active)
        return self._roughness * texel.y, self._metallic * texel.z

    def opacity(self, si: Any, active: Any) -> Any:
        """What alpha and its mode make of it, 0 to 1."""
        mi, dr = self._mitsuba.mi, self._mitsuba.dr
        if not self._mode:
            return mi.Float(1.0)
        alpha = self._alpha if self._base_alpha is None else self._alpha * self._base_alpha.eval_1(si, active)
        if self._mode == _MASK:
            return dr.select(alpha >= self._cutoff, mi.Float(1.0), mi.Float(0.0))
        return dr.clip(alpha, 0.0, 1.0)


def _texture(mitsuba: Mitsuba, arrays: SceneArrays, number: int, channels: slice, how: dict[str, str]) -> Any:
    """A bitmap of some channels of a texture; None if there is none."""
    if number < 0:
        return None
    row = arrays.textures[number]
    start, width, height = int(row[TextureColumn.OFFSET]), int(row[TextureColumn.WIDTH_PX]), int(row[TextureColumn.HEIGHT_PX])
    pixels: U8 = arrays.texels[start : start + width * height * 4].reshape(height, width, 4)[:, :, channels]
    is_coded = bool(row[TextureColumn.SRGB]) and channels.stop <= 3
    mi = mitsuba.mi
    form = mi.Bitmap.PixelFormat.RGB if channels.stop <= 3 else mi.Bitmap.PixelFormat.Y
    bitmap = mi.Bitmap(np.ascontiguousarray(pixels), form)
    bitmap.set_srgb_gamma(is_coded)
    return mi.load_dict({"type": "bitmap", "bitmap": bitmap, "raw": not is_coded, "format": "variant", **how})
