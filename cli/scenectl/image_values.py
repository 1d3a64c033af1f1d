"""Values of options that say which part of an image is made, and of what it consists; see values.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

from scenectl.values import ONE_WORD, is_digits
from scenefold.base.image_limits import CAMERA_NAME_BYTES_MAX

LAYER_NAMES = (
    "emission",
    "direct",
    "indirect",
    "albedo",
    "normal",
    "depth",
    "position",
    "object_id",
    "material_id",
    "samples",
    "variance",
)
"""Layers that an EXR file may have beside the beauty. Tests hold it equal to scenefold.render.layers, slow to import."""


@dataclass(frozen=True)
class Layers:
    """Layers of an image beside its beauty, which is always there: albedo,depth; or all; or none."""

    names: tuple[str, ...]
    """In the order of `LAYER_NAMES`."""

    @classmethod
    def parse(cls, text: str) -> Self:
        words = {"all": LAYER_NAMES, "none": ()}.get(text.strip().lower())
        named = [word.strip() for word in text.split(",")] if words is None else list(words)
        # It is always there, so whoever names it is right.
        named = [name for name in named if name != "beauty"]
        unknown = [name for name in named if name not in LAYER_NAMES]
        alone = [name for name in unknown if name.lower() in {"all", "none"}]
        if alone:
            raise ValueError(f"{alone[0]!r} stands alone: leave it out, or the others")
        if unknown:
            raise ValueError(f"there is no layer {unknown[0]!r}: choose among {', '.join(LAYER_NAMES)}, or say all, or none")
        if len(set(named)) != len(named):
            raise ValueError("a layer stands there twice")
        return cls(tuple(name for name in LAYER_NAMES if name in named))

    def __str__(self) -> str:
        return ",".join(self.names) or "none"


@dataclass(frozen=True)
class Crop:
    """A part of an image in pixels, from the upper left corner: 100,50,64,48."""

    numbers: tuple[int, int, int, int]
    """Left, top, width, height."""

    @classmethod
    def parse(cls, text: str) -> Self:
        words = [word.strip() for word in text.split(",")]
        if len(words) != 4 or not all(map(is_digits, words)) or "0" in {word.lstrip("0") or "0" for word in words[2:]}:
            raise ValueError(f"a crop is X,Y,WIDTH,HEIGHT in pixels, such as 100,50,64,48, not {text!r}")
        left, top, width, height = map(int, words)
        return cls((left, top, width, height))

    def __str__(self) -> str:
        return ",".join(map(str, self.numbers))


def check_camera(name: str) -> None:
    """UsageFault for what cannot be the name of a camera."""
    from scenefold.base.errors import UsageFault

    remedy = "give the name that a camera has in the scene"
    try:
        size = len(name.encode())
    except UnicodeEncodeError:
        raise UsageFault("a camera's name is text", where="--camera", remedy=remedy) from None
    if not 0 < size <= CAMERA_NAME_BYTES_MAX:
        raise UsageFault(f"a camera's name has 1 to {CAMERA_NAME_BYTES_MAX} bytes, not {size}", where="--camera", remedy=remedy)


USUAL_LAYERS = Layers(("albedo", "normal", "depth"))
LayersOption = Annotated[Layers, ONE_WORD]
CropOption = Annotated[Crop, ONE_WORD]
