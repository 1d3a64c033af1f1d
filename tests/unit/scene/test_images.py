"""If these failed, images of rarer kinds would come in with wrong colours, or a strange one would stop an import."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import image_modes, read_scene
from scenefold.scene.importers.images import EncodedImage, TextureList, linear_of_codes, mean_linear
from scenefold.scene.importers.source import NotCarried, Pixels
from unit.scene.gltf_maker import Maker

GREY, RGB, GREY_ALPHA, RGB_ALPHA = 0, 2, 4, 6
CHANNELS = {GREY: 1, RGB: 3, GREY_ALPHA: 2, RGB_ALPHA: 4}


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def deep_png(values: np.ndarray, kind: int, *more: bytes) -> bytes:  # type: ignore[type-arg]
    """A PNG of 16 bits a channel of [height, width, channels]."""
    height, width, _ = values.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + b"".join(more) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def encoded(content: bytes) -> EncodedImage:
    return EncodedImage(Path("scene.gltf"), "the texture 'a'", "a", content)


def saved(image: Image.Image, kind: str, **more: Any) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **more)
    return file.getvalue()


def pixels_of(content: bytes) -> Pixels:
    return encoded(content).pixels()


@given(st.integers(0, 2**32 - 1), st.sampled_from(list(CHANNELS)), st.integers(1, 9), st.integers(1, 9))
@settings(max_examples=40, deadline=None)
def test_sixteen_bits_are_rounded(seed: int, kind: int, width: int, height: int) -> None:
    values = np.random.default_rng(seed).integers(0, 65_536, (height, width, CHANNELS[kind]))
    expected = np.floor(values / 257 + 0.5)
    found, deep = encoded(deep_png(values, kind)).decoded()
    assert found.dtype == np.uint8 and found.shape == (height, width, 4) and deep
    colour = expected[..., :3] if kind in (RGB, RGB_ALPHA) else np.repeat(expected[..., :1], 3, axis=2)
    assert np.array_equal(found[..., :3], colour)
    alpha = expected[..., -1] if kind in (GREY_ALPHA, RGB_ALPHA) else np.full((height, width), 255)
    assert np.array_equal(found[..., 3], alpha)


@pytest.mark.parametrize("kind", list(CHANNELS))
def test_rows_are_put_together_in_order(kind: int, monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(kind).integers(0, 65_536, (7, 5, CHANNELS[kind]))
    content = deep_png(values, kind)
    whole = pixels_of(content)
    for pixels in (1, 10, 11):
        monkeypatch.setattr(image_modes, "_BLOCK_PIXELS", pixels)
        assert np.array_equal(pixels_of(content), whole)


@pytest.mark.parametrize("make", [*CHANNELS, "F"])
def test_wide_numbers_never_exist_for_a_whole_image(make: Any) -> None:
    if make == "F":
        content = saved(Image.fromarray(np.zeros((1024, 1024), np.float32)), "TIFF")
    else:
        content = deep_png(np.zeros((1024, 1024, CHANNELS[make]), np.uint16), make)
    tracemalloc.start()
    try:
        pixels = pixels_of(content)
        assert pixels.shape == (1024, 1024, 4)
        assert tracemalloc.get_traced_memory()[1] < 16 * 1024 * 1024, "the result has 4 bytes a pixel; Pillow's own images are not traced"
    finally:
        tracemalloc.stop()


def test_ends_stay_ends() -> None:
    for kind, channels in CHANNELS.items():
        assert (pixels_of(deep_png(np.full((2, 2, channels), 65_535), kind)) == 255).all()
        black = pixels_of(deep_png(np.zeros((2, 2, channels), int), kind))
        assert (black[..., :3] == 0).all() and (black[..., 3] == (0 if kind in (GREY_ALPHA, RGB_ALPHA) else 255)).all()


def test_one_clear_colour_of_sixteen_bits() -> None:
    values = np.array([[[1000, 2000, 3000], [1000, 2000, 3001]]])
    found = pixels_of(deep_png(values, RGB, chunk(b"tRNS", struct.pack(">HHH", 1000, 2000, 3000))))
    assert found[0, :, 3].tolist() == [0, 255]
    found = pixels_of(deep_png(values[..., 2:], GREY, chunk(b"tRNS", struct.pack(">H", 3001))))
    assert found[0, :, 3].tolist() == [255, 0]


def test_a_deep_image_is_noted_once() -> None:
    left = NotCarried()
    textures, image = TextureList(left), encoded(deep_png(np.zeros((1, 1, 3), int), RGB))
    assert [textures.add(1, image, srgb=True), textures.add(1, image, srgb=False), textures.add(1, image, srgb=True)] == [0, 1, 0]
    assert left.lines() == ["images of more than 8 bits a channel, rounded to 8 (1)"]


def test_palettes_greys_and_printers_colours() -> None:
    palette = Image.new("P", (2, 1))
    palette.putpalette([255, 0, 0, 0, 0, 255])
    palette.putdata([0, 1])
    assert pixels_of(saved(palette, "PNG"))[0].tolist() == [[255, 0, 0, 255], [0, 0, 255, 255]]
    assert pixels_of(saved(palette, "PNG", transparency=b"\x80\xff"))[0].tolist() == [[255, 0, 0, 128], [0, 0, 255, 255]]
    assert pixels_of(saved(palette, "PNG", transparency=1))[0, :, 3].tolist() == [255, 0]
    assert pixels_of(saved(Image.new("L", (1, 1), 77), "PNG"))[0, 0].tolist() == [77, 77, 77, 255]
    assert pixels_of(saved(Image.new("LA", (1, 1), (77, 9)), "PNG"))[0, 0].tolist() == [77, 77, 77, 9]
    assert pixels_of(saved(Image.new("1", (1, 1), 1), "PNG"))[0, 0].tolist() == [255, 255, 255, 255]
    for kind in ("JPEG", "TIFF"):
        red = pixels_of(saved(Image.new("CMYK", (8, 8), (0, 255, 255, 0)), kind))[4, 4]
        assert np.abs(red.astype(int) - [255, 0, 0, 255]).max() <= 2


def test_floats_beyond_all_bounds_are_white_or_black() -> None:
    values = np.array([[0.0, 0.5, 1.0, 7.0, np.inf, -np.inf, np.nan, -1.0]], np.float32)
    found = pixels_of(saved(Image.fromarray(values), "TIFF"))
    assert found[0, :, 0].tolist() == [0, 128, 255, 255, 255, 0, 0, 0] and (found[..., 3] == 255).all()


def test_a_mean_takes_no_more_room_than_a_few_rows() -> None:
    pixels = np.random.default_rng(5).integers(0, 256, (512, 512, 4), np.uint8)
    table = linear_of_codes()
    expected = [float((np.bincount(pixels[..., channel].ravel(), minlength=256) * table).sum() / 512**2) for channel in range(3)]
    tracemalloc.start()
    try:
        assert list(mean_linear(pixels)) == expected
        assert tracemalloc.get_traced_memory()[1] < 256 * 1024
    finally:
        tracemalloc.stop()


def test_black_and_white_means_are_exact() -> None:
    assert mean_linear(np.zeros((3, 5, 4), np.uint8)) == (0.0, 0.0, 0.0)
    assert mean_linear(np.full((3, 5, 4), 255, np.uint8)) == (1.0, 1.0, 1.0)


def _beyond(maker: Maker) -> None:
    maker.add("textures", source=3)


def _beyond_in_an_extension(maker: Maker) -> None:
    maker.add("textures", extensions={"EXT_texture_webp": {"source": 0}})


def _texture_for_image(maker: Maker) -> None:
    maker.add("images", extensions={"EXT_texture_webp": {"source": 0}})
    maker.add("textures", extensions={"EXT_texture_webp": {"source": 0}})


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (_beyond, r"textures\[0\].source names image 3, but there are 0"),
        (_beyond_in_an_extension, "EXT_texture_webp.source names image 0, but there are 0"),
        (_texture_for_image, r"images\[0\] has neither a uri nor a buffer view"),
    ],
)
def test_textures_that_lead_nowhere_or_to_themselves(tmp_path: Path, make: Any, words: str) -> None:
    maker = Maker()
    make(maker)
    maker.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    maker.node(mesh=maker.mesh(material=0, attributes={"TEXCOORD_0": np.zeros((3, 2), "<f4")}))
    with pytest.raises(LocalFault, match=words) as caught:
        read_scene(maker.write(tmp_path))
    assert "\n" not in str(caught.value)
