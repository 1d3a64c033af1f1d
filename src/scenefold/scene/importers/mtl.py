"""Material libraries of OBJ files, taken over as metallic-roughness as well as Phong's words allow.

Kd is the base colour, Ke the emission; the exponent Ns becomes a roughness whose highlight is as wide
(alpha = sqrt(2 / (Ns + 2)), roughness = sqrt(alpha)); Pr, Pm, Pc and Pcr, where given, are roughness, metallic, clearcoat and
its roughness. A dissolve below 1 is glass for the illumination models that refract (4, 6, 7, 9), else plain transparency.

Ambient light (Ka) is what paths find out themselves; it is noted where it is not black, as is everything else that is not taken over: the colour
of highlights (Ks), models that mirror without passing light, and statements that are not known here.

Textures: map_Kd, map_Ke, map_Pr and map_Pm, map_d (into the base colour's alpha), norm, and bump where it holds normals.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from scenefold.base.limits import MATERIALS_MAX
from scenefold.scene.importers.composed_images import ALPHA, BLUE, GREEN, ComposedImage
from scenefold.scene.importers.faults import bad_file, readable_size
from scenefold.scene.importers.images import TextureList
from scenefold.scene.importers.mtl_maps import Maps, MapStatement
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.materials import AlphaMode, Material

CLAMPED = "OBJ material numbers outside their range, moved to its end"
_BYTES_MAX = 64 * 1024 * 1024
_REFRACTING = {4, 6, 7, 9}
_EMISSION_MAX = 1e12
_STRENGTH_MAX = 1e6
_IOR_MAX = 100.0
_EXPONENT_MAX = 1e6
_TAKEN = frozenset({
    "kd", "ke", "ns", "ni", "d", "tr", "pr", "pm", "pc", "pcr", "ka", "illum",
    "map_kd", "map_ke", "map_pr", "map_pm", "map_d", "norm", "bump", "map_bump",
})  # fmt: skip
"""Read, or noted where their values say so."""
_MAPS = ("map_", "disp", "decal", "refl")
"""How statements of maps begin."""
_SHINING = {1, 2}
"""Illumination models of diffuse light and highlights."""
_KEY_LETTERS_MAX = 40


def read_mtl(path: Path, textures: TextureList, left: NotCarried, used: set[str]) -> dict[str, Material]:
    """The materials of a library by name; of one with more than a scene may have, those that are used. A texture that it names and that is missing is a LocalFault."""
    if readable_size(path) > _BYTES_MAX:
        raise bad_file(path, f"the material library has more than {_BYTES_MAX} bytes")
    sections: dict[str, dict[str, list[str]]] = {}
    current: dict[str, list[str]] = {}
    for line in path.read_bytes().decode("utf-8", "replace").splitlines():
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "newmtl":
            current = sections.setdefault(" ".join(words[1:]), {})
        else:
            current[words[0].lower()] = words[1:]
    if len(sections) >= MATERIALS_MAX:
        sections = {name: fields for name, fields in sections.items() if name in used}
    maps = Maps(path)
    return {name: _Section(path, name, fields, maps, textures, left).material() for name, fields in sections.items()}


class _Section:
    """The lines under one newmtl."""

    def __init__(self, path: Path, name: str, fields: dict[str, list[str]], maps: Maps, textures: TextureList, left: NotCarried) -> None:
        self._path = path
        self._maps = maps
        self._name = name
        self._fields = fields
        self._textures = textures
        self._left = left

    def material(self) -> Material:
        for key in self._fields.keys() - _TAKEN:
            kind = "maps" if key.startswith(_MAPS) else "statements"
            self._left.note(f"OBJ material {kind} {key[:_KEY_LETTERS_MAX]}")
        self._left.note("OBJ material statements ka", int(any(word.strip("0.") for word in self._fields.get("ka", ()))))
        alpha = math.sqrt(2.0 / (self._within("ns", 0.0, 0.0, _EXPONENT_MAX) + 2.0))
        surface = Material(
            name=self._name,
            metallic=self._unit("pm", 0.0),
            roughness=self._unit("pr", math.sqrt(alpha)),
            clearcoat=self._unit("pc", 0.0),
            clearcoat_roughness=self._unit("pcr", 0.0),
            ior=self._within("ni", 1.5, 1.0, _IOR_MAX),
            double_sided=True,
        )
        return self._bent(self._shining(self._rough(self._coloured(surface))))

    # --- one part of a surface after the other

    def _coloured(self, surface: Material) -> Material:
        """Base colour and what passes."""
        colour = self._colour("kd", (0.8, 0.8, 0.8))
        opacity = 1.0 - self._unit("tr", 0.0) if "d" not in self._fields else self._unit("d", 1.0)
        model = int(min(max(self._number("illum", 2), 0), 99))
        refracts = opacity < 1 and model in _REFRACTING
        self._left.note(f"OBJ illumination models {model}, shown as 2", int(not refracts and model not in _SHINING))
        base, hole = self._map("map_kd"), self._map("map_d")
        red, green, blue = (1.0, 1.0, 1.0) if base else self._bounded(colour, 1.0)
        surface = replace(
            surface,
            # A texture replaces the colour: files leave Kd at black or grey beside it.
            base_color=(red, green, blue, 1.0 if refracts else opacity),
            transmission=1.0 - opacity if refracts else 0.0,
            alpha_mode=AlphaMode.BLEND if (opacity < 1 and not refracts) or hole else AlphaMode.OPAQUE,
        )
        shown = base or hole
        if shown is None:
            return surface
        if hole is None:
            number = self._textures.add(shown.key, shown.image, srgb=True)
        else:
            image = ComposedImage(base.image if base else None, ((ALPHA, hole.image),))
            number = self._textures.add((base.key if base else "", "alpha", hole.key), image, srgb=True)
        return replace(surface, base_color_texture=shown.use(number))

    def _rough(self, surface: Material) -> Material:
        """Roughness in green and metallic in blue of one image."""
        rough, metal = self._map("map_pr"), self._map("map_pm")
        shown = rough or metal
        if shown is None:
            return surface
        named = [(channel, found) for channel, found in ((GREEN, rough), (BLUE, metal)) if found is not None]
        image = ComposedImage(None, tuple((channel, found.image) for channel, found in named))
        number = self._textures.add(tuple((channel, found.key) for channel, found in named), image, srgb=False)
        return replace(
            surface,
            metallic_roughness_texture=shown.use(number),
            roughness=self._unit("pr", 1.0) if rough else surface.roughness,
            metallic=self._unit("pm", 1.0) if metal else surface.metallic,
        )

    def _shining(self, surface: Material) -> Material:
        red, green, blue = self._bounded(self._colour("ke", (0.0, 0.0, 0.0)), _EMISSION_MAX)
        shown = self._map("map_ke")
        if shown is None:
            return replace(surface, emissive=(red, green, blue))
        number = self._textures.add(shown.key, shown.image, srgb=True)
        return replace(
            surface,
            # Files leave Ke out, or black, beside a texture.
            emissive=(red, green, blue) if max(red, green, blue) > 0 else (1.0, 1.0, 1.0),
            emissive_texture=shown.use(number),
            emissive_mean=self._textures.mean(number),
        )

    def _bent(self, surface: Material) -> Material:
        """Normals: as such, or where exporters write them too; heights stay behind."""
        shown = self._map("norm")
        for key in ("map_bump", "bump"):
            other = self._map(key)
            if shown is None and other is not None and self._maps.holds_normals(other):
                shown = other
            elif other is not None:
                self._left.note(f"OBJ material maps {key}")
        if shown is None:
            return surface
        number = self._textures.add(shown.key, shown.image, srgb=False)
        strength = min(max(shown.strength, -_STRENGTH_MAX), _STRENGTH_MAX)
        return replace(surface, normal_texture=shown.use(number), normal_scale=strength)

    # --- words

    def _map(self, key: str) -> MapStatement | None:
        """The map of a key; None without one, or where its image cannot be read, which is counted."""
        words = self._fields.get(key)
        shown = self._maps.read(words) if words else None
        return shown if shown is not None and self._textures.is_readable(shown.key, shown.image) else None

    def _unit(self, key: str, default: float) -> float:
        return self._within(key, default, 0.0, 1.0)

    def _within(self, key: str, default: float, low: float, high: float) -> float:
        value = self._number(key, default)
        self._left.note(CLAMPED, int(not low <= value <= high))
        return min(max(value, low), high)

    def _bounded(self, colour: tuple[float, float, float], high: float) -> tuple[float, float, float]:
        self._left.note(CLAMPED, int(min(colour) < 0.0 or max(colour) > high))
        red, green, blue = (min(max(value, 0.0), high) for value in colour)
        return red, green, blue

    def _number(self, key: str, default: float) -> float:
        words = self._fields.get(key)
        return self._parsed(key, words[-1]) if words else default

    def _colour(self, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        words = self._fields.get(key, [])
        if not words or words[0] in ("spectral", "xyz"):
            self._left.note("OBJ colours that are not in RGB", len(words[:1]))
            return default
        values = [self._parsed(key, word) for word in words[:3]]
        return (values[0], values[1], values[2]) if len(values) == 3 else (values[0],) * 3

    def _parsed(self, key: str, word: str) -> float:
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise bad_file(self._path, f"material {self._name!r} has {key} {word!r}, which is no number")
        return value
