"""If this fails, nodes of an adaptive render trace different pixels, or one packet makes a node reserve memory without end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from scenefold.base.errors import PeerFault
from scenefold.render.pool.levels import PIECE_BYTES, Gathered, pieces
from scenefold.wire import pack_value, unpack_value


def rows_of(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2, count, np.uint8)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 8 * PIECE_BYTES, 8 * PIECE_BYTES + 1, 20 * PIECE_BYTES])
def test_rows_arrive_as_they_were_told_level_by_level(count: int) -> None:
    gathered = Gathered(count, 3)
    for level in (1, 2):
        rows, told = rows_of(count, level), None
        for piece in pieces(level, rows):
            assert told is None
            told = gathered.take(unpack_value(pack_value(piece), what="a piece"))
        assert told is not None and (told == rows).all()


@pytest.mark.parametrize(
    "changed",
    [
        {"level": 0},
        {"level": 9},
        {"at": 1},
        {"at": None},
        {"last": False},
        {"last": 1},
        {"goes_on": b""},
        {"goes_on": bytes(9)},
    ],
)
def test_what_does_not_follow_is_refused(changed: dict[str, Any]) -> None:
    (piece,) = pieces(1, rows_of(30))
    gathered = Gathered(30, 3)
    with pytest.raises(PeerFault):
        gathered.take({**piece, **changed})
    assert gathered.take(piece) is not None
    with pytest.raises(PeerFault):
        gathered.take(piece)
    # A render that goes on from a kept film begins with whatever level that is of.
    assert gathered.take({**piece, "level": 2}) is not None


@given(some.sampled_from(["level", "at", "goes_on", "last"]), some.sampled_from([None, -1, 2**64 - 1, "", b"", [], True, 0.5]))
def test_odd_pieces_are_one_error(key: str, value: object) -> None:
    (piece,) = pieces(1, rows_of(30))
    if piece[key] is value:
        return
    with pytest.raises(PeerFault):
        Gathered(30, 3).take({**piece, key: value})
