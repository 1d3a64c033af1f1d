"""If this fails, nodes of different make read one another's rays wrongly: the 36 bytes of specs/07-rays.md moved."""

from __future__ import annotations

import json

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from house.sources import ROOT
from scenefold.base.rays import KIND_BOUNCE, KIND_CAMERA, KIND_SHADOW, PATH_RAY, PDF_DELTA, RAY_BYTES, RAY_WORDS, SHADOW_RAY
from scenefold.render.dice_kernels import SAMPLER_INDEPENDENT, SAMPLER_SOBOL
from scenefold.render.lanes_kernels import LANES
from scenefold.render.numbers import dice_seed
from unit.render import lanes_probe_kernels as lanes
from unit.render import probe_kernels as probe
from unit.render.test_light_kernels import job

VECTORS = json.loads((ROOT / "specs" / "vectors" / "rays.json").read_text(encoding="utf-8"))

u8, u16, u32, u48 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 48))
places = st.tuples(*[st.floats(-1e6, 1e6, width=32)] * 3)
kinds, bounces = st.sampled_from([KIND_CAMERA, KIND_BOUNCE, KIND_SHADOW]), st.integers(0, 31)


def color_of(field: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> int:
    return int.from_bytes(field.tobytes(), "little")


def lanes_of(*rows: object) -> lanes.U32:
    """uint32[n, LANES] of rows of one to LANES words."""
    return np.array([np.resize(np.asarray(row, np.uint32), LANES) for row in rows], np.uint32)


def written(
    origin: object, words: tuple[object, ...], color: int, path: int, kind: int, bounce: int, flags: list[bool]
) -> tuple[lanes.U32, int]:
    """A table full of ones, behind whose first ray what the flagged lanes hold was written."""
    rays = np.full((LANES + 2, RAY_WORDS), 0xFFFFFFFF, np.uint32)
    places_ = np.repeat(np.asarray(origin, np.float32)[:, None], LANES, axis=1)
    whole = lanes_of(*words, color & 0xFFFFFFFF, color >> 32, path)
    return rays, lanes.write(rays, 1, np.array(flags), places_, whole, kind, bounce)


FIRST = [True] + [False] * (LANES - 1)


@given(places, st.tuples(u32, u32), u16, u48, u16, kinds, bounces, u16)
def test_path_rays(origin, codes, pdf, color, path, kind, bounce, step) -> None:  # type: ignore[no-untyped-def]
    rays, made = written(origin, (*codes, pdf), color, path, kind, bounce, FIRST)
    assert made == 2
    probe.set_t_done(rays, 1, step)
    ray = rays[1:2].view(PATH_RAY)[0, 0]
    assert ray["origin"].tolist() == list(origin)
    assert ray["direction"].tolist() == list(codes)
    assert (ray["pdf"], ray["time"], ray["flags"], ray["path"], ray["medium"], ray["t_done"]) == (pdf, 0, 0, path, 0, step)
    assert color_of(ray["throughput"]) == color
    assert (int(ray["kind"]) >> 3, int(ray["kind"]) & 7) == (bounce, kind)
    assert probe.read_fields(rays, 1)[:4] == (kind, step, path, color)
    assert (rays[[0, *range(2, LANES + 2)]] == 0xFFFFFFFF).all()
    read = lanes.read(rays, np.ones(LANES, np.uint32))
    assert read[:3, 3].view(np.float32).tolist() == list(origin)
    assert read[3:, 3].tolist() == [*codes, pdf, color & 0xFFFFFFFF, color >> 32, path, kind, bounce]


@given(places, places, u48, u16, bounces, u16)
def test_shadow_rays(origin, end, color, path, bounce, step) -> None:  # type: ignore[no-untyped-def]
    rays, _ = written(origin, tuple(np.float32(end).view(np.uint32)), color, path, KIND_SHADOW, bounce, FIRST)
    probe.set_t_done(rays, 1, step)
    ray = rays[1:2].view(SHADOW_RAY)[0, 0]
    assert ray["origin"].tolist() == list(origin)
    assert ray["end"].tolist() == list(end)
    assert (ray["path"], ray["medium"], ray["t_done"]) == (path, 0, step)
    assert color_of(ray["contribution"]) == color
    fields = probe.read_fields(rays, 1)
    assert fields[:4] == (KIND_SHADOW, step, path, color)
    assert fields[4:] == (origin, end)


@given(st.lists(st.booleans(), min_size=LANES, max_size=LANES))
def test_only_what_is_flagged_is_written_in_the_order_of_lanes(flags) -> None:  # type: ignore[no-untyped-def]
    rays, made = written((1.0, 2.0, 3.0), (np.arange(LANES), 0, 0), 7, 9, KIND_BOUNCE, 1, flags)
    assert rays[1:made, 3].tolist() == [lane for lane, flag in enumerate(flags) if flag]
    assert (rays[made:] == 0xFFFFFFFF).all()


@given(u48, u16, st.integers(0, 7))
def test_channels_are_taken_away(color, path, channels) -> None:  # type: ignore[no-untyped-def]
    rays, _ = written((0.0, 0.0, 0.0), (0, 0, 0), color, path, KIND_SHADOW, 0, FIRST)
    left = probe.keep_channels(rays, 1, channels)
    mantissas = [color >> 13 * channel & 8191 if channels >> channel & 1 else 0 for channel in range(3)]
    assert left == any(mantissas)
    assert probe.read_fields(rays, 1)[2:4] == (path, mantissas[0] | mantissas[1] << 13 | mantissas[2] << 26 | color >> 39 << 39)


def test_golden_rays() -> None:
    for vector in VECTORS["rays"]:
        raw, fields = bytes.fromhex(vector["bytes"]), vector["fields"]
        assert len(raw) == RAY_BYTES
        ray = np.frombuffer(raw, SHADOW_RAY if vector["kind"] == "shadow" else PATH_RAY)[0]
        for name, value in fields.items():
            found = ray[name]
            assert (color_of(found) if name in ("throughput", "contribution") else found.tolist()) == value, name
        if vector["kind"] == "shadow":
            words, color = tuple(np.float32(fields["end"]).view(np.uint32)), fields["contribution"]
        else:
            words, color = (*fields["direction"], fields["pdf"]), fields["throughput"]
        rays, _ = written(fields["origin"], words, color, fields["path"], fields["kind"] & 7, fields["kind"] >> 3, FIRST)
        probe.set_t_done(rays, 1, fields["t_done"])
        assert rays[1].tobytes() == raw


def test_golden_codes() -> None:
    for vector in VECTORS["directions"]:
        codes = np.array(vector["code"], np.uint32)[:, None]
        units = lanes.reals_of(lanes.probed("from_direction_code", word_columns=tuple(codes))[:3, 0])
        assert units.tolist() == [float.fromhex(value) for value in vector["unit"]]
        if "vector" in vector:
            assert lanes.probed("to_direction_code", *np.array(vector["vector"])[:, None])[:2, 0].tolist() == vector["code"]
    for vector in VECTORS["colors"]:
        low, high = lanes.probed("to_color_code", *np.array(vector["color"])[:, None], word_columns=([vector["dice"]],))[:2]
        assert int(low[0]) | int(high[0]) << 32 == vector["code"]
        decoded = lanes.reals_of(lanes.probed("from_color_code", word_columns=(low, high))[:3, 0])
        assert decoded.tolist() == [float.fromhex(value) for value in vector["decoded"]]
    for vector in VECTORS["densities"]:
        assert lanes.probed("to_pdf_code", [vector["density"]])[0].tolist() == [vector["code"]]
        decoded = lanes.reals_of(lanes.probed("from_pdf_code", word_columns=([vector["code"]],))[0])
        assert decoded.tolist() == [float.fromhex(vector["decoded"])]


def test_golden_draws() -> None:
    for vector in VECTORS["draws"]:
        whole = dice_seed(vector["seed"], vector["frame"])
        assert (whole & 0xFFFFFFFF, whole >> 32) == (vector["dice_low"], vector["dice_high"])
        keys = probe.path_keys(vector["seed"], vector["frame"], np.array([vector["pixel"]]), np.array([vector["sample"]]))
        assert int(keys[0]) == int(vector["key"], 16)
        for name, sampler in (("sobol", SAMPLER_SOBOL), ("independent", SAMPLER_INDEPENDENT)):
            numbers = job(1.0, 0.0, 0.0)._replace(sampler=sampler, dice_low=vector["dice_low"], dice_high=vector["dice_high"])
            pixels = np.full(LANES, vector["pixel"])
            found = lanes.rolled(numbers, pixels, vector["sample"], vector["bounce"], vector["pair"])
            assert found[0].tolist() == [float.fromhex(value) for value in vector[name]]


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
