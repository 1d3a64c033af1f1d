"""Images of a scene file: checked once before anything is written, decoded again when their tiles are.

Only image_modes.py knows Pillow.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.base.limits import TEXTURE_PIXELS_ALL_MAX, TEXTURE_PIXELS_MAX, TEXTURE_SIDE_MAX
from scenefold.scene.importers.faults import bad_file
from scenefold.scene.importers.image_modes import opened, rgba_of
from scenefold.scene.importers.source import NotCarried, Pixels, SourceTexture

_SRGB_KNEE = 0.04045


class UnreadableImage(LocalFault):
    """Bytes that are no image, or a damaged one."""


@dataclass(frozen=True, slots=True)
class EncodedImage:
    """An image as it stands in the file."""

    scene_file: Path
    what: str
    """Words for an error, such as "the image 'wood.png'"."""
    name: str
    content: bytes | memoryview

    def pixels(self) -> Pixels:
        """u8[height, width, 4]; UnreadableImage if it is no image or damaged, LocalFault if it is too large."""
        return self.decoded()[0]

    def decoded(self) -> tuple[Pixels, bool]:
        """The pixels, and whether the file had more than 8 bits a channel."""
        with self._named():
            return self._decoded()

    def pixel_count(self) -> int:
        """How many pixels its head says there are; 0 where that cannot be read."""
        try:
            with self._named():
                width, height = opened(self.content).size
        except UnreadableImage:
            return 0
        # One that is too large is refused by itself, in its own words.
        return min(width * height, TEXTURE_PIXELS_MAX)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Turns whatever decoders raise into an UnreadableImage that names this image."""
        try:
            yield
        except (LocalFault, MemoryError):
            raise
        except Exception as error:  # Pillow's decoders raise many kinds of errors on damaged files
            what = f"{self.what} cannot be read, {error}"
            raise UnreadableImage(what, where=str(self.scene_file), remedy="export it as PNG or JPEG") from error

    def _decoded(self) -> tuple[Pixels, bool]:
        image = opened(self.content)
        width, height = image.size
        if max(width, height) > TEXTURE_SIDE_MAX or width * height > TEXTURE_PIXELS_MAX:
            bound = f"{TEXTURE_SIDE_MAX} a side and {TEXTURE_PIXELS_MAX} pixels"
            raise bad_file(self.scene_file, f"{self.what} has {width} x {height} pixels, over {bound}", "make it smaller")
        return rgba_of(image, self.content)


class ImageSource(Protocol):
    """What a texture may be made of."""

    @property
    def name(self) -> str: ...

    @property
    def what(self) -> str: ...

    @property
    def scene_file(self) -> Path: ...

    def pixel_count(self) -> int: ...

    def pixels(self) -> Pixels: ...

    def decoded(self) -> tuple[Pixels, bool]: ...


def linear_of_codes() -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """float64[256]: linear light of sRGB's codes."""
    codes = np.arange(256) / 255.0
    return np.where(codes <= _SRGB_KNEE, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def mean_linear(pixels: Pixels) -> tuple[float, float, float]:
    """The mean of an sRGB image in linear light."""
    table = linear_of_codes()
    means = []
    for channel in range(3):
        # Counted row by row: bincount makes 8 bytes of each.
        counts = sum((np.bincount(row, minlength=256) for row in pixels[..., channel]), np.zeros(256, np.int64))
        means.append(min(float((counts * table).sum() / counts.sum()), 1.0))
    return means[0], means[1], means[2]


class _Head(NamedTuple):
    """What is known of an image once it was decoded."""

    width: int
    height: int
    has_alpha: bool


class TextureList:
    """The textures that materials use, each image and meaning once; every image is checked when first used."""

    def __init__(self, left: NotCarried) -> None:
        self._left = left
        self._heads: dict[object, _Head | None] = {}
        self.textures: list[SourceTexture] = []
        self._numbers: dict[tuple[object, bool], int] = {}
        self._means: dict[int, tuple[float, float, float]] = {}
        self._pixels = 0

    def is_readable(self, key: object, image: ImageSource) -> bool:
        """Whether an image can be decoded; one that cannot is counted once. A surface without it has its factors alone."""
        return self._head(key, image) is not None

    def add(self, key: object, image: ImageSource, *, srgb: bool) -> int:
        """The number of the texture of this image, which is readable; `key` tells images apart."""
        number = self._numbers.get((key, srgb))
        if number is not None:
            return number
        head = self._head(key, image)
        assert head is not None, "the caller asks is_readable first"
        self.textures.append(SourceTexture(image.name, head.width, head.height, srgb, head.has_alpha, image.pixels))
        self._numbers[key, srgb] = len(self.textures) - 1
        return len(self.textures) - 1

    def _head(self, key: object, image: ImageSource) -> _Head | None:
        if key not in self._heads:
            self._heads[key] = self._checked(image)
        return self._heads[key]

    def _checked(self, image: ImageSource) -> _Head | None:
        # A few bytes may decode to the largest image that there may be, and many entries may name them.
        self._pixels += image.pixel_count()
        if self._pixels > TEXTURE_PIXELS_ALL_MAX:
            what = f"its images have more than {TEXTURE_PIXELS_ALL_MAX} pixels in all"
            raise bad_file(image.scene_file, what, "make its images smaller, or fewer")
        try:
            pixels, deep = image.decoded()
        except UnreadableImage:
            self._left.note(f"{image.what}, which cannot be read")
            return None
        self._left.note("images of more than 8 bits a channel, rounded to 8", int(deep))
        return _Head(pixels.shape[1], pixels.shape[0], bool((pixels[..., 3] < 255).any()))

    def mean(self, number: int) -> tuple[float, float, float]:
        """The mean colour of a texture whose colours are sRGB, in linear light."""
        if number not in self._means:
            self._means[number] = mean_linear(self.textures[number].pixels())
        return self._means[number]
