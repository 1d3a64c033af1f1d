"""If this fails, images lose layers or precision on disk, or the same image no longer has the same hash."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.render.image_files import automatic_exposure, check_writable, display_bytes, image_sha256, write_exr, write_png


def _layers() -> dict[str, np.ndarray]:
    dice = np.random.default_rng(7)
    return {
        "beauty": dice.normal(size=(5, 8, 3)).astype(np.float32),
        "albedo": dice.random((5, 8, 3), dtype=np.float32),
        "normal": dice.normal(size=(5, 8, 3)).astype(np.float32),
        "depth": dice.random((5, 8), dtype=np.float32),
    }


def test_every_layer_comes_back_bit_for_bit(tmp_path: Path) -> None:
    import OpenEXR

    layers = _layers()
    write_exr(tmp_path / "a.exr", layers, {"scenefold.samples": 64, "scenefold.scene": "kitchen"})
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        read = {name: channel.pixels for name, channel in file.channels().items()}
        header = dict(file.header())
    assert header["scenefold.samples"] == "64" and header["scenefold.scene"] == "kitchen"
    for index, name in enumerate("RGB"):
        assert np.array_equal(read[name], layers["beauty"][..., index])
        assert np.array_equal(read[f"albedo.{name}"], layers["albedo"][..., index])
    for index, name in enumerate("XYZ"):
        assert np.array_equal(read[f"normal.{name}"], layers["normal"][..., index])
    assert np.array_equal(read["depth.Z"], layers["depth"])
    assert read["R"].dtype == np.float32
    assert [file.name for file in tmp_path.iterdir()] == ["a.exr"], "no temporary file stays behind"


def test_hash_is_that_of_little_endian_rows_from_the_top() -> None:
    beauty = _layers()["beauty"]
    expected = hashlib.sha256(beauty.astype("<f4").tobytes()).hexdigest()
    assert image_sha256(beauty) == expected
    assert image_sha256(np.asfortranarray(beauty)) == expected
    assert image_sha256(beauty[::-1]) != expected


def test_png_has_the_size_and_an_unchanged_middle_grey(tmp_path: Path) -> None:
    from PIL import Image

    beauty = np.full((3, 4, 3), 0.18, np.float32)
    write_png(tmp_path / "a.png", beauty, 0.0)
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (4, 3) and image.mode == "RGB"
        assert image.getpixel((0, 0)) == (118, 118, 118)


def test_view_transform_rises_and_never_clips_hard() -> None:
    ramp = np.linspace(0, 40, 400, dtype=np.float32).reshape(1, -1, 1).repeat(3, axis=2)
    shown = display_bytes(ramp)[0, :, 0].astype(int)
    assert (np.diff(shown) >= 0).all() and shown[0] == 0 and shown[-1] == 255
    assert display_bytes(np.full((1, 1, 3), 1.0, np.float32))[0, 0, 0] < 245


def test_bright_colours_fade_to_white_and_dark_ones_keep_their_hue() -> None:
    lamp = display_bytes(np.array([[[400.0, 40.0, 4.0]]], np.float32))[0, 0]
    assert lamp.min() > 240
    brick = display_bytes(np.array([[[0.5, 0.1, 0.05]]], np.float32))[0, 0]
    assert tuple(brick) == (188, 89, 63)


def test_a_scene_in_any_unit_is_shown_neither_black_nor_burnt_out() -> None:
    picture = np.random.default_rng(5).uniform(0.02, 1.0, (30, 40, 3)).astype(np.float32)
    assert automatic_exposure(picture) == 0.0, "a well exposed image is left alone"
    for factor in (1e-4, 300.0, 4e6):
        shown = display_bytes(picture * np.float32(factor), automatic_exposure(picture * np.float32(factor)))
        assert 60 < float(np.median(shown)) < 220
    assert automatic_exposure(np.zeros((4, 4, 3), np.float32)) == 0.0


def test_what_is_no_number_is_shown_black() -> None:
    assert display_bytes(np.array([[[np.nan, np.nan, np.nan]]], np.float32)).max() == 0


def test_a_failed_write_keeps_the_older_image(tmp_path: Path) -> None:
    path = tmp_path / "missing" / "a.exr"
    with pytest.raises(LocalFault, match="cannot write"):
        write_exr(path, _layers(), {})


def test_an_unwritable_output_is_noticed_before_the_work(tmp_path: Path) -> None:
    check_writable(tmp_path / "a.exr")
    with pytest.raises(LocalFault, match="does not exist"):
        check_writable(tmp_path / "missing" / "a.exr")
    with pytest.raises(LocalFault, match="is a folder"):
        check_writable(tmp_path)
