"""Images whose channels come from several files: what OBJ's materials have in one file each, ours read from one texture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.images import EncodedImage
from scenefold.scene.importers.source import Pixels

RED, GREEN, BLUE, ALPHA = range(4)


@dataclass(frozen=True, slots=True)
class ComposedImage:
    """`base` (white without one) with some channels replaced; as large as the base, or else as the first part."""

    base: EncodedImage | None
    parts: tuple[tuple[int, EncodedImage], ...]
    """(channel, where it is taken from: an image's alpha if anything of it is clear and alpha is wanted, else its red)"""

    @property
    def name(self) -> str:
        """The names of all files."""
        return " + ".join(dict.fromkeys(image.name for image in self._images))

    @property
    def what(self) -> str:
        """Words for an error."""
        return f"the texture {self.name!r}"

    @property
    def scene_file(self) -> Path:
        """The file that names the images."""
        return self.parts[0][1].scene_file

    def pixel_count(self) -> int:
        """Of all files together."""
        return sum(image.pixel_count() for image in self._images)

    @property
    def _images(self) -> list[EncodedImage]:
        return ([self.base] if self.base else []) + [image for _, image in self.parts]

    def pixels(self) -> Pixels:
        """u8[height, width, 4]; LocalFault if a file is no image, damaged, or too large."""
        return self.decoded()[0]

    def decoded(self) -> tuple[Pixels, bool]:
        """The pixels, and False: files of more than 8 bits a channel are counted as they are read, each by itself."""
        taken = [(channel, image.pixels()) for channel, image in self.parts]
        pixels = np.full_like(taken[0][1], 255) if self.base is None else np.array(self.base.pixels())
        for channel, part in taken:
            pixels[..., channel] = _resized(_scalar(part, channel), pixels.shape[0], pixels.shape[1])
        return pixels, False


def looks_like_normals(pixels: Pixels) -> bool:
    """Whether an image holds vectors that mostly point outwards, not heights: blue, and its red and green around the middle."""
    means = pixels[..., :3].reshape(-1, 3).mean(axis=0)
    return bool(means[BLUE] > 150 and abs(means[RED] - 128) < 40 and abs(means[GREEN] - 128) < 40 and means[BLUE] > means[RED] + 20)


def _scalar(part: Pixels, channel: int) -> NDArray[np.uint8]:
    return part[..., ALPHA] if channel == ALPHA and bool((part[..., ALPHA] < 255).any()) else part[..., RED]


def _resized(values: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """The nearest pixel of each place."""
    rows = np.arange(height) * values.shape[0] // height
    columns = np.arange(width) * values.shape[1] // width
    nearest: NDArray[np.uint8] = values[rows[:, None], columns[None, :]]
    return nearest
