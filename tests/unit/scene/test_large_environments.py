"""If these failed, a small file of an environment map could fill a machine's memory, or lose its colours or other pictures without a word."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import environments, open_exr
from scenefold.scene.importers.environments import environment_of, read_environment
from scenefold.scene.importers.open_exr import read_exr
from scenefold.scene.importers.radiance_hdr import read_hdr
from scenefold.scene.importers.source import NotCarried

MIB = 1024 * 1024
Channels = dict[str, npt.NDArray[Any]]


def peak_bytes(work: Callable[[], object]) -> int:
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def exr(file: Path, *parts: Channels) -> Path:
    named = [OpenEXR.Part({}, dict(channels), name=f"part {number}") for number, channels in enumerate(parts)]
    with OpenEXR.File(named) if len(named) > 1 else OpenEXR.File({"type": OpenEXR.scanlineimage}, dict(parts[0])) as written:
        written.write(str(file))
    return file


def plain(names: str, height: int = 4, width: int = 8) -> Channels:
    return {name: np.full((height, width), number, np.float16) for number, name in enumerate(names, start=1)}


def test_channels_that_are_not_shown_are_not_read(tmp_path: Path) -> None:
    others = {f"other.{number}": np.zeros((256, 256), np.float32) for number in range(60)}
    file = exr(tmp_path / "a.exr", plain("RGB", 256, 256) | others)
    found: list[npt.NDArray[np.float32]] = []
    assert peak_bytes(lambda: found.append(read_exr(file, NotCarried()))) < 3 * MIB, "the map has 768 KiB, all channels 15 MiB"
    assert (found[0] == [1, 2, 3]).all()


def test_more_than_a_picture_is_bounded_by_the_headers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(open_exr, "_DECODED_BYTES_MAX", 5 * 4 * 8 * 4)
    read_environment(exr(tmp_path / "a.exr", plain("RGBAZ")))
    monkeypatch.setattr(OpenEXR, "InputFile", None)
    for parts in ([plain("RGBAXZ")], [plain("RGB"), plain("XYZ")]):
        with pytest.raises(LocalFault, match="all channels and parts of the OpenEXR file have 768 bytes") as caught:
            read_environment(exr(tmp_path / "b.exr", *parts))
        assert caught.value.remedy == "save it with the channels R, G and B alone"


def test_only_the_first_part_is_shown_and_the_others_are_said(tmp_path: Path) -> None:
    file = exr(tmp_path / "a.exr", plain("RGB"), plain("XYZ"), plain("Z"))
    found, left = read_environment(file)
    assert (found.radiance == [1, 2, 3]).all() and left == ["parts of the OpenEXR file beside the first (2)"]
    with pytest.raises(LocalFault, match="no channels R, G and B in its first part"):
        read_environment(exr(tmp_path / "b.exr", plain("X"), plain("RGB")))


def test_lost_colours_are_said(tmp_path: Path) -> None:
    channels = dict(zip(("Y", "RY", "BY"), plain("abc").values(), strict=True))
    found, left = read_environment(exr(tmp_path / "a.exr", channels))
    assert (found.radiance == 1).all() and left == ["colours of an OpenEXR picture in luminance and chroma, grey here (1)"]
    found, left = read_environment(exr(tmp_path / "b.exr", plain("RGBY")))
    assert (found.radiance == [1, 2, 3]).all() and left == [], "whatever Y is beside colours"


def test_channels_in_a_lower_resolution_are_refused() -> None:
    with pytest.raises(LocalFault, match="the channel Y of the OpenEXR file is not there for every pixel"):
        open_exr._kind_of(Path("a.exr"), "Y", SimpleNamespace(xSampling=2, ySampling=1, type="HALF"))


def test_rows_are_where_the_file_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(open_exr, "_ROWS", 3)
    light = np.random.default_rng(1).random((10, 7)).astype(np.float32)
    channels = {name: light * np.float32(number) for number, name in enumerate("RGB", start=1)}
    window = (np.array([3, -2], np.int32), np.array([9, 7], np.int32))
    for kind in (OpenEXR.scanlineimage, OpenEXR.tiledimage):
        tiles = {"tiles": OpenEXR.TileDescription()} if kind == OpenEXR.tiledimage else {}
        with OpenEXR.File({"type": kind, "dataWindow": window} | tiles, dict(channels)) as written:
            written.write(str(tmp_path / "a.exr"))
        found = read_exr(tmp_path / "a.exr", NotCarried())
        assert np.array_equal(found, np.stack([light, 2 * light, 3 * light], axis=2))


def test_run_lengths_unroll_into_the_map_alone(tmp_path: Path) -> None:
    width, height = 2048, 512
    row = bytes([2, 2, width >> 8, width & 255]) + 4 * (16 * bytes([255, 128]) + bytes([144, 128]))
    file = tmp_path / "sky.hdr"
    file.write_bytes(b"#?RADIANCE\n\n" + f"-Y {height} +X {width}\n".encode() + height * row)
    assert peak_bytes(lambda: read_hdr(file, NotCarried())) < 14 * MIB, "the map has 12 MiB"


def test_a_large_map_is_made_smaller_some_rows_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environments, "ENVIRONMENT_TEXELS_MAX", 1 << 12)
    radiance = np.ones((1023, 1024, 3), np.float32)
    radiance[700, 5] = np.nan
    assert peak_bytes(lambda: environment_of(radiance)) < 8 * MIB, "the map has 12 MiB, its half 3"


@pytest.mark.parametrize("shape", [(7, 9, 3), (8, 6, 3), (1, 5, 3), (5, 1, 3), (6, 7, 3)])
def test_rows_at_a_time_make_the_same_map(shape: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environments, "ENVIRONMENT_TEXELS_MAX", 16)
    radiance = np.random.default_rng(2).random(shape).astype(np.float32)
    radiance[0, 0, 0] = -1.0
    whole, said = environment_of(radiance.copy())
    monkeypatch.setattr(environments, "_ROWS", 2)
    parts, said_again = environment_of(radiance.copy())
    assert np.array_equal(whole.radiance, parts.radiance) and said == said_again
