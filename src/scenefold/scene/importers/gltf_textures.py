"""Textures of a glTF: image, sampler, coordinate set and KHR_texture_transform of what a material names."""

from __future__ import annotations

import math
from pathlib import PurePosixPath

from scenefold.scene.importers.coordinates import Reading
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.images import EncodedImage, TextureList
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.texture_uses import IDENTITY, TRANSFORM_MAX, Minify, Transform, Wrap

_WRAPS = {10497: Wrap.REPEAT, 33071: Wrap.CLAMP, 33648: Wrap.MIRROR}
_NEAREST, _LINEAR, _TRILINEAR = 9728, 9729, 9987
_MINIFY = {
    _NEAREST: Minify.FINEST,
    _LINEAR: Minify.FINEST,
    9984: Minify.NEAREST_OF_NEAREST,
    9985: Minify.LINEAR_OF_NEAREST,
    9986: Minify.NEAREST_BETWEEN,
    _TRILINEAR: Minify.LINEAR_BETWEEN,
}
_SETS_MAX = 16
_NAME_LETTERS_MAX = 40


class GltfTextures:
    """The textures of one file; each image is checked when a material first names it."""

    def __init__(self, file: GltfFile, left: NotCarried) -> None:
        self._file = file
        self._left = left
        self._images = file.json.maps("images")
        self._samplers = file.json.maps("samplers")
        self._entries = file.json.maps("textures")
        self._encoded: dict[int, EncodedImage] = {}
        self.list = TextureList(left)

    def reading(self, info: JsonMap, *, srgb: bool) -> Reading | None:
        """The texture that `info` names and how it is read; None if it names none that can be read."""
        found = self._image(info)
        if found is None or not self.list.is_readable(*found):
            return None
        uv_set = info.integer("texCoord", 0, _SETS_MAX, default=0)
        transform = IDENTITY
        extension = info.extension("KHR_texture_transform")
        if extension is not None:
            uv_set = extension.integer("texCoord", 0, _SETS_MAX, default=uv_set)
            transform = _transform(extension)
        wrap_s, wrap_t, nearest, minify = self._sampler(info)
        return Reading(self.list.add(found[0], found[1], srgb=srgb), uv_set, wrap_s, wrap_t, nearest, transform, minify)

    def mean(self, texture: int) -> tuple[float, float, float]:
        """The mean colour of a texture of the list, in linear light."""
        return self.list.mean(texture)

    def _entry(self, info: JsonMap) -> JsonMap | None:
        number = info.index("index", len(self._entries), "texture")
        return self._entries[number] if number >= 0 else None

    def _image(self, info: JsonMap) -> tuple[int, EncodedImage] | None:
        entry = self._entry(info)
        if entry is None:
            return None
        webp = entry.extension("EXT_texture_webp")
        number = (webp or entry).index("source", len(self._images), "image")
        if number < 0:
            self._left.note("textures without a source that can be read")
            return None
        if number not in self._encoded:
            self._encoded[number] = self._read(number)
        return number, self._encoded[number]

    def _read(self, number: int) -> EncodedImage:
        image = self._images[number]
        content: bytes | memoryview
        if image.has("uri"):
            uri = image.text("uri")
            name = image.text("name", "") or (f"image {number}" if uri.startswith("data:") else PurePosixPath(uri).name)
            content = self._file.content(image, "the texture")
        else:
            view = image.index("bufferView", self._file.views, "buffer view")
            if view < 0:
                raise image.fault("has neither a uri nor a buffer view")
            name = image.text("name", "") or f"image {number}"
            content = self._file.view(view)[0]
        return EncodedImage(self._file.path, f"the texture {name[:_NAME_LETTERS_MAX]!r}", name, content)

    def _sampler(self, info: JsonMap) -> tuple[Wrap, Wrap, bool, Minify]:
        entry = self._entry(info)
        number = entry.index("sampler", len(self._samplers), "sampler") if entry else -1
        if number < 0:
            return Wrap.REPEAT, Wrap.REPEAT, False, Minify.LINEAR_BETWEEN
        sampler = self._samplers[number]
        modes = [sampler.integer(key, default=10497) for key in ("wrapS", "wrapT")]
        for key, mode in zip(("wrapS", "wrapT"), modes, strict=True):
            if mode not in _WRAPS:
                raise sampler.fault(f"is the unknown {mode}", key)
        minify = sampler.integer("minFilter", default=_TRILINEAR)
        if minify not in _MINIFY:
            raise sampler.fault(f"is the unknown {minify}", "minFilter")
        return _WRAPS[modes[0]], _WRAPS[modes[1]], sampler.integer("magFilter", default=_LINEAR) == _NEAREST, _MINIFY[minify]


def _transform(extension: JsonMap) -> Transform:
    """Scaled, then turned, then moved; glTF turns counter-clockwise with v downwards."""
    move_u, move_v = extension.numbers("offset", (0.0, 0.0))
    scale_u, scale_v = extension.numbers("scale", (1.0, 1.0))
    angle = extension.number("rotation", 0.0)
    cosine, sine = math.cos(angle), math.sin(angle)
    rows = (cosine * scale_u, sine * scale_v, move_u, -sine * scale_u, cosine * scale_v, move_v)
    if max(map(abs, rows)) > TRANSFORM_MAX:
        raise extension.fault("moves texture coordinates beyond measure")
    return rows
