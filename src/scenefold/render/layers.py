"""The layers of an image: what each is called, what it is made of, and how it travels (specs/08-passes.md, *The image*). Pure.

An image always has the layer `beauty`; which others, the job says. It is sent as its layers, one after the other,
little-endian, rows from the top.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import UsageFault
from scenefold.render.sum_columns import ALL_AOVS, ONE_PART, PLAIN_AOVS, THREE_PARTS, SumColumns

Pixels = npt.NDArray[Any]
"""[H, W, channels], or [H, W] where there is one channel; float32 or uint32."""
BEAUTY = "beauty"
USUAL = ("albedo", "normal", "depth")
"""What an image has beside its beauty if nobody says otherwise."""


@dataclass(frozen=True, slots=True)
class LayerKind:
    """What is known of a layer."""

    channels: str
    """A letter for each, as EXR files call them."""
    whole: bool = False
    """Whole numbers, uint32, instead of float32."""
    radiance: int = ONE_PART
    """Columns of radiance that it needs."""
    aovs: int = PLAIN_AOVS
    """Columns of the first hit that it needs."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of a value as it is sent."""
        return np.dtype("<u4" if self.whole else "<f4")


KINDS: Mapping[str, LayerKind] = {
    BEAUTY: LayerKind("RGB"),
    "emission": LayerKind("RGB", radiance=THREE_PARTS),
    "direct": LayerKind("RGB", radiance=THREE_PARTS),
    "indirect": LayerKind("RGB", radiance=THREE_PARTS),
    "albedo": LayerKind("RGB"),
    "normal": LayerKind("XYZ"),
    "depth": LayerKind("Z"),
    "position": LayerKind("XYZ", aovs=ALL_AOVS),
    "object_id": LayerKind("I", whole=True, aovs=ALL_AOVS),
    "material_id": LayerKind("I", whole=True, aovs=ALL_AOVS),
    "samples": LayerKind("N", whole=True),
    "variance": LayerKind("RGB"),
}
"""All layers, in the order in which they are sent."""
BESIDE = tuple(name for name in KINDS if name != BEAUTY)
"""All that may be chosen beside the beauty."""


def check_layers(names: Sequence[str]) -> None:
    """UsageFault unless each is a layer beside the beauty, named once, in the order of `BESIDE`."""
    unknown = [name for name in names if name not in BESIDE]
    if unknown:
        raise UsageFault(f"there is no layer {unknown[0]!r:.40}", where="layers", remedy=f"choose among {', '.join(BESIDE)}")
    if tuple(names) != in_order(names):
        raise UsageFault(
            "the layers are in no order, or one stands there twice", where="layers", remedy=f"the order is {', '.join(BESIDE)}"
        )


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Those of `BESIDE` that are named, in its order, each once."""
    named = set(names)
    return tuple(name for name in BESIDE if name in named)


def columns_of(names: Iterable[str]) -> SumColumns:
    """The columns that sums need for these layers and the beauty."""
    kinds = [KINDS[BEAUTY], *(KINDS[name] for name in names)]
    return SumColumns(max(kind.radiance for kind in kinds), max(kind.aovs for kind in kinds))


def image_bytes(names: Iterable[str], pixels: int) -> int:
    """The size of an image of these layers and the beauty, as it is sent."""
    return pixels * sum(_pixel_bytes(name) for name in (BEAUTY, *names))


def packed(layers: Mapping[str, Pixels]) -> bytes:
    """An image as it is sent."""
    return b"".join(np.ascontiguousarray(layers[name], kind.dtype).tobytes() for name, kind in KINDS.items() if name in layers)


def unpacked(image: bytes, names: Iterable[str], width: int, height: int) -> dict[str, Pixels]:
    """The layers of an image of just this size."""
    layers: dict[str, Pixels] = {}
    at = 0
    for name in (BEAUTY, *names):
        kind = KINDS[name]
        count = width * height * len(kind.channels)
        values = np.frombuffer(image, kind.dtype, count, at).astype(kind.dtype.newbyteorder("="))
        layers[name] = values.reshape((height, width, len(kind.channels)) if len(kind.channels) > 1 else (height, width))
        at += values.nbytes
    assert at == len(image), "an image of another size"
    return layers


def _pixel_bytes(name: str) -> int:
    kind = KINDS[name]
    return len(kind.channels) * kind.dtype.itemsize
