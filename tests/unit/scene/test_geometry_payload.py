"""If these failed, geometry would change on its way through the store, or a damaged atom would crash a node."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.scene.payloads.atom_cuts import cut_atom, joined_atom
from scenefold.scene.payloads.geometry import (
    HAS_COLORS,
    HAS_TANGENTS,
    HAS_UVS2,
    atom_bytes,
    decode_atom,
    decode_normals,
    encode_atom,
    encode_normals,
    encode_packed,
)
from scenefold.scene.payloads.vertex_attributes import ATTRIBUTE_FLAGS, VertexAttributes, decode_colors, encode_colors, encode_tangents


def atom_parts(seed: int, vertices: int, triangles: int, normals: bool, uvs: bool, materials: int):  # type: ignore[no-untyped-def]
    dice = np.random.default_rng(seed)
    return (
        dice.normal(size=(vertices, 3)).astype(np.float32),
        encode_normals(dice.normal(size=(vertices, 3))) if normals else None,
        dice.random((vertices, 2), np.float32) if uvs else None,
        dice.integers(0, vertices, (triangles, 3)).astype(np.uint32),
        dice.integers(0, materials, triangles).astype(np.uint16),
    )


@given(st.integers(0, 2**32 - 1), st.integers(3, 900), st.integers(1, 1000), st.booleans(), st.booleans(), st.integers(1, 3))
@settings(max_examples=40, deadline=None)
def test_an_atom_comes_back_as_it_went(seed: int, vertices: int, triangles: int, normals: bool, uvs: bool, materials: int) -> None:
    parts = atom_parts(seed, vertices, triangles, normals, uvs, materials)
    payload = encode_atom(7, 9, *parts)
    one = bool((parts[4] == parts[4][0]).all())
    atom = decode_atom(payload)
    assert len(payload) == atom_bytes(vertices, triangles, flags=atom.flags, one_material=one)
    assert (atom.prototype, atom.group) == (7, 9)
    assert np.array_equal(atom.positions, parts[0]) and atom.positions.dtype == np.float32
    assert np.array_equal(atom.triangles, parts[3]) and atom.triangles.dtype == np.uint32
    assert np.array_equal(atom.materials, parts[4]) and atom.materials.dtype == np.uint16
    assert (atom.normals is None) == (not normals) and (atom.uvs is None) == (not uvs)
    if parts[1] is not None and atom.normals is not None:
        assert np.array_equal(atom.normals, decode_normals(parts[1]))
    assert not any(array.flags.writeable for array in (atom.positions, atom.triangles, atom.materials))


def attributes_of(seed: int, vertices: int, flags: int) -> VertexAttributes:
    dice = np.random.default_rng(seed)
    found = {
        "normals": encode_normals(dice.normal(size=(vertices, 3))),
        "uvs": dice.normal(size=(vertices, 2)).astype(np.float32),
        "uvs2": dice.normal(size=(vertices, 2)).astype(np.float32),
        "colors": dice.integers(0, 65_536, (vertices, 4)).astype(np.uint16),
        "tangents": encode_tangents(dice.normal(size=(vertices, 4))),
    }
    wanted = VertexAttributes.empty(flags, 1).arrays()
    return VertexAttributes(**{name: found[name] for name in wanted})  # type: ignore[arg-type]


attribute_flags = st.integers(0, ATTRIBUTE_FLAGS).map(lambda flags: flags & ATTRIBUTE_FLAGS)


@given(st.integers(0, 2**32 - 1), st.integers(3, 400), st.integers(2, 400), attribute_flags, st.integers(2, 9))
@settings(max_examples=60, deadline=None)
def test_all_attributes_come_back_and_bear_being_cut(seed: int, vertices: int, triangles: int, flags: int, count: int) -> None:
    positions, _, _, corners, materials = atom_parts(seed, vertices, triangles, False, False, 2)
    packed = attributes_of(seed, vertices, flags)
    payload = encode_packed(7, 9, positions, packed, corners, materials)
    atom = decode_atom(payload)
    assert atom.flags == flags == packed.flags
    assert payload[4] == (2 if flags & (HAS_UVS2 | HAS_COLORS | HAS_TANGENTS) else 1)
    one = bool((materials == materials[0]).all())
    assert len(payload) == atom_bytes(vertices, triangles, flags=flags, one_material=one)
    for name in ("uvs", "uvs2"):
        assert packed.arrays().get(name) is None or np.array_equal(getattr(atom, name), getattr(packed, name))
    if atom.colors is not None and packed.colors is not None:
        assert np.array_equal(encode_colors(atom.colors), packed.colors) and float(atom.colors.max()) <= 1
    if atom.tangents is not None and packed.tangents is not None:
        assert np.array_equal(atom.tangents[:, 3], packed.tangents[:, 2])
        assert np.array_equal(atom.tangents[:, :3], decode_normals(packed.tangents[:, :2]))
    assert joined_atom(cut_atom(payload, min(count, triangles))) == payload


def test_black_and_white_are_exact() -> None:
    assert decode_colors(encode_colors(np.array([[0.0, 1.0, 0.5, 1.0]])))[0].tolist() == pytest.approx([0, 1, 0.5, 1], abs=1e-5)
    assert decode_colors(np.array([[0, 65_535, 0, 65_535]], np.uint16))[0].tolist() == [0, 1, 0, 1]


def test_version_1_has_no_attributes_of_version_2() -> None:
    positions, _, _, corners, materials = atom_parts(1, 9, 9, False, False, 1)
    payload = bytearray(encode_packed(0, 0, positions, attributes_of(1, 9, HAS_COLORS), corners, materials))
    payload[4] = 1
    with pytest.raises(DamagedData, match="unknown flags"):
        decode_atom(bytes(payload))
    payload[4] = 3
    with pytest.raises(DamagedData, match="unknown version 3"):
        decode_atom(bytes(payload))


def test_a_tangent_of_no_side_is_damaged_data() -> None:
    positions, _, _, corners, materials = atom_parts(1, 9, 9, False, False, 1)
    packed = attributes_of(1, 9, HAS_TANGENTS)
    assert packed.tangents is not None
    packed.tangents[4, 2] = 0
    with pytest.raises(DamagedData, match="no side"):
        decode_atom(encode_packed(0, 0, positions, packed, corners, materials))


def test_normals_lose_less_than_five_thousandths_of_a_degree() -> None:
    vectors = np.random.default_rng(3).normal(size=(20_000, 3))
    axes = np.vstack([np.eye(3), -np.eye(3), vectors])
    unit = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    back = decode_normals(encode_normals(axes)).astype(np.float64)
    assert np.degrees(np.linalg.norm(np.cross(unit, back), axis=1)).max() < 0.005
    assert (unit * back).sum(axis=1).min() > 0.99
    assert np.array_equal(back[:6], axes[:6])


@given(st.binary(max_size=200))
def test_noise_is_damaged_data(noise: bytes) -> None:
    with pytest.raises(DamagedData):
        decode_atom(noise)


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_a_changed_atom_decodes_within_bounds_or_is_damaged_data(data: st.DataObject) -> None:
    positions, _, _, corners, materials = atom_parts(5, 12, 20, False, False, 2)
    payload = bytearray(encode_packed(1, 2, positions, attributes_of(5, 12, data.draw(attribute_flags)), corners, materials))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    damaged = bytes(payload[: data.draw(st.integers(0, len(payload)))]) if data.draw(st.booleans()) else bytes(payload)
    try:
        atom = decode_atom(damaged)
    except DamagedData:
        return
    assert atom.triangles.max() < len(atom.positions)
    assert np.isfinite(atom.positions).all() and (atom.uvs is None or np.isfinite(atom.uvs).all())
    assert atom.normals is None or np.isfinite(atom.normals).all()
    assert atom.tangents is None or np.isfinite(atom.tangents).all()


def test_a_claim_of_four_billion_vertices_is_refused_before_memory_is_asked_for() -> None:
    payload = bytearray(encode_atom(1, 2, *atom_parts(5, 12, 20, False, False, 1)))
    payload[16:20] = b"\xff" * 4
    with pytest.raises(DamagedData, match="cut short"):
        decode_atom(bytes(payload))
    with pytest.raises(DamagedData, match="larger"):
        decode_atom(bytes(PAYLOAD_BYTES_MAX + 1))
