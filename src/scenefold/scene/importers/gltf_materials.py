"""Materials of a glTF: metallic-roughness and the extensions that our material knows; the rest is noted.

Texture coordinates are chosen (texCoord) and transformed (KHR_texture_transform) per mesh, so a material says
which set and which transform its textures want: `uv_sets`, `uv_transforms`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import MATERIALS_MAX
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.images import EncodedImage, TextureList, mean_linear, note_mean
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.materials import AlphaMode, Material, Wrap

CARRIED = frozenset(
    {
        "KHR_materials_emissive_strength", "KHR_materials_transmission", "KHR_materials_ior",
        "KHR_materials_pbrSpecularGlossiness",
    }
)  # fmt: skip
_WRAPS = {10497: Wrap.REPEAT, 33071: Wrap.CLAMP, 33648: Wrap.MIRROR}
_NEAREST = 9728
_ALPHA = {"OPAQUE": AlphaMode.OPAQUE, "MASK": AlphaMode.MASK, "BLEND": AlphaMode.BLEND}
_EMISSION_MAX = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class TextureUse:
    """How a material's textures read texture coordinates: the set, and uv' = uv @ linear + offset."""

    uv_set: int = 0
    linear: NDArray[np.float64] | None = None
    offset: NDArray[np.float64] | None = None

    def apply(self, uvs: NDArray[np.float32]) -> NDArray[np.float32]:
        if self.linear is None or self.offset is None:
            return uvs
        u, v = uvs[:, 0].astype(np.float64), uvs[:, 1].astype(np.float64)
        moved = [u * self.linear[0, axis] + v * self.linear[1, axis] + self.offset[axis] for axis in (0, 1)]
        return np.stack(moved, axis=1).astype(np.float32)

    def same_as(self, other: TextureUse) -> bool:
        mine, theirs = (np.zeros((2, 2)) if use.linear is None else use.linear for use in (self, other))
        here, there = (np.zeros(2) if use.offset is None else use.offset for use in (self, other))
        return self.uv_set == other.uv_set and bool((mine == theirs).all() and (here == there).all())


class GltfMaterials:
    """All materials of a file, and a default one at the end for primitives that name none."""

    def __init__(self, file: GltfFile, left: NotCarried) -> None:
        self._file = file
        self._left = left
        self._images = file.json.maps("images")
        self._samplers = file.json.maps("samplers")
        self._texture_entries = file.json.maps("textures")
        self.textures = TextureList()
        self.materials: list[Material] = []
        self.uses: list[TextureUse] = []
        entries = file.json.maps("materials")
        if len(entries) >= MATERIALS_MAX:
            raise file.json.fault(f"has {len(entries)} entries, more than {MATERIALS_MAX - 1}", "materials")
        for number, entry in enumerate(entries):
            self._read(number, entry)
        self.materials.append(Material(name="default", metallic=0.0, roughness=1.0, base_color=(0.8, 0.8, 0.8, 1.0)))
        self.uses.append(TextureUse())

    @property
    def default(self) -> int:
        return len(self.materials) - 1

    def _read(self, number: int, entry: JsonMap) -> None:
        pbr = entry.inner("pbrMetallicRoughness")
        base_entry, rough_entry = pbr.inner("baseColorTexture"), pbr.inner("metallicRoughnessTexture")
        base_texture, base_use = self._texture(base_entry, srgb=True)
        rough_texture, rough_use = self._texture(rough_entry, srgb=False)
        if base_texture >= 0 and rough_texture >= 0 and not base_use.same_as(rough_use):
            self._left.note("metallic-roughness textures with coordinates of their own")
            rough_texture = -1
        base = pbr.numbers("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        metallic, roughness = pbr.unit("metallicFactor", 1.0), pbr.unit("roughnessFactor", 1.0)
        glossy = entry.extension("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None and not entry.has("pbrMetallicRoughness"):
            self._left.note("specular-glossiness materials, approximated")
            base_texture, base_use = self._texture(glossy.inner("diffuseTexture"), srgb=True)
            base = glossy.numbers("diffuseFactor", (1.0, 1.0, 1.0, 1.0))
            metallic, roughness = 0.0, 1.0 - glossy.unit("glossinessFactor", 1.0)
        wraps = self._wraps(base_entry if base_texture >= 0 else rough_entry)
        mode = entry.text("alphaMode", "OPAQUE")
        if mode not in _ALPHA:
            raise entry.fault(f"is the unknown {mode!r}", "alphaMode")
        red, green, blue, alpha = (min(max(value, 0.0), 1.0) for value in base)
        self.materials.append(
            Material(
                name=entry.text("name", f"material {number}"),
                base_color=(red, green, blue, alpha),
                base_color_texture=base_texture,
                metallic=metallic,
                roughness=roughness,
                metallic_roughness_texture=rough_texture,
                emissive=self._emission(entry),
                transmission=self._transmission(entry),
                ior=self._ior(entry),
                double_sided=entry.flag("doubleSided"),
                alpha_mode=_ALPHA[mode],
                alpha_cutoff=max(entry.number("alphaCutoff", 0.5), 0.0),
                wrap_s=wraps[0],
                wrap_t=wraps[1],
                nearest=wraps[2],
            )
        )
        self.uses.append(base_use if base_texture >= 0 else rough_use)
        self._note_rest(entry)

    def _emission(self, entry: JsonMap) -> tuple[float, float, float]:
        factor = entry.numbers("emissiveFactor", (0.0, 0.0, 0.0))
        strength_entry = entry.extension("KHR_materials_emissive_strength")
        strength = strength_entry.number("emissiveStrength", 1.0) if strength_entry else 1.0
        if strength < 0 or min(factor) < 0 or strength * max(factor) > _EMISSION_MAX:
            raise entry.fault("has an emission that is negative or beyond measure")
        mean = (1.0, 1.0, 1.0)
        if entry.has("emissiveTexture") and strength * max(factor) > 0:
            image = self._image(entry.inner("emissiveTexture"))
            if image is not None:
                mean = mean_linear(image[1].pixels())
                note_mean(self._left)
        red, green, blue = (float(value * strength * part) for value, part in zip(factor, mean, strict=True))
        return red, green, blue

    def _transmission(self, entry: JsonMap) -> float:
        extension = entry.extension("KHR_materials_transmission")
        if extension is None:
            return 0.0
        self._left.note("transmission textures", int(extension.has("transmissionTexture")))
        return extension.unit("transmissionFactor", 0.0)

    def _ior(self, entry: JsonMap) -> float:
        extension = entry.extension("KHR_materials_ior")
        # 0 is the extension's way to say "reflects everything", which our material cannot.
        ior = extension.number("ior", 1.5) if extension else 1.5
        return min(max(ior, 1.0), 100.0) if ior else 1.5

    def _note_rest(self, entry: JsonMap) -> None:
        self._left.note("normal maps", int(entry.has("normalTexture")))
        self._left.note("occlusion maps", int(entry.has("occlusionTexture")))
        for name in entry.inner("extensions").keys():  # noqa: SIM118, a JsonMap is no dict
            if name not in CARRIED:
                self._left.note(f"material extension {name}")

    def _texture(self, info: JsonMap, *, srgb: bool) -> tuple[int, TextureUse]:
        """The number of the texture that `info` names (-1: none), and how it reads coordinates."""
        image = self._image(info)
        if image is None:
            return -1, TextureUse()
        uv_set = info.integer("texCoord", 0, 16, default=0)
        transform = info.extension("KHR_texture_transform")
        number = self.textures.add(image[0], image[1], srgb=srgb)
        if transform is None:
            return number, TextureUse(uv_set)
        uv_set = transform.integer("texCoord", 0, 16, default=uv_set)
        offset = np.array(transform.numbers("offset", (0.0, 0.0)))
        scale_u, scale_v = transform.numbers("scale", (1.0, 1.0))
        angle = transform.number("rotation", 0.0)
        cosine, sine = math.cos(angle), math.sin(angle)
        # Rows are where u and v go; glTF turns counter-clockwise with v downwards.
        linear = np.array([[cosine * scale_u, -sine * scale_u], [sine * scale_v, cosine * scale_v]])
        return number, TextureUse(uv_set, linear, offset)

    def _entry(self, info: JsonMap) -> JsonMap | None:
        number = info.index("index", len(self._texture_entries), "texture")
        return self._texture_entries[number] if number >= 0 else None

    def _image(self, info: JsonMap) -> tuple[int, EncodedImage] | None:
        entry = self._entry(info)
        if entry is None:
            return None
        webp = entry.extension("EXT_texture_webp")
        number = (webp or entry).index("source", len(self._images), "image")
        if number < 0:
            self._left.note("textures without a source that can be read")
            return None
        image = self._images[number]
        if image.has("uri"):
            uri = image.text("uri")
            name = image.text("name", "image" if uri.startswith("data:") else PurePosixPath(uri).name)
            content = bytes(self._file.resource(image, "the texture"))
        else:
            view = image.index("bufferView", self._file.views, "buffer view")
            if view < 0:
                raise image.fault("has neither a uri nor a buffer view")
            name = image.text("name", f"image {number}")
            content = bytes(self._file.view(view)[0])
        return number, EncodedImage(self._file.path, f"the texture {name!r}", name, content)

    def _wraps(self, info: JsonMap) -> tuple[Wrap, Wrap, bool]:
        entry = self._entry(info)
        number = entry.index("sampler", len(self._samplers), "sampler") if entry else -1
        if number < 0:
            return Wrap.REPEAT, Wrap.REPEAT, False
        sampler = self._samplers[number]
        modes = [sampler.integer(key, default=10497) for key in ("wrapS", "wrapT")]
        for key, mode in zip(("wrapS", "wrapT"), modes, strict=True):
            if mode not in _WRAPS:
                raise sampler.fault(f"is the unknown {mode}", key)
        return _WRAPS[modes[0]], _WRAPS[modes[1]], sampler.integer("magFilter", default=9729) == _NEAREST
