"""If this fails, two histories of one log go unnoticed, or one history is taken for two."""

from __future__ import annotations

import hashlib
import random

from hypothesis import given
from hypothesis import strategies as st

from scenefold.simulation import laws
from scenefold.simulation.log_agreement import Agreement, Entry
from scenefold.simulation.log_history import Wrong


def log_of(length: int, start: str = "") -> list[Entry]:
    """A chain, in which each value has a request of its own."""
    entries, previous = list[Entry](), b""
    for position in range(1, length + 1):
        digest = hashlib.sha256(f"{start}{position}".encode()).digest()
        entries.append(Entry(position, digest, hashlib.sha256(b"request" + digest).digest()[:16], previous))
        previous = digest
    return entries


def broken(wrong: list[Wrong]) -> list[str]:
    return [one.law for one in wrong]


@given(st.integers(0, 30), st.integers(1, 7), st.randoms(use_true_random=False))
def test_one_log_on_all_disks_passes_however_late_they_come_to_it(length: int, nodes: int, dice: random.Random) -> None:
    entries, agreement, known = log_of(length), Agreement(), dict.fromkeys(range(nodes), 0)
    while min(known.values()) < length:
        node = dice.choice([node for node, end in known.items() if end < length])
        assert agreement.shown(f"n{node}", entries[known[node]]) == []
        known[node] += 1
        assert agreement.extends(f"n{node}", known[node]) == []
    assert agreement.newest == length and len(agreement.at) == length


@given(st.integers(1, 20), st.data())
def test_another_value_at_any_position_is_noticed(length: int, data: st.DataObject) -> None:
    agreement = Agreement()
    for entry in log_of(length):
        agreement.shown("n0", entry)
    at = data.draw(st.integers(0, length - 1))
    assert broken(agreement.shown("n1", log_of(length, "other")[at])) == [laws.ONE_VALUE]


@given(st.integers(2, 20), st.data())
def test_a_value_that_follows_another_one_is_noticed_whichever_is_seen_first(length: int, data: st.DataObject) -> None:
    entries = log_of(length)
    at = data.draw(st.integers(1, length - 1))
    stranger = Entry(at, b"o" * 32, b"", b"")
    behind, before = Agreement(), Agreement()
    behind.shown("n0", stranger)
    assert broken(behind.shown("n1", entries[at])) == [laws.ONE_VALUE]
    before.shown("n0", entries[at])
    assert broken(before.shown("n1", stranger)) == [laws.ONE_VALUE]


def test_a_request_at_two_positions_is_noticed() -> None:
    one, two = log_of(2)
    agreement = Agreement()
    assert agreement.shown("n0", one) == []
    assert broken(agreement.shown("n0", two._replace(request=one.request))) == [laws.ONCE]
    assert broken(agreement.requested(one.request, 2)) == [laws.ONCE] and agreement.requested(one.request, 1) == []


def test_a_disk_keeps_what_it_has() -> None:
    agreement = Agreement()
    assert agreement.holds("n0", 5) == [] == agreement.holds("n0", 5)
    assert broken(agreement.holds("n0", 4)) == [laws.ENTRIES_STAY]
    assert agreement.holds("n1", 1) == []


def test_a_disk_goes_on_where_it_ended() -> None:
    agreement = Agreement()
    assert [agreement.extends("n0", position) for position in (7, 8, 7, 8, 9)] == [[]] * 5
    assert broken(agreement.extends("n0", 11)) == [laws.ONE_VALUE]
    assert agreement.extends("n0", 13, shown=12) == []
    assert broken(agreement.extends("n0", 16, shown=14)) == [laws.ONE_VALUE]


def test_nothing_is_acknowledged_that_is_decided_nowhere() -> None:
    agreement = Agreement()
    (entry,) = log_of(1)
    assert broken(agreement.acknowledged(entry.request, 1)) == [laws.ENTRIES_STAY]
    agreement.shown("n0", entry)
    assert agreement.acknowledged(entry.request, 1) == []
    assert broken(agreement.acknowledged(entry.request, 2)) == [laws.ENTRIES_STAY]
