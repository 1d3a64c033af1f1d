"""If this fails, living nodes are taken for dead, dead ones for living, or a replayed status counts as a sign of life."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.location import LAST
from scenefold.peer import Roster
from scenefold.peer.roster import ALIVE_CHANCE_MIN, PAST_INCARNATIONS_MAX
from scenefold.wire import MiniStatus, Status

ME, PEER, OTHER = (node_id_of(f"127.0.0.{last}") for last in (2, 3, 4))


def status_of(node: NodeId, lamport: int, incarnation: bytes = b"i" * 16) -> Status:
    return Status(lamport=lamport, node=node, incarnation=incarnation, boot=1, address=address_of(node), right_bound=LAST)


def mini_of(node: NodeId, lamport: int) -> MiniStatus:
    return MiniStatus(lamport, node, LAST, 0, 0, 0, 0, 0)


def a_roster(count: int = 3) -> Roster:
    return Roster(ME, [NodeId(ME + index) for index in range(count)])


def test_nobody_but_me_is_alive_before_they_are_heard() -> None:
    roster = a_roster()
    assert roster.alive() == [ME]
    assert roster.unheard() == [PEER, OTHER]
    assert roster.chance_alive(ME) == 1 and roster.chance_alive(PEER) == 0


def test_who_is_heard_is_alive() -> None:
    roster = a_roster()
    assert roster.hear(status_of(PEER, 1), now=5.0)
    assert roster.alive() == [ME, PEER]
    assert roster.heard_at(PEER) == 5.0 and roster.heard_at(OTHER) is None
    assert roster.statuses() == [status_of(PEER, 1)]


@given(st.lists(st.integers(0, 20)))
def test_only_a_rising_lamport_time_counts(lamports: list[int]) -> None:
    roster, highest = a_roster(), -1
    for now, lamport in enumerate(lamports):
        assert roster.hear(status_of(PEER, lamport), float(now)) == (lamport > highest)
        highest = max(highest, lamport)
    assert [status.lamport for status in roster.statuses()] == ([highest] if lamports else [])


@given(st.integers(2, 127), st.integers(0, 400))
def test_the_chance_falls_with_every_broadcast_without_the_peer(count: int, missed: int) -> None:
    roster = a_roster(count)
    roster.hear(status_of(PEER, 1), 0.0)
    for _ in range(missed):
        roster.count_broadcast([OTHER])
    assert roster.chance_alive(PEER) == pytest.approx(((count - 1) / count) ** missed)
    assert roster.is_believed_alive(PEER) == (roster.chance_alive(PEER) >= ALIVE_CHANCE_MIN)


def test_hearing_again_brings_a_peer_back() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    for _ in range(100):
        roster.count_broadcast([])
    assert not roster.is_believed_alive(PEER)
    roster.hear(status_of(PEER, 2), 1.0)
    assert roster.is_believed_alive(PEER)


def test_who_refuses_a_request_is_not_believed_alive_until_heard() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    roster.note_refusal(PEER)
    assert roster.alive() == [ME]
    roster.hear(status_of(PEER, 1), 1.0)
    assert roster.alive() == [ME], "an old status is no sign of life"
    roster.hear_mini(mini_of(PEER, 2), 2.0)
    assert roster.alive() == [ME, PEER]


def test_a_mini_status_keeps_a_peer_alive() -> None:
    roster = a_roster()
    roster.hear_mini(mini_of(PEER, 7), 1.0)
    assert roster.is_believed_alive(PEER)
    assert roster.rises(status_of(PEER, 3)), "its first whole status is news, whenever it comes"


def test_a_node_made_anew_is_taken_and_its_past_never_again() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1000, b"a" * 16), 0.0)
    assert roster.hear(status_of(PEER, 1, b"b" * 16), 1.0)
    assert not roster.hear(status_of(PEER, 2000, b"a" * 16), 2.0)
    assert roster.hear(status_of(PEER, 2, b"b" * 16), 3.0)


def test_a_relayed_past_does_not_depose_who_is_alive() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1, b"b" * 16), 0.0)
    assert not roster.hear(status_of(PEER, 2000, b"a" * 16), 1.0, relayed=True)
    assert roster.hear(status_of(PEER, 2, b"b" * 16), 2.0)
    for _ in range(100):
        roster.count_broadcast([])
    assert roster.hear(status_of(PEER, 1, b"c" * 16), 3.0, relayed=True), "the one that we knew has fallen silent"


def test_the_past_is_bounded() -> None:
    roster = a_roster()
    for index in range(PAST_INCARNATIONS_MAX + 10):
        roster.hear(status_of(PEER, 1, index.to_bytes(16, "big")), 0.0)
    assert not roster.hear(status_of(PEER, 9, (PAST_INCARNATIONS_MAX + 8).to_bytes(16, "big")), 0.0)


def test_strangers_and_my_own_echo_do_not_count() -> None:
    roster = a_roster()
    assert not roster.hear(status_of(node_id_of("10.0.0.1"), 5), 0.0)
    assert not roster.hear(status_of(ME, 5), 0.0)
    assert roster.statuses() == []


@given(st.integers(2, 40), st.integers(0, 2000))
def test_pages_go_round_the_whole_table(count: int, room: int) -> None:
    roster = a_roster(count)
    for index in range(1, count):
        roster.hear(status_of(NodeId(ME + index), 1), 0.0)
    size = 100
    seen: list[NodeId] = []
    for _ in range(count):
        page = roster.page(room, lambda _status: size)
        assert len(page) == min(room // size, count - 1)
        seen += [status.node for status in page]
    expected = [NodeId(ME + 1 + index % (count - 1)) for index in range(len(seen))]
    assert seen == expected


def test_a_page_shows_what_is_newest() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    newer = replace(status_of(PEER, 2), rays_per_second=9)
    roster.hear(newer, 1.0)
    assert roster.page(1000, lambda _status: 100) == [newer]
