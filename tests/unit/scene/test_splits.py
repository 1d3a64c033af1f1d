"""If these failed, a record that is split would come back as another one, or what somebody made up would crash who reads it."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from house.sources import ROOT
from scenefold.base.errors import DamagedData
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.base.location import Location
from scenefold.client.tombstones import MARK
from scenefold.scene.payloads.atom_cuts import cut_atom, joined_atom, middle_of_piece
from scenefold.scene.payloads.geometry import decode_atom, encode_atom
from scenefold.scene.payloads.splits import (
    PART_MARK,
    PARTS_MAX,
    SPLIT_MARK,
    Cut,
    MissingPart,
    Part,
    SplitEntry,
    contents_of,
    decode_entry,
    decode_part,
    encode_entry,
    encode_part,
    is_part,
    is_split,
    whole_of,
)
from unit.scene.test_geometry_payload import atom_parts

AT = Location.from_number(77)
VERSION = (3, 2**63, 2**31, 2**64 - 1, b"d" * 32)


def parts_of(whole: bytes, cut: Cut, count: int) -> list[bytes]:
    contents = contents_of(whole, cut, count)
    return [encode_part(Part(cut, number, count, AT, bytes(32), VERSION, content)) for number, content in enumerate(contents)]


def places(count: int) -> list[Location]:
    return [Location.from_number(1000 + number) for number in range(count)]


def split_up(whole: bytes, cut: Cut, count: int) -> tuple[SplitEntry, list[bytes]]:
    parts = parts_of(whole, cut, count)
    return decode_entry(encode_entry(SplitEntry.of(cut, whole, places(count), parts))), parts


@given(st.binary(min_size=2, max_size=3000), st.data())
def test_bytes_come_back_as_they_went(whole: bytes, data: st.DataObject) -> None:
    count = data.draw(st.integers(2, min(PARTS_MAX, len(whole))))
    entry, parts = split_up(whole, Cut.BYTES, count)
    assert whole_of(entry, AT, parts) == whole
    assert b"".join(decode_part(part).payload_alone for part in parts) == whole
    assert all(map(is_part, parts)) and not any(map(is_split, parts))
    assert {len(decode_part(part).content) - len(whole) // count for part in parts} <= {0, 1}, "cut evenly"


@given(
    st.integers(0, 2**32 - 1),
    st.integers(3, 900),
    st.integers(2, 1000),
    st.booleans(),
    st.booleans(),
    st.integers(1, 3),
    st.integers(2, 40),
)
@settings(max_examples=60, deadline=None)
def test_an_atom_comes_back_bit_for_bit(
    seed: int, vertices: int, triangles: int, normals: bool, uvs: bool, materials: int, count: int
) -> None:
    assume(triangles >= count)
    whole = encode_atom(7, 9, *atom_parts(seed, vertices, triangles, normals, uvs, materials))
    entry, parts = split_up(whole, Cut.TRIANGLES, count)
    assert whole_of(entry, AT, parts) == whole
    atom, pieces = decode_atom(whole), [decode_atom(decode_part(part).payload_alone) for part in parts]
    corners = np.concatenate([piece.positions[piece.triangles] for piece in pieces])
    assert np.array_equal(corners, atom.positions[atom.triangles]), "each by itself shows its triangles, in their order"
    assert np.array_equal(np.concatenate([piece.materials for piece in pieces]), atom.materials)


def test_a_triangle_lies_in_one_part_and_parts_lie_where_their_triangles_are() -> None:
    positions = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [10, 0, 0], [12, 0, 0], [10, 2, 4], [50, 50, 50]], np.float32)
    triangles = np.array([[0, 1, 2], [3, 4, 5]], np.uint32)
    whole = encode_atom(3, 0, positions, None, None, triangles, np.array([1, 2], np.uint16))
    near, far = map(middle_of_piece, cut_atom(whole, 2))
    assert (near[0], near[1].tolist()) == (3, [1, 1, 0]), "a vertex of no triangle draws nothing away"
    assert (far[0], far[1].tolist()) == (3, [11, 1, 2])
    assert joined_atom(cut_atom(whole, 2)) == whole


def test_marks_differ() -> None:
    marks = {MARK, SPLIT_MARK, PART_MARK}
    assert len(marks) == 3 and {len(mark) for mark in marks} == {16}


@pytest.mark.parametrize("count", [2, 3, PARTS_MAX])
def test_a_part_that_is_missing_or_another_is_told(count: int) -> None:
    whole = bytes(range(256)) * 2
    entry, parts = split_up(whole, Cut.BYTES, count)
    for number in (0, count - 1):
        with pytest.raises(MissingPart, match=f"part {number} of {count} .*is not there"):
            whole_of(entry, AT, [None if index == number else part for index, part in enumerate(parts)])
        with pytest.raises(MissingPart, match=f"part {number} of {count} .*was replaced"):
            whole_of(entry, AT, [b"else" if index == number else part for index, part in enumerate(parts)])
    with pytest.raises(MissingPart):
        whole_of(entry, AT, [*parts[1:], parts[0]])
    with pytest.raises(DamagedData, match="another record"):
        whole_of(entry, Location.from_number(5), parts)


def test_what_fits_together_and_is_not_what_was_split_is_damaged() -> None:
    entry, parts = split_up(b"abcdef", Cut.BYTES, 2)
    for lie in (replace(entry, digest=bytes(32)), replace(entry, length=7)):
        with pytest.raises(DamagedData, match="another payload"):
            whole_of(lie, AT, parts)
    crossed = replace(entry, cut=Cut.TRIANGLES)
    with pytest.raises(DamagedData):
        whole_of(crossed, AT, parts)


def test_pieces_of_two_atoms_make_none() -> None:
    one, other = (encode_atom(0, group, *atom_parts(group, 30, 20, True, False, 2)) for group in (1, 2))
    with pytest.raises(DamagedData, match="several atoms"):
        joined_atom([cut_atom(one, 2)[0], cut_atom(other, 2)[1]])
    with pytest.raises(DamagedData, match="leave out"):
        joined_atom(cut_atom(one, 2)[:1])


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_a_flipped_bit_is_damaged_data_or_changes_nothing_that_is_read(data: st.DataObject) -> None:
    whole = encode_atom(0, 1, *atom_parts(5, 12, 8, True, True, 2))
    entry, parts = split_up(whole, Cut.TRIANGLES, 2)
    spoilt = bytearray(data.draw(st.sampled_from([encode_entry(entry), *parts])))
    bit = data.draw(st.integers(0, 8 * len(spoilt) - 1))
    spoilt[bit // 8] ^= 1 << bit % 8
    with suppress(DamagedData):
        if is_split(bytes(spoilt)):
            assert whole_of(decode_entry(bytes(spoilt)), AT, parts) == whole
        elif is_part(bytes(spoilt)):
            decode_atom(decode_part(bytes(spoilt)).payload_alone)


@given(st.binary(max_size=400))
def test_noise_behind_a_mark_is_damaged_data(noise: bytes) -> None:
    with pytest.raises(DamagedData):
        decode_entry(SPLIT_MARK + b"\x07" + noise)
    with pytest.raises(DamagedData):
        decode_part(PART_MARK + b"\x07" + noise)
    with pytest.raises(DamagedData):
        joined_atom([noise, noise])


@pytest.mark.parametrize("count", [0, 1, PARTS_MAX + 1, 65_535])
def test_other_numbers_of_parts_are_refused(count: int) -> None:
    entry = SplitEntry(Cut.BYTES, 10, bytes(32), split_up(b"ab" * PARTS_MAX, Cut.BYTES, 2)[0].parts[:1] * count)
    with pytest.raises(DamagedData):
        decode_entry(encode_entry(entry))


def test_entries_of_other_lengths_are_refused() -> None:
    whole = bytes(PAYLOAD_BYTES_MAX)
    payload = encode_entry(split_up(whole, Cut.BYTES, PARTS_MAX)[0])
    for cut in (payload[:-1], payload + b"x", payload[:20], payload[:16]):
        with pytest.raises(DamagedData):
            decode_entry(cut)
    too_long = replace(split_up(b"ab", Cut.BYTES, 2)[0], length=PAYLOAD_BYTES_MAX + 1)
    with pytest.raises(DamagedData, match="more than a record holds"):
        decode_entry(encode_entry(too_long))


def test_vertices_that_are_numbered_wrong_are_damaged() -> None:
    whole = encode_atom(0, 1, *atom_parts(5, 12, 8, False, False, 1))
    first, second = cut_atom(whole, 2)
    count = int.from_bytes(first[2:4], "big")
    numbers = [int.from_bytes(first[4 + 2 * index : 6 + 2 * index], "big") for index in range(count)]
    assert all(one < other for one, other in pairwise(numbers))

    def with_numbers(changed: list[int]) -> bytes:
        return first[:4] + b"".join(number.to_bytes(2, "big") for number in changed) + first[4 + 2 * count :]

    for wrong in ([*numbers[:-1], 12], [numbers[0], numbers[0], *numbers[2:]], numbers[::-1]):
        with pytest.raises(DamagedData, match="number their vertices"):
            joined_atom([with_numbers(wrong), second])


@pytest.mark.parametrize(
    "golden", json.loads((ROOT / "specs" / "vectors" / "splits.json").read_text(encoding="utf-8")), ids=lambda one: one["cut"]
)
def test_golden_bytes(golden: dict) -> None:  # type: ignore[type-arg]
    whole, parts = bytes.fromhex(golden["whole"]), list(map(bytes.fromhex, golden["parts"]))
    entry = decode_entry(bytes.fromhex(golden["entry"]))
    assert whole_of(entry, AT, parts) == whole
    assert (entry.cut.name.lower(), entry.length, encode_entry(entry)) == (golden["cut"], len(whole), bytes.fromhex(golden["entry"]))
    assert (parts_of(whole, entry.cut, len(parts)), [named.location for named in entry.parts]) == (parts, places(len(parts)))
