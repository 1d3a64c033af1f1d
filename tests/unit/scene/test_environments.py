"""If this fails, an environment map is read as another one, or a damaged file or record is believed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from render.shapes import room
from scenefold.base.errors import DamagedData, LocalFault
from scenefold.scene.importers import environments, plan_import
from scenefold.scene.importers.environments import environment_of, read_environment
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.payloads.document import decode_document, encode_document
from scenefold.scene.payloads.environment import TEXELS_OF_A_PAGE, Environment, encode_environment, join_environment
from scenefold.scene.tables import SceneTables

HEADER = b"#?RADIANCE\n# made by hand\nFORMAT=32-bit_rle_rgbe\n\n"
Pixels = npt.NDArray[np.float32]


def hdr(tmp_path: Path, content: bytes) -> Path:
    file = tmp_path / "sky.hdr"
    file.write_bytes(content)
    return file


def test_plain_pixels_are_mantissas_and_a_common_exponent(tmp_path: Path) -> None:
    pixels = bytes([128, 64, 0, 129, 255, 0, 1, 128, 7, 7, 7, 0])
    found, left = read_environment(hdr(tmp_path, HEADER + b"-Y 1 +X 3\n" + pixels))
    assert left == []
    assert found.radiance.tolist() == [[[1.0, 0.5, 0.0], [255 / 256, 0.0, 1 / 256], [0.0, 0.0, 0.0]]]


def test_run_lengths_are_unrolled_channel_by_channel(tmp_path: Path) -> None:
    row = bytes([2, 2, 0, 10])
    runs = bytes([138, 128]) + bytes([4, 1, 2, 3, 4, 134, 9]) + bytes([10, *range(10)]) + bytes([138, 136])
    found, _ = read_environment(hdr(tmp_path, HEADER + b"-Y 2 +X 10\n" + 2 * (row + runs)))
    expected = np.stack([np.full(10, 128), [1, 2, 3, 4, 9, 9, 9, 9, 9, 9], np.arange(10)], axis=1)
    assert np.array_equal(found.radiance, np.broadcast_to(expected, (2, 10, 3)))


def test_an_exposure_is_taken_out(tmp_path: Path) -> None:
    found, _ = read_environment(hdr(tmp_path, b"#?RGBE\nEXPOSURE=2\nEXPOSURE=0.25\n\n-Y 1 +X 1\n" + bytes([128, 128, 128, 129])))
    assert found.radiance.tolist() == [[[2.0, 2.0, 2.0]]]


@pytest.mark.parametrize(
    "content",
    [
        b"#?RADIANCE\n\n+Y 1 +X 1\n" + bytes(4),
        b"P6 1 1 255\n" + bytes(3),
        b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n" + bytes(4),
        b"#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 1\n" + bytes(4),
        b"#?RADIANCE\nEXPOSURE=e\n\n-Y 1 +X 1\n" + bytes(4),
        HEADER + b"-Y 1 +X 2\n" + bytes(7),
        HEADER + b"-Y 0 +X 2\n",
        HEADER + b"-Y 99999 +X 99999\n",
        HEADER + b"-Y 1 +X 8\n" + bytes([2, 2, 0, 8]),
        HEADER + b"-Y 1 +X 8\n" + bytes([2, 2, 0, 9]) + bytes(64),
        HEADER + b"-Y 1 +X 8\n" + bytes([2, 2, 0, 8, 137, 1]) + bytes(64),
        HEADER + b"-Y 1 +X 8\n" + bytes([2, 2, 0, 8, 0, 1]) + bytes(64),
        HEADER + b"-Y 1 +X 2\n" + bytes([9, 9, 9, 129, 1, 1, 1, 1]),
    ],
)
def test_what_is_no_picture_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(LocalFault) as caught:
        read_environment(hdr(tmp_path, content))
    assert str(tmp_path) in str(caught.value)


def exr(file: Path, channels: dict[str, Any]) -> Path:
    import OpenEXR

    with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as written:
        written.write(str(file))
    return file


def test_open_exr_is_read_in_both_precisions(tmp_path: Path) -> None:
    light = np.random.default_rng(1).random((4, 8)).astype(np.float16)
    channels = {"R": light, "G": (2 * light).astype(np.float32), "B": light, "A": light, "depth.Z": light.astype(np.float32)}
    found, left = read_environment(exr(tmp_path / "a.exr", channels))
    assert left == []
    assert np.array_equal(found.radiance, np.stack([light, 2 * light, light], axis=2).astype(np.float32))
    grey, _ = read_environment(exr(tmp_path / "b.exr", {"Y": light}))
    assert np.array_equal(grey.radiance[:, :, 2], light.astype(np.float32))
    for content in (b"", b"no picture", (tmp_path / "a.exr").read_bytes()[:200]):
        (tmp_path / "c.exr").write_bytes(content)
        with pytest.raises(LocalFault):
            read_environment(tmp_path / "c.exr")
    with pytest.raises(LocalFault, match="no channels R, G and B"):
        read_environment(exr(tmp_path / "d.exr", {"X": light}))
    (tmp_path / "e.png").write_bytes(b"x")
    with pytest.raises(LocalFault, match="no kind of an environment map"):
        read_environment(tmp_path / "e.png")


def test_what_is_no_light_is_black_and_counted_once() -> None:
    radiance = np.ones((2, 4, 3), np.float32)
    radiance[0, 0, 1], radiance[0, 1, 2], radiance[1, 2, 0] = np.nan, np.inf, -1.0
    found, left = environment_of(radiance)
    assert left == ["texels of the environment map that are no light, taken as black (3)"]
    assert found.radiance.sum() == 5 * 3 and not found.radiance[0, :2].any()


def test_suns_fit() -> None:
    radiance = np.array([[[1e7, 1.0, 1e-2], [0.5, 2.0**20, 0.0]]], np.float32)
    assert np.allclose(environment_of(radiance)[0].radiance, radiance, rtol=1e-3)


def test_a_map_that_is_too_large_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environments, "ENVIRONMENT_TEXELS_MAX", 8)
    found, left = environment_of(np.arange(48, dtype=np.float32).reshape(4, 4, 3))
    assert left == ["halvings of the environment map's sides, which was too large (1)"]
    assert found.radiance[:, :, 0].tolist() == [[7.5, 13.5], [31.5, 37.5]]
    odd, _ = environment_of(np.ones((3, 5, 3), np.float32))
    assert odd.radiance.shape == (2, 3, 3) and (odd.radiance == 1).all()


def some_map(height: int, width: int) -> Environment:
    return environment_of(np.random.default_rng(2).random((height, width, 3)).astype(np.float32))[0]


def under_a_map(environment: Environment) -> SourceScene:
    return replace(room(), environment=environment)


def test_pages_join_to_the_map() -> None:
    for found in (Environment(), some_map(1, 1), some_map(100, 100), some_map(71, 143)):
        pages = encode_environment(found)
        assert len(pages) == -(-len(found) // TEXELS_OF_A_PAGE)
        again = join_environment(pages)
        assert np.array_equal(again.radiance, found.radiance)


def test_a_page_that_is_off_is_refused() -> None:
    first, second = encode_environment(some_map(71, 143))
    for pages in (
        [first],
        [second],
        [second, first],
        [first, first],
        [first, second, second],
        [first[:-1], second],
        [first + b"x", second],
    ):
        with pytest.raises(DamagedData):
            join_environment(pages)
    for at, value in ((0, 0x58), (4, 2), (7, 0), (11, 0x7F), (21, 0x7E), (21, 0x80 | 0x3C)):
        damaged = bytearray(encode_environment(some_map(1, 3))[0])
        damaged[at] = value
        if at == 7:
            damaged[6] = 0
        with pytest.raises(DamagedData):
            join_environment([bytes(damaged)])


def test_a_scene_has_its_map_or_is_as_it_always_was() -> None:
    plan = plan_import(under_a_map(some_map(71, 143)))
    records = {(item.space, item.location): item.payload for item in plan.items()}
    document = decode_document(encode_document(plan.document()))
    assert document.counts["environment"] == 71 * 143 and len(document.pages["environment"]) == 2
    tables = SceneTables.from_payloads(document, [records[key] for key in document.locations()])
    assert np.array_equal(tables.environment.radiance, some_map(71, 143).radiance)
    plain = plan_import(room())
    list(plain.items())
    payload = encode_document(plain.document())
    assert b"environment" not in payload
    assert decode_document(payload).pages["environment"] == () and decode_document(payload).counts["environment"] == 0


@pytest.mark.parametrize("glare", [1e12, 1e30])
def test_a_texel_that_is_no_light_at_all_leaves_the_others_as_they_are(glare: float) -> None:
    radiance = np.full((8, 16, 3), 0.5, np.float32)
    radiance[3, 5] = (glare, glare / 2, 0.0)
    map_, left = environment_of(radiance.copy())
    assert left == ["texels of the environment map over 6.71089e+07 times as bright as the middle one, taken for as bright as that (1)"]
    texels = map_.texels.astype(np.float64).reshape(8, 16, 3) * 2.0**map_.exponent
    others = np.ones((8, 16), bool)
    others[3, 5] = False
    assert (texels[others] == 0.5).all(), "to the last bit"
    assert texels[3, 5] == pytest.approx((2.0**25, 2.0**24, 0.0), rel=1e-3)
    # A sun is no such texel.
    radiance[3, 5] = 3e7
    map_, left = environment_of(radiance)
    assert left == [] and map_.texels.astype(np.float64).reshape(8, 16, 3)[3, 5, 0] * 2.0**map_.exponent == pytest.approx(3e7, rel=1e-3)
