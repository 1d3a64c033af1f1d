"""If this failed, two programs would talk different versions of the protocol on one connection, or give up without a word why."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.crypto import StrangeVersion, head_of
from scenefold.wire import PROTOCOL_VERSION
from scenefold.world.versions import NO_VERSION, TAKEN, Versions

VECTORS = json.loads((Path(__file__).resolve().parents[3] / "specs" / "vectors" / "heads.json").read_text(encoding="utf-8"))


@st.composite
def ranges(draw: st.DrawFn) -> Versions:
    lowest = draw(st.integers(1, 12))
    return Versions(lowest, lowest + draw(st.integers(0, 4)))


@given(ranges(), ranges())
def test_the_highest_common_version_is_found_from_both_sides(one: Versions, other: Versions) -> None:
    both = set(range(one.lowest, one.highest + 1)) & set(range(other.lowest, other.highest + 1))
    assert one.common(other) == other.common(one) == max(both, default=None)
    offered = [name for name in one.names if name in other.names]
    assert one.named(offered[0]) == one.common(other), "what the handshake chooses is that version"
    if not both:
        assert offered == [NO_VERSION]
        words = str(one.apart_from(other, "node:7"))
        assert f"node:7 takes {other}" in words and f"this program {one}" in words
        assert ("upgrade this program" in words) == (one.highest < other.lowest)


@given(ranges())
def test_a_range_is_read_as_it_was_sent(versions: Versions) -> None:
    assert Versions.unpack(versions.pack()) == versions


@given(st.binary(max_size=12))
def test_any_bytes_are_a_range_or_damaged(data: bytes) -> None:
    try:
        versions = Versions.unpack(data)
    except DamagedData:
        return
    assert versions.pack() == data and 1 <= versions.lowest <= versions.highest


def test_what_this_program_takes() -> None:
    assert TAKEN.highest == PROTOCOL_VERSION
    assert [TAKEN.named(name) for name in TAKEN.names] == [*range(TAKEN.highest, TAKEN.lowest - 1, -1), None]


@pytest.mark.parametrize("entry", VECTORS["names"])
def test_names_are_pinned(entry: dict[str, Any]) -> None:
    assert Versions(entry["lowest"], entry["highest"]).names == entry["offered"]


@pytest.mark.parametrize("entry", VECTORS["ranges"])
def test_ranges_are_pinned(entry: dict[str, Any]) -> None:
    assert Versions(entry["lowest"], entry["highest"]).pack().hex() == entry["bytes"]


@pytest.mark.parametrize("entry", VECTORS["agreed"])
def test_what_is_agreed_is_pinned(entry: dict[str, Any]) -> None:
    assert Versions(*entry["one"]).common(Versions(*entry["other"])) == entry["version"]


@pytest.mark.parametrize("entry", VECTORS["datagrams"])
def test_heads_of_datagrams_are_pinned(entry: dict[str, Any]) -> None:
    with pytest.raises(StrangeVersion, match=f"of version {entry['version']}, "):
        head_of(bytes.fromhex(entry["head"]) + bytes(200))
