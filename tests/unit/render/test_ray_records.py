"""If this fails, nodes of different make read one another's rays wrongly: the 36 bytes of specs/07-rays.md moved."""

from __future__ import annotations

import json

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from house.sources import ROOT
from scenefold.base.rays import KIND_BOUNCE, KIND_CAMERA, KIND_SHADOW, PATH_RAY, PDF_DELTA, RAY_BYTES, RAY_WORDS, SHADOW_RAY
from unit.render import probe_kernels as probe

VECTORS = json.loads((ROOT / "specs" / "vectors" / "rays.json").read_text(encoding="utf-8"))

u8, u16, u32, u48 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 48))
places = st.tuples(*[st.floats(-1e6, 1e6, width=32)] * 3)
kinds, bounces = st.sampled_from([KIND_CAMERA, KIND_BOUNCE, KIND_SHADOW]), st.integers(0, 31)


def record() -> np.ndarray[tuple[int, int], np.dtype[np.uint32]]:
    """A row full of ones, so that what is not written shows."""
    return np.full((3, RAY_WORDS), 0xFFFFFFFF, np.uint32)


def color_of(field: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> int:
    return int.from_bytes(field.tobytes(), "little")


@given(places, st.tuples(u32, u32), u16, u48, u16, kinds, bounces, u16)
def test_path_rays(origin, codes, pdf, color, path, kind, bounce, step) -> None:  # type: ignore[no-untyped-def]
    rays = record()
    probe.write_path(rays, 1, np.float32(origin), np.uint32(codes), pdf, np.uint64(color), path, kind, bounce, step)
    ray = rays[1:2].view(PATH_RAY)[0, 0]
    assert ray["origin"].tolist() == list(origin)
    assert ray["direction"].tolist() == list(codes)
    assert (ray["pdf"], ray["time"], ray["flags"], ray["path"], ray["medium"], ray["t_done"]) == (pdf, 0, 0, path, 0, step)
    assert color_of(ray["throughput"]) == color
    assert (int(ray["kind"]) >> 3, int(ray["kind"]) & 7) == (bounce, kind)
    assert probe.read_fields(rays, 1)[:6] == (kind, bounce, step, path, color, pdf)
    assert (rays[[0, 2]] == 0xFFFFFFFF).all()


@given(places, places, u48, u16, bounces, u16)
def test_shadow_rays(origin, end, color, path, bounce, step) -> None:  # type: ignore[no-untyped-def]
    rays = record()
    probe.write_shadow(rays, 1, np.float32(origin), np.float32(end), np.uint64(color), path, KIND_SHADOW, bounce, step)
    ray = rays[1:2].view(SHADOW_RAY)[0, 0]
    assert ray["origin"].tolist() == list(origin)
    assert ray["end"].tolist() == list(end)
    assert (ray["path"], ray["medium"], ray["t_done"]) == (path, 0, step)
    assert color_of(ray["contribution"]) == color
    fields = probe.read_fields(rays, 1)
    assert fields[:5] == (KIND_SHADOW, bounce, step, path, color)
    assert fields[6:] == (origin, end)


def test_golden_rays() -> None:
    for vector in VECTORS["rays"]:
        raw, fields = bytes.fromhex(vector["bytes"]), vector["fields"]
        assert len(raw) == RAY_BYTES
        ray = np.frombuffer(raw, SHADOW_RAY if vector["kind"] == "shadow" else PATH_RAY)[0]
        for name, value in fields.items():
            found = ray[name]
            assert (color_of(found) if name in ("throughput", "contribution") else found.tolist()) == value, name
        rays = np.zeros((1, RAY_WORDS), np.uint32)
        if vector["kind"] == "shadow":
            arguments = (np.float32(fields["origin"]), np.float32(fields["end"]), np.uint64(fields["contribution"]))
            probe.write_shadow(rays, 0, *arguments, fields["path"], fields["kind"] & 7, fields["kind"] >> 3, fields["t_done"])
        else:
            directions = (np.float32(fields["origin"]), np.uint32(fields["direction"]), fields["pdf"], np.uint64(fields["throughput"]))
            probe.write_path(rays, 0, *directions, fields["path"], fields["kind"] & 7, fields["kind"] >> 3, fields["t_done"])
        assert rays.tobytes() == raw


def test_golden_codes() -> None:
    for vector in VECTORS["directions"]:
        codes = np.array([vector["code"]], np.uint32)
        assert np.array_equal(probe.directions(codes)[0], [float.fromhex(value) for value in vector["unit"]])
        if "vector" in vector:
            assert probe.direction_codes(np.array([vector["vector"]], np.float64)).tolist() == codes.tolist()
    for vector in VECTORS["colors"]:
        keys = np.array([int(vector["key"], 16)], np.uint64)
        assert int(probe.color_codes(np.array([vector["color"]], np.float64), keys)[0]) == vector["code"]
        assert probe.colors(np.array([vector["code"]], np.uint64))[0].tolist() == [float.fromhex(value) for value in vector["decoded"]]
    for vector in VECTORS["densities"]:
        assert probe.pdf_codes(np.array([vector["density"]])).tolist() == [vector["code"]]
        assert probe.pdfs(np.array([vector["code"]])).tolist() == [float.fromhex(vector["decoded"])]
    for vector in VECTORS["uniforms"]:
        keys = probe.path_keys(vector["seed"], vector["frame"], np.array([vector["pixel"]]), np.array([vector["sample"]]))
        assert int(keys[0]) == int(vector["key"], 16)
        assert probe.uniforms(keys, vector["bounce"], vector["dimension"])[0] == float.fromhex(vector["value"])


def test_the_record_of_table_3_3_carries_less() -> None:
    """Thirty bytes: no path, no density, no certificate. Ours hold all that they hold, but for colour's form."""
    table = VECTORS["thesis_table_3_3"]
    assert sum(field["bytes"] for field in table["fields"]) == table["bytes"] == 30
    assert not {"path", "pdf", "t_done", "medium"} & {field["name"] for field in table["fields"]}
    assert {"path", "pdf", "t_done", "medium"} <= set(PATH_RAY.names or ())
    # Blue of 8:4:4 bits: four bits of mantissa cannot hold 13 bits' worth of a faint channel.
    assert table["missing"] == ["path in pass", "density of the direction", "medium", "t_done"]


def test_camera_rays_have_no_density() -> None:
    assert PDF_DELTA == 65_535 == max(range(65_536))
