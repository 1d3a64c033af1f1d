"""Materials of a glTF: metallic-roughness and the extensions that our material knows; the rest is noted.

Which sets of coordinates the vertices need for a material, and with which transform, is in `coordinates`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from scenefold.base.limits import MATERIALS_MAX
from scenefold.scene.importers.coordinates import CoordinateSet, settle
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_textures import GltfTextures
from scenefold.scene.importers.merging import MERGED, look_of
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.materials import VALUE_MAX, AlphaMode, Material

CARRIED = frozenset(
    {
        "KHR_materials_emissive_strength", "KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume",
        "KHR_materials_clearcoat", "KHR_materials_specular", "KHR_materials_unlit", "KHR_materials_pbrSpecularGlossiness",
    }
)  # fmt: skip
CLAMPED = "material factors outside their range, moved to its end"
_ALPHA = {"OPAQUE": AlphaMode.OPAQUE, "MASK": AlphaMode.MASK, "BLEND": AlphaMode.BLEND}
_EMISSION_MAX = 1e12
_IOR_MAX = 100.0
_SCALE_MAX = 1e6
_DIELECTRIC_F0 = 0.04
"""What a surface of index 1.5 reflects at normal incidence."""
_WHITE = (1.0, 1.0, 1.0)
Slots = Iterator[tuple[str, JsonMap, bool]]


class GltfMaterials:
    """All materials of a file, and a default one at the end for primitives that name none.

    A file with more of them than a scene may have is read as its primitives ask for them, and what looks alike is merged.
    """

    def __init__(self, file: GltfFile, left: NotCarried) -> None:
        self._left = left
        self.textures = GltfTextures(file, left)
        self.materials: list[Material] = []
        self.coordinates: list[tuple[CoordinateSet, ...]] = []
        self._json = file.json
        self._entries = file.json.maps("materials")
        self._numbers: dict[int, int] = {}
        self._looks: dict[tuple[Material, tuple[CoordinateSet, ...]], int] = {}
        if len(self._entries) < MATERIALS_MAX:
            self._numbers = {entry: self._added(*self._read(entry)) for entry in range(len(self._entries))}
        self._default = self._added(Material(name="default", metallic=0.0, roughness=1.0, base_color=(0.8, 0.8, 0.8, 1.0)), ())

    def worn_by(self, primitive: JsonMap) -> int:
        """The number of a primitive's material; LocalFault if there are too many that look different."""
        entry = primitive.index("material", len(self._entries), "material")
        if entry < 0:
            return self._default
        if entry not in self._numbers:
            self._numbers[entry] = self._merged(*self._read(entry))
        return self._numbers[entry]

    def _merged(self, material: Material, sets: tuple[CoordinateSet, ...]) -> int:
        look = look_of(material), sets
        if look in self._looks:
            self._left.note(MERGED)
            return self._looks[look]
        if len(self.materials) >= MATERIALS_MAX:
            what = f"has {len(self._entries)} entries, and more than {MATERIALS_MAX - 1} of those that are worn look different"
            raise self._json.fault(what, "materials")
        self._looks[look] = self._added(material, sets)
        return self._looks[look]

    def _added(self, material: Material, sets: tuple[CoordinateSet, ...]) -> int:
        self.materials.append(material)
        self.coordinates.append(sets)
        return len(self.materials) - 1

    def _read(self, number: int) -> tuple[Material, tuple[CoordinateSet, ...]]:
        entry = self._entries[number]
        found = self._core(entry) | self._light_through(entry) | self._coat(entry) | self._reflection(entry)
        slots = [*self._core_slots(entry), *self._extension_slots(entry)]
        glossy = entry.extension("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None and entry.inner("pbrMetallicRoughness").keys():
            # Its author's own words in terms that we have are nearer to the original than an approximation.
            self._left.note("specular-glossiness beside metallic-roughness, which was taken")
        elif glossy is not None:
            found |= self._glossy(glossy)
            slots = [*(slot for slot in slots if slot[0] != "specular_color"), *self._glossy_slots(glossy)]
        readings = {}
        for slot, info, srgb in slots:
            reading = self.textures.reading(info, srgb=srgb)
            if reading is not None:
                readings[slot] = reading
        if "emissive" in readings:
            found["emissive_mean"] = self.textures.mean(readings["emissive"].texture)
        sets, uses = settle(readings)
        self._left.note("textures that read a third set of coordinates", len(readings) - len(uses))
        found |= {f"{slot}_texture": use for slot, use in uses.items()}
        for name in entry.inner("extensions").keys():  # noqa: SIM118, a JsonMap is no dict
            if name not in CARRIED:
                self._left.note(f"material extension {name}")
        return Material(name=entry.text("name", f"material {number}"), **found), sets

    def let_vertices_hide(self, number: int) -> None:
        """Says that some vertex that wears a material has a colour whose alpha counts."""
        self.materials[number] = replace(self.materials[number], vertex_alpha=True)

    # --- factors

    def _core(self, entry: JsonMap) -> dict[str, Any]:
        pbr = entry.inner("pbrMetallicRoughness")
        mode = entry.text("alphaMode", "OPAQUE")
        if mode not in _ALPHA:
            raise entry.fault(f"is the unknown {mode!r}", "alphaMode")
        return {
            "base_color": self._colour(pbr, "baseColorFactor", (1.0, 1.0, 1.0, 1.0)),
            "metallic": self._unit(pbr, "metallicFactor", 1.0),
            "roughness": self._unit(pbr, "roughnessFactor", 1.0),
            "normal_scale": self._within(entry.inner("normalTexture"), "scale", 1.0, -_SCALE_MAX, _SCALE_MAX),
            "occlusion_strength": self._unit(entry.inner("occlusionTexture"), "strength", 1.0),
            "emissive": self._emission(entry),
            "unlit": entry.extension("KHR_materials_unlit") is not None,
            "double_sided": entry.flag("doubleSided"),
            "alpha_mode": _ALPHA[mode],
            "alpha_cutoff": self._within(entry, "alphaCutoff", 0.5, 0.0, VALUE_MAX),
        }

    def _emission(self, entry: JsonMap) -> tuple[float, ...]:
        factor = self._colour(entry, "emissiveFactor", (0.0, 0.0, 0.0), VALUE_MAX)
        extension = entry.extension("KHR_materials_emissive_strength")
        strength = self._within(extension, "emissiveStrength", 1.0, 0.0, VALUE_MAX) if extension else 1.0
        emission = tuple(value * strength for value in factor)
        self._left.note(CLAMPED, int(max(emission) > _EMISSION_MAX))
        return tuple(min(value, _EMISSION_MAX) for value in emission)

    def _light_through(self, entry: JsonMap) -> dict[str, Any]:
        """Transmission, index of refraction and volume."""
        found: dict[str, Any] = {}
        transmission = entry.extension("KHR_materials_transmission")
        if transmission is not None:
            found["transmission"] = self._unit(transmission, "transmissionFactor", 0.0)
        index = entry.extension("KHR_materials_ior")
        if index is not None and index.number("ior", 1.5) == 0.0:
            # The extension's way to say that everything is reflected.
            self._left.note("indices of refraction of 0, taken for 1.5")
        elif index is not None:
            found["ior"] = self._within(index, "ior", 1.5, 1.0, _IOR_MAX)
        volume = entry.extension("KHR_materials_volume")
        if volume is not None:
            self._left.note("thickness textures", int(volume.has("thicknessTexture")))
            found["thickness"] = self._within(volume, "thicknessFactor", 0.0, 0.0, VALUE_MAX)
            found["attenuation_color"] = self._colour(volume, "attenuationColor", _WHITE)
            if volume.has("attenuationDistance"):
                distance = volume.number("attenuationDistance")
                self._left.note("attenuation distances that are none", int(distance <= 0))
                found["attenuation_distance"] = min(max(distance, 1e-12), VALUE_MAX) if distance > 0 else math.inf
        return found

    def _coat(self, entry: JsonMap) -> dict[str, Any]:
        coat = entry.extension("KHR_materials_clearcoat")
        if coat is None:
            return {}
        return {
            "clearcoat": self._unit(coat, "clearcoatFactor", 0.0),
            "clearcoat_roughness": self._unit(coat, "clearcoatRoughnessFactor", 0.0),
            "clearcoat_normal_scale": self._within(coat.inner("clearcoatNormalTexture"), "scale", 1.0, -_SCALE_MAX, _SCALE_MAX),
        }

    def _reflection(self, entry: JsonMap) -> dict[str, Any]:
        extension = entry.extension("KHR_materials_specular")
        if extension is None:
            return {}
        return {
            "specular": self._unit(extension, "specularFactor", 1.0),
            "specular_color": self._colour(extension, "specularColorFactor", _WHITE, VALUE_MAX),
        }

    def _glossy(self, glossy: JsonMap) -> dict[str, Any]:
        """A reflection of its own colour becomes what tints that of a dielectric."""
        self._left.note("specular-glossiness materials, approximated")
        self._left.note("glossiness textures", int(glossy.has("specularGlossinessTexture")))
        specular = self._colour(glossy, "specularFactor", _WHITE)
        return {
            "base_color": self._colour(glossy, "diffuseFactor", (1.0, 1.0, 1.0, 1.0)),
            "metallic": 0.0,
            "roughness": 1.0 - self._unit(glossy, "glossinessFactor", 1.0),
            "specular_color": tuple(value / _DIELECTRIC_F0 for value in specular),
        }

    # --- textures

    def _core_slots(self, entry: JsonMap) -> Slots:
        pbr = entry.inner("pbrMetallicRoughness")
        yield "base_color", pbr.inner("baseColorTexture"), True
        yield "metallic_roughness", pbr.inner("metallicRoughnessTexture"), False
        yield "normal", entry.inner("normalTexture"), False
        yield "occlusion", entry.inner("occlusionTexture"), False
        # Of what a factor of 0 leaves nothing of, no image need be kept.
        if max(entry.numbers("emissiveFactor", (0.0, 0.0, 0.0))) > 0:
            yield "emissive", entry.inner("emissiveTexture"), True

    def _extension_slots(self, entry: JsonMap) -> Slots:
        """In these, 0 is the factor's default."""
        transmission = entry.extension("KHR_materials_transmission")
        if transmission is not None and transmission.number("transmissionFactor", 0.0) > 0:
            yield "transmission", transmission.inner("transmissionTexture"), False
        coat = entry.extension("KHR_materials_clearcoat")
        if coat is not None and coat.number("clearcoatFactor", 0.0) > 0:
            yield "clearcoat", coat.inner("clearcoatTexture"), False
            yield "clearcoat_roughness", coat.inner("clearcoatRoughnessTexture"), False
            yield "clearcoat_normal", coat.inner("clearcoatNormalTexture"), False
        specular = entry.extension("KHR_materials_specular")
        if specular is not None:
            # Its alpha, which no coding of colours changes: one image often serves both.
            yield "specular", specular.inner("specularTexture"), True
            yield "specular_color", specular.inner("specularColorTexture"), True

    def _glossy_slots(self, glossy: JsonMap) -> Slots:
        yield "base_color", glossy.inner("diffuseTexture"), True
        yield "specular_color", glossy.inner("specularGlossinessTexture"), True

    # --- numbers that files get wrong

    def _unit(self, entry: JsonMap, key: str, default: float) -> float:
        return self._within(entry, key, default, 0.0, 1.0)

    def _within(self, entry: JsonMap, key: str, default: float, low: float, high: float) -> float:
        value = entry.number(key, default)
        self._left.note(CLAMPED, int(not low <= value <= high))
        return min(max(value, low), high)

    def _colour(self, entry: JsonMap, key: str, default: tuple[float, ...], high: float = 1.0) -> tuple[float, ...]:
        values = entry.numbers(key, default)
        self._left.note(CLAMPED, int(min(values) < 0.0 or max(values) > high))
        return tuple(min(max(value, 0.0), high) for value in values)
