"""If this fails, what lies in a space that was moved is written back at another place than it shows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.scene.log.affine import Affine
from scenefold.scene.payloads.carrying import carrier
from scenefold.scene.payloads.geometry import decode_atom, encode_atom
from unit.scene.test_geometry_payload import atom_parts

MOVED = Affine(2.0, (10.0, 0.0, -1.0))


@given(st.integers(0, 99), st.booleans(), st.booleans())
@settings(max_examples=20, deadline=None)
def test_an_atom_is_moved_and_nothing_else_of_it_changes(seed: int, normals: bool, uvs: bool) -> None:
    payload = encode_atom(0, 9, *atom_parts(seed, 30, 20, normals, uvs, 2))
    carried = carrier("atoms")(payload, MOVED)
    assert carried is not None
    before, after = decode_atom(payload), decode_atom(carried)
    np.testing.assert_array_equal(after.positions, (before.positions.astype(np.float64) * 2.0 + [10.0, 0.0, -1.0]).astype(np.float32))
    untouched = 24 + 12 * 30
    assert carried[:24] == payload[:24] and carried[untouched:] == payload[untouched:]


@pytest.mark.parametrize("kind, number", [("float32", "<f4"), ("float64", "<f8")])
def test_rows_are_moved(kind, number) -> None:  # type: ignore[no-untyped-def]
    rows = np.array([[1, 2, 3], [4, 5, 6]], number)
    carried = carrier(kind)(rows.tobytes(), MOVED)
    assert carried is not None
    assert np.frombuffer(carried, number).reshape(-1, 3).tolist() == [[12, 4, 5], [18, 10, 11]]
    assert carrier(kind)(b"", MOVED) == b""


def test_what_is_of_another_kind_is_left() -> None:
    atoms = carrier("atoms")
    prototype = encode_atom(1, 0, *atom_parts(1, 9, 3, False, False, 1))
    world = encode_atom(0, 0, *atom_parts(1, 9, 3, False, False, 1))
    for payload in (b"", b"a spark", prototype, world[:-1], world + b"x"):
        assert atoms(payload, MOVED) is None
    assert atoms(world, Affine(1.0, (1.0, 2.0))) is None, "a space of two dimensions"
    assert atoms(world, Affine(1.0, (1e30, 0.0, 0.0))) is None, "too far off to be a place"
    for kind in ("float32", "float64"):
        assert carrier(kind)(b"a spark", MOVED) is None  # type: ignore[arg-type]
    assert carrier("float32")(np.array([np.nan, 0, 0], "<f4").tobytes(), MOVED) is None
    assert carrier("float32")(np.array([1e38, 0, 0], "<f4").tobytes(), Affine(1e9, (0.0,) * 3)) is None
