"""If this fails, images lose layers or precision on disk, or the same image no longer has the same hash."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.render.image_files import check_writable, image_sha256, write_exr, write_png
from scenefold.render.window import Window


def _layers() -> dict[str, np.ndarray]:
    dice = np.random.default_rng(7)
    return {
        "beauty": dice.normal(size=(5, 8, 3)).astype(np.float32),
        "albedo": dice.random((5, 8, 3), dtype=np.float32),
        "normal": dice.normal(size=(5, 8, 3)).astype(np.float32),
        "depth": dice.random((5, 8), dtype=np.float32),
        "object_id": dice.integers(0, 2**32, (5, 8), dtype=np.uint32),
        "samples": dice.integers(0, 2**20, (5, 8), dtype=np.uint32),
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
    assert np.array_equal(read["object_id.I"], layers["object_id"]) and np.array_equal(read["samples.N"], layers["samples"])
    assert read["R"].dtype == np.float32 and read["samples.N"].dtype == np.uint32
    assert [file.name for file in tmp_path.iterdir()] == ["a.exr"], "no temporary file stays behind"


def test_a_crop_knows_where_it_lies(tmp_path: Path) -> None:
    import OpenEXR

    layers = _layers()
    write_exr(tmp_path / "a.exr", layers, {}, Window(30, 20, 8, 5), (64, 48))
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        header, red = dict(file.header()), file.channels()["R"].pixels
    assert [corner.tolist() for corner in header["dataWindow"]] == [[30, 20], [37, 24]]
    assert [corner.tolist() for corner in header["displayWindow"]] == [[0, 0], [63, 47]]
    assert np.array_equal(red, layers["beauty"][..., 0])


def test_hash_is_that_of_little_endian_rows_from_the_top() -> None:
    beauty = _layers()["beauty"]
    expected = hashlib.sha256(beauty.astype("<f4").tobytes()).hexdigest()
    assert image_sha256(beauty) == expected
    assert image_sha256(np.asfortranarray(beauty)) == expected
    assert image_sha256(beauty[::-1]) != expected


def test_png_has_the_size_and_its_middle_grey(tmp_path: Path) -> None:
    from PIL import Image

    beauty = np.full((3, 4, 3), 0.18, np.float32)
    beauty[2, 3, 1] = np.inf
    assert write_png(tmp_path / "a.png", beauty, 0.0).not_finite == 1
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (4, 3) and image.mode == "RGB"
        assert image.getpixel((0, 0)) == (128, 128, 128)


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


def test_a_name_may_be_as_long_as_the_system_lets_it_be(tmp_path: Path) -> None:
    path = tmp_path / f"{'a' * 251}.exr"
    check_writable(path)
    write_exr(path, _layers(), {})
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_name_that_is_too_long_is_noticed_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match=r"File name too long .*: give the output another name"):
        check_writable(tmp_path / "a.exr", tmp_path / f"{'a' * 252}.exr")
    with pytest.raises(LocalFault, match="cannot write the image: File name too long"):
        write_exr(tmp_path / f"{'a' * 252}.exr", _layers(), {})
    assert not [*tmp_path.iterdir()]
