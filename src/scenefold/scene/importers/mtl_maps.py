"""Texture statements of OBJ material libraries: options, the file's name, and how the image is read.

An OBJ's v runs upwards from the image's lower edge and ours downwards from its upper one: so scale s and offset o of v become
v' = s v + 1 - s - o.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scenefold.scene.importers.composed_images import looks_like_normals
from scenefold.scene.importers.faults import bad_file, beside, identity_of, readable_size
from scenefold.scene.importers.images import EncodedImage
from scenefold.scene.payloads.texture_uses import TRANSFORM_MAX, TextureUse, Transform, Wrap

_OPTIONS = {"-blendu": 1, "-blendv": 1, "-clamp": 1, "-bm": 1, "-mm": 2, "-boost": 1, "-texres": 1, "-imfchan": 1, "-type": 1}
_TURNS = ("-o", "-s", "-t")


@dataclass(frozen=True, slots=True)
class MapStatement:
    """One texture of a material."""

    image: EncodedImage
    key: str
    """Tells files apart."""
    clamp: bool
    transform: Transform
    strength: float
    """What -bm says."""

    def use(self, texture: int) -> TextureUse:
        """How the texture of this number is read."""
        wrap = Wrap.CLAMP if self.clamp else Wrap.REPEAT
        return TextureUse(texture, 0, wrap, wrap, transform=self.transform)


class Maps:
    """The texture statements of one library: materials by the thousand name the same few files, and each is read once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._contents: dict[tuple[int, int], bytes] = {}
        self._normals: dict[str, bool] = {}

    def read(self, words: Sequence[str]) -> MapStatement | None:
        """The statement of these words; None if it names no file. LocalFault for one that is missing."""
        left = list(words)
        clamp, strength = False, 1.0
        moves = {"-s": [1.0, 1.0], "-o": [0.0, 0.0]}
        while left and left[0].startswith("-"):
            option = left.pop(0)
            count = _OPTIONS.get(option, 0)
            if option in _TURNS:
                count = next((at for at, word in enumerate(left[:3]) if not is_number(word)), min(len(left), 3))
            values, left = left[:count], left[count:]
            if option in moves:
                numbers = [float(value) for value in values[:2]]
                moves[option][: len(numbers)] = numbers
            elif option == "-clamp":
                clamp = values == ["on"]
            elif option == "-bm" and values and is_number(values[0]):
                strength = float(values[0])
        if not left:
            return None
        name = " ".join(left)
        target = beside(self._path, name, "the texture")
        image = EncodedImage(self._path, f"the texture {name!r}", Path(name).name, self._content(target))
        (scale_u, scale_v), (move_u, move_v) = moves["-s"], moves["-o"]
        transform = (scale_u, 0.0, move_u, 0.0, scale_v, 1.0 - scale_v - move_v)
        if not (max(map(abs, transform)) <= TRANSFORM_MAX and math.isfinite(strength)):
            raise bad_file(self._path, f"the texture {name!r} is scaled or moved beyond measure")
        return MapStatement(image, str(target), clamp, transform, strength)

    def holds_normals(self, shown: MapStatement) -> bool:
        """Whether a readable image holds normals, and not heights."""
        if shown.key not in self._normals:
            self._normals[shown.key] = looks_like_normals(shown.image.pixels())
        return self._normals[shown.key]

    def _content(self, target: Path) -> bytes:
        identity = identity_of(target)
        if identity not in self._contents:
            readable_size(target)
            self._contents[identity] = target.read_bytes()
        return self._contents[identity]


def is_number(word: str) -> bool:
    """Whether a word is a finite number."""
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
