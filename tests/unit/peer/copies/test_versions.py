"""If this fails, two nodes that compare order versions in another way than their stores do, or read each other's sums wrongly."""

from __future__ import annotations

import pytest

from scenefold.crypto import IllFormedRecord, version_key
from scenefold.peer.copies.versions import rank_of, told_sum, told_version
from scenefold.store.versions import SUM_MODULUS, RangeSum
from unit.peer.scenes_made import first_header, sealed


def test_versions_are_ordered_like_those_in_stores() -> None:
    header = first_header()
    for one, other in (({"seq": 1}, {"seq": 2}), ({"epoch": 9}, {"epoch": 1, "seq": 9}), ({"session": 1}, {"session": 2})):
        records = sealed(header, **one), sealed(header, **other)
        ranks = [rank_of(told_version(record.header_bytes)) for record in records]
        assert (ranks[0] < ranks[1]) == (version_key(records[0].header) < version_key(records[1].header))
        assert ranks[0] == version_key(records[0].header)


def test_what_is_no_header_is_no_version() -> None:
    with pytest.raises(IllFormedRecord):
        told_version(b"")


def test_a_sum_is_a_number_behind_zeros() -> None:
    assert told_sum(RangeSum(1, SUM_MODULUS - 1)) == bytes(16) + b"\xff" * 16
