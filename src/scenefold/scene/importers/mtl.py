"""Material libraries of OBJ files, taken over as metallic-roughness as well as Phong's words allow.

Kd is the base colour, Ke the emission; the exponent Ns becomes a roughness whose highlight is as wide
(alpha = sqrt(2 / (Ns + 2)), roughness = sqrt(alpha)); Pr and Pm, where given, are roughness and metallic. A
dissolve below 1 is glass for the illumination models that refract (4, 6, 7, 9), else plain transparency.
"""

from __future__ import annotations

import math
from pathlib import Path

from scenefold.base.limits import MATERIALS_MAX
from scenefold.scene.importers.faults import bad_file, beside, readable_size
from scenefold.scene.importers.images import EncodedImage, TextureList
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.materials import AlphaMode, Material, TextureUse

_BYTES_MAX = 64 * 1024 * 1024
_REFRACTING = {4, 6, 7, 9}
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-clamp": 1, "-bm": 1, "-mm": 2, "-boost": 1, "-texres": 1, "-imfchan": 1, "-type": 1}
_TURNS = ("-o", "-s", "-t")


def read_mtl(path: Path, textures: TextureList, left: NotCarried) -> dict[str, Material]:
    """The materials of a library by name. A texture that it names and that is missing is a LocalFault."""
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
        raise bad_file(path, f"the material library has more than {MATERIALS_MAX} materials")
    return {name: _Section(path, name, fields).material(textures, left) for name, fields in sections.items()}


class _Section:
    """The lines under one newmtl."""

    def __init__(self, path: Path, name: str, fields: dict[str, list[str]]) -> None:
        self._path = path
        self._name = name
        self._fields = fields

    def material(self, textures: TextureList, left: NotCarried) -> Material:
        red, green, blue = self._colour("kd", (0.8, 0.8, 0.8))
        texture = self._texture(textures)
        opacity = min(max(1.0 - self._number("tr", 0.0) if "d" not in self._fields else self._number("d", 1.0), 0.0), 1.0)
        refracts = opacity < 1 and int(min(max(self._number("illum", 2), 0), 99)) in _REFRACTING
        shade = self._number("ns", 0.0)
        alpha = math.sqrt(2.0 / (min(max(shade, 0.0), 1e6) + 2.0))
        for key in ("map_bump", "bump", "norm", "map_ks", "map_ns", "map_d", "map_ke", "disp", "map_refl", "refl"):
            left.note(f"OBJ material maps {key}", int(key in self._fields))
        emission = tuple(min(max(value, 0.0), 1e12) for value in self._colour("ke", (0.0, 0.0, 0.0)))
        return Material(
            name=self._name,
            # A texture replaces the colour: files leave Kd at black or grey beside it.
            base_color=(1.0, 1.0, 1.0, 1.0 if refracts else opacity) if texture >= 0
            else (_unit(red), _unit(green), _unit(blue), 1.0 if refracts else opacity),
            base_color_texture=TextureUse(texture) if texture >= 0 else None,
            metallic=_unit(self._number("pm", 0.0)),
            roughness=_unit(self._number("pr", math.sqrt(alpha))),
            emissive=(emission[0], emission[1], emission[2]),
            transmission=1.0 - opacity if refracts else 0.0,
            ior=min(max(self._number("ni", 1.5), 1.0), 100.0),
            double_sided=True,
            alpha_mode=AlphaMode.BLEND if opacity < 1 and not refracts else AlphaMode.OPAQUE,
        )  # fmt: skip

    def _number(self, key: str, default: float) -> float:
        words = self._fields.get(key)
        return self._parsed(key, words[-1]) if words else default

    def _colour(self, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        words = self._fields.get(key, [])
        if not words or words[0] in ("spectral", "xyz"):
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

    def _texture(self, textures: TextureList) -> int:
        words = list(self._fields.get("map_kd", []))
        while words and words[0].startswith("-"):
            option = words.pop(0)
            count = _OPTIONS.get(option, 0)
            if option in _TURNS:
                count = next((at for at, word in enumerate(words[:3]) if not _is_number(word)), min(len(words), 3))
            del words[:count]
        if not words:
            return -1
        name = " ".join(words)
        target = beside(self._path, name, "the texture")
        readable_size(target)
        image = EncodedImage(self._path, f"the texture {name!r}", Path(name).name, target.read_bytes())
        return textures.add(str(target), image, srgb=True)


def _unit(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
