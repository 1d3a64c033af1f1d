"""If this fails, living nodes are taken for dead, dead ones for living, or a replayed or unregistered status counts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.peer.membership.odds import ALIVE_CHANCE_MIN, broadcasts_missed_max, chance_alive
from scenefold.peer.membership.roster import Roster
from scenefold.wire import MiniStatus, Status

ME, PEER, OTHER = (node_id_of(f"127.0.0.{last}") for last in (2, 3, 4))
OLD, NEW = b"i" * 16, b"j" * 16
HALF = Location.from_number(1 << 159)
QUARTER = Location.from_number(1 << 158)


@dataclass(frozen=True)
class Known:
    incarnation: bytes


@dataclass(frozen=True)
class Line:
    """A registry as the roster sees it."""

    nodes: dict[NodeId, bytes | None]
    position: int = 1

    @property
    def order(self) -> tuple[NodeId, ...]:
        return tuple(self.nodes)

    def current(self, node: NodeId) -> Known | None:
        incarnation = self.nodes.get(node)
        return None if incarnation is None else Known(incarnation)


@dataclass
class Told:
    """What the cluster's log was told."""

    positions: list[tuple[NodeId, int]] = field(default_factory=list)

    def __call__(self, node: NodeId, position: int) -> None:
        self.positions.append((node, position))


def status_of(node: NodeId, lamport: int, incarnation: bytes = OLD) -> Status:
    return Status(lamport=lamport, node=node, incarnation=incarnation, boot=1, address=address_of(node), right_bound=LAST)


def mini_of(node: NodeId, lamport: int, right_bound: Location | None = LAST, log_position: int = 0) -> MiniStatus:
    return MiniStatus(lamport, node, right_bound, 0, 0, 0, 0, 0, log_position)


def a_roster(count: int = 3) -> Roster:
    roster = Roster(ME)
    roster.set_members(Line({NodeId(ME + index): OLD for index in range(count)}), 0.0)
    return roster


# ------------------------------------------------------------------------------------------------------------- hearing


def test_nobody_but_me_is_alive_before_they_are_heard() -> None:
    roster = a_roster()
    assert roster.alive() == [ME]
    assert roster.unheard() == [PEER, OTHER] and roster.unheard_count == 2
    assert roster.chance_alive(ME) == 1 and roster.chance_alive(PEER) == 0


def test_who_is_heard_is_alive() -> None:
    roster = a_roster()
    assert roster.hear(status_of(PEER, 1), now=5.0)
    assert roster.alive() == [ME, PEER]
    assert roster.heard_at(PEER) == 5.0 and roster.heard_at(OTHER) is None
    assert roster.statuses() == [status_of(PEER, 1)] and roster.status(PEER) == status_of(PEER, 1)


@given(st.lists(st.integers(0, 20)))
def test_only_a_rising_lamport_time_counts(lamports: list[int]) -> None:
    roster, highest = a_roster(), -1
    for now, lamport in enumerate(lamports):
        assert roster.hear(status_of(PEER, lamport), float(now)) == (lamport > highest)
        highest = max(highest, lamport)
    assert [status.lamport for status in roster.statuses()] == ([highest] if lamports else [])
    assert roster.signs(PEER) == len({max(lamports[: i + 1]) for i in range(len(lamports))})


def test_hearing_again_brings_a_peer_back() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    for _ in range(100):
        roster.count_broadcast([])
    assert not roster.is_believed_alive(PEER) and PEER in roster.silent()
    roster.hear(status_of(PEER, 2), 1.0)
    assert roster.is_believed_alive(PEER) and PEER not in roster.silent()


def test_who_refuses_a_request_is_not_believed_alive_until_heard() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    roster.note_refusal(PEER)
    assert roster.alive() == [ME] and roster.refused() == [PEER]
    roster.hear(status_of(PEER, 1), 1.0)
    assert roster.alive() == [ME], "an old status is no sign of life"
    roster.hear_mini(mini_of(PEER, 2), 2.0)
    assert roster.alive() == [ME, PEER] and roster.refused() == []


def test_a_mini_status_keeps_a_peer_alive() -> None:
    roster = a_roster()
    assert roster.hear_mini(mini_of(PEER, 7), 1.0)
    assert not roster.hear_mini(mini_of(PEER, 7), 2.0)
    assert roster.is_believed_alive(PEER) and roster.is_unheard(PEER), "no whole status is known yet"
    assert roster.rises(status_of(PEER, 3)), "its first whole status is news, whenever it comes"


def test_relayed_old_news_fill_the_table_and_prove_nothing() -> None:
    roster = a_roster()
    roster.hear_mini(mini_of(PEER, 7), 1.0)
    roster.note_refusal(PEER)
    assert not roster.hear(status_of(PEER, 5), 9.0, relayed=True)
    assert roster.status(PEER) == status_of(PEER, 5) and roster.refused() == [PEER]
    assert roster.hear(status_of(PEER, 8), 10.0, relayed=True)
    assert roster.heard_at(PEER) == 10.0 and roster.proof_at(PEER) == 1.0 and roster.proofs(PEER) == 1


def test_an_old_folder_that_came_and_went_does_not_drown_out_the_right_one() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 3 << 32), 0.0)
    roster.hear_mini(mini_of(PEER, 58 << 32), 1.0)
    assert roster.hear(status_of(PEER, (3 << 32) + 1), 2.0)
    assert roster.hear_mini(mini_of(PEER, (3 << 32) + 2), 3.0)


def test_strangers_and_my_own_echo_do_not_count() -> None:
    roster = a_roster()
    assert not roster.hear(status_of(node_id_of("10.0.0.1"), 5), 0.0)
    assert not roster.hear_mini(mini_of(node_id_of("10.0.0.1"), 5), 0.0)
    assert not roster.hear(status_of(ME, 5), 0.0)
    roster.note_refusal(node_id_of("10.0.0.1"))
    roster.vouch(node_id_of("10.0.0.1"), 1.0)
    assert roster.statuses() == [] and roster.refused() == []


# ------------------------------------------------------------------------------------------------------------- members


def test_an_unregistered_incarnation_never_counts() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    for relayed in (False, True):
        assert not roster.hear(status_of(PEER, 2000, NEW), 1.0, relayed=relayed)
    assert roster.hear(status_of(PEER, 2), 3.0)


def test_a_new_incarnation_begins_unheard_and_the_old_one_is_dead_for_ever() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1000), 0.0)
    roster.note_refusal(PEER)
    roster.set_members(Line({ME: OLD, PEER: NEW, OTHER: OLD}), 7.0)
    assert roster.unheard() == [OTHER, PEER] and roster.statuses() == [] and roster.refused() == []
    assert roster.proof_at(PEER) == 7.0 and roster.arcs() == {}
    assert not roster.hear(status_of(PEER, 2000), 8.0)
    assert roster.hear(status_of(PEER, 1, NEW), 9.0)


def test_a_founder_that_never_came_is_nobody() -> None:
    roster = Roster(ME)
    roster.set_members(Line({ME: OLD, PEER: None}), 0.0)
    assert roster.count == 2 and roster.incarnation(PEER) is None
    assert roster.vacant_count == 1 and roster.unheard() == [] and not roster.is_unheard(PEER)
    assert not roster.hear(status_of(PEER, 1), 1.0) and not roster.hear_mini(mini_of(PEER, 2), 1.0)


def test_who_is_removed_leaves_nothing_behind() -> None:
    roster = a_roster(4)
    for node in (PEER, OTHER, NodeId(OTHER + 1)):
        roster.hear(status_of(node, 1), 0.0)
    roster.page(300, lambda _status: 100)
    roster.note_refusal(PEER)
    roster.set_members(Line({ME: OLD, OTHER: OLD}), 1.0)
    assert roster.alive() == [ME, OTHER] and roster.count == 2 and not roster.is_peer(PEER)
    assert roster.refused() == [] and roster.silent() == [] and roster.heard_at(PEER) is None
    assert roster.page(1000, lambda _status: 100) == [status_of(OTHER, 1)]
    assert not roster.hear(status_of(PEER, 5), 2.0)


def test_a_newcomer_sees_itself_before_it_is_a_member() -> None:
    roster = Roster(ME)
    assert roster.alive() == [ME] and roster.count == 1 and roster.silent() == []
    roster.set_members(Line({PEER: OLD}), 0.0)
    roster.hear(status_of(PEER, 1), 0.0)
    assert roster.alive() == [PEER, ME] and roster.count == 2


def test_the_line_has_its_own_order() -> None:
    roster = Roster(ME)
    roster.set_members(Line({OTHER: OLD, ME: OLD, PEER: OLD}), 0.0)
    for node in (PEER, OTHER):
        roster.hear(status_of(node, 1), 0.0)
    assert roster.alive() == [OTHER, ME, PEER] and [status.node for status in roster.statuses()] == [OTHER, PEER]


# --------------------------------------------------------------------------------------------------------------- odds


@given(st.integers(2, 1024), st.integers(0, 4000))
def test_the_chance_falls_with_every_broadcast_without_the_peer(count: int, missed: int) -> None:
    assert chance_alive(count, missed) == pytest.approx(((count - 1) / count) ** missed)
    assert (missed <= broadcasts_missed_max(count)) == (chance_alive(count, missed) >= ALIVE_CHANCE_MIN)


@given(st.integers(2, 12), st.lists(st.lists(st.integers(1, 11)), max_size=60))
def test_the_mark_of_a_peer_is_as_good_as_a_count_of_its_own(count: int, broadcasts: list[list[int]]) -> None:
    roster, missed = a_roster(count), dict.fromkeys(range(1, count), 0)
    for index in missed:
        roster.hear(status_of(NodeId(ME + index), 1), 0.0)
    for lamport, brought in enumerate(broadcasts, 2):
        heard = [index for index in missed if index in brought]
        for index in heard:
            roster.hear(status_of(NodeId(ME + index), lamport), 0.0)
        roster.count_broadcast([NodeId(ME + index) for index in heard])
        missed = {index: 0 if index in heard else before + 1 for index, before in missed.items()}
    for index, misses in missed.items():
        assert roster.chance_alive(NodeId(ME + index)) == pytest.approx(((count - 1) / count) ** misses)
    gone = {NodeId(ME + index) for index, misses in missed.items() if misses > broadcasts_missed_max(count)}
    assert set(roster.silent()) == gone
    assert all(roster.is_believed_alive(NodeId(ME + index)) == (NodeId(ME + index) not in gone) for index in missed)


def test_who_is_vouched_for_lives_without_having_been_heard() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    for _ in range(100):
        roster.count_broadcast([])
    roster.vouch(PEER, 50.0)
    assert PEER not in roster.silent() and roster.is_believed_alive(PEER)
    assert roster.proof_at(PEER) == 50.0 and roster.heard_at(PEER) == 0.0 and roster.signs(PEER) == 1


def test_proof_of_life_is_counted_by_member() -> None:
    roster = a_roster(5)
    roster.hear(status_of(PEER, 1), 1.0)
    roster.hear(status_of(OTHER, 1), 2.0, relayed=True)
    roster.hear_mini(mini_of(NodeId(OTHER + 1), 1), 3.0)
    assert [roster.count_proven(since) for since in (0.0, 1.0, 2.0, 3.0, 4.0)] == [3, 3, 2, 2, 1]


# ---------------------------------------------------------------------------------------------- the log and the bounds


def test_a_later_position_of_the_log_is_told_whoever_says_it() -> None:
    roster, told = a_roster(), Told()
    roster.tell_position = told
    roster.hear(replace(status_of(PEER, 1), log_position=1), 0.0)
    assert told.positions == [], "we know that much"
    roster.hear(replace(status_of(PEER, 2), log_position=4), 0.0)
    roster.hear_mini(mini_of(OTHER, 1, log_position=5), 0.0)
    roster.note_position(node_id_of("10.0.0.1"), 6)
    assert told.positions == [(PEER, 4), (OTHER, 5), (node_id_of("10.0.0.1"), 6)]


def test_the_newest_bound_counts_also_said_in_passing() -> None:
    roster = a_roster()
    version = roster.arcs_version
    roster.hear(replace(status_of(PEER, 5), right_bound=HALF), 0.0)
    assert roster.arcs() == {PEER: Arc(FIRST, HALF)} and roster.arcs_version > version
    roster.hear_mini(mini_of(PEER, 9, QUARTER), 1.0)
    roster.hear(replace(status_of(PEER, 8), right_bound=LAST), 2.0, relayed=True)
    assert roster.arcs() == {PEER: Arc(FIRST, QUARTER)}, "the relayed one is older than what it said in passing"
    version = roster.arcs_version
    roster.hear_mini(mini_of(PEER, 10, QUARTER), 3.0)
    assert roster.arcs_version == version, "nothing has changed"
    assert roster.said_at(PEER) == 1.0, "it has not said again where its arc begins"
    roster.hear_mini(mini_of(PEER, 11, None), 4.0)
    assert roster.arcs() == {PEER: None} and roster.said_at(PEER) == 4.0


def test_an_arc_begins_where_the_newest_status_says() -> None:
    roster = a_roster()
    roster.hear_mini(mini_of(PEER, 9, HALF), 0.0)
    assert roster.arcs() == {PEER: Arc(HALF, HALF)}, "of an arc whose beginning was never told, only the end is certain"
    roster.hear(replace(status_of(PEER, 8), left_fence=FIRST, right_bound=LAST), 0.0, relayed=True)
    assert roster.arcs() == {PEER: Arc(Location.from_number(1), HALF)}
    roster.hear(replace(status_of(PEER, 10), left_fence=QUARTER, right_bound=HALF), 0.0)
    roster.hear_mini(mini_of(PEER, 11, Location.from_number(1)), 0.0)
    assert roster.arcs() == {PEER: Arc(Location.from_number(1), Location.from_number(1))}, "fence and bound do not fit"


def test_an_old_folder_that_came_and_went_does_not_drown_out_what_the_right_one_owns() -> None:
    roster = a_roster()
    roster.hear(replace(status_of(PEER, 5), right_bound=HALF), 0.0)
    roster.hear_mini(mini_of(PEER, 100, LAST), 1.0)
    roster.hear(replace(status_of(PEER, 6), right_bound=HALF), 2.0)
    roster.hear(replace(status_of(PEER, 7), right_bound=HALF), 3.0)
    assert roster.arcs() == {PEER: Arc(FIRST, HALF)}


def test_what_is_said_by_a_log_that_we_do_not_know_is_a_sign_of_life_and_no_more() -> None:
    roster = a_roster()
    roster.hear(replace(status_of(PEER, 5), right_bound=HALF), 0.0)
    roster.hear_mini(mini_of(PEER, 6, LAST, log_position=2), 1.0)
    assert roster.arcs() == {PEER: Arc(FIRST, HALF)} and roster.proof_at(PEER) == 1.0
    early = replace(status_of(PEER, 8), log_position=2)
    assert roster.note_life(early, 2.0) and not roster.note_life(early, 3.0)
    assert roster.arcs() == {PEER: Arc(FIRST, HALF)} and roster.proof_at(PEER) == 2.0
    status = roster.status(PEER)
    assert status is not None and status.lamport == 5 and roster.rises(early)


# -------------------------------------------------------------------------------------------------------------- pages


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


def test_a_page_costs_as_much_as_it_holds() -> None:
    roster, sized = a_roster(1000), 0
    for index in range(1, 1000):
        roster.hear(status_of(NodeId(ME + index), 1), 0.0)

    def size_of(_status: Status) -> int:
        nonlocal sized
        sized += 1
        return 100

    assert len(roster.page(450, size_of)) == 4 and sized == 5


def test_a_page_shows_what_is_newest() -> None:
    roster = a_roster()
    roster.hear(status_of(PEER, 1), 0.0)
    newer = replace(status_of(PEER, 2), rays_per_second=9)
    roster.hear(newer, 1.0)
    assert roster.page(1000, lambda _status: 100) == [newer]


class Life(RuleBasedStateMachine):
    """Whatever is heard, removed and registered in whatever order: the roster's tables agree with each other."""

    def __init__(self) -> None:
        super().__init__()
        self.roster = Roster(ME)
        self.line: dict[NodeId, bytes | None] = {ME: OLD}
        self.now = 0.0

    @rule(index=st.integers(1, 5), incarnation=st.sampled_from([OLD, NEW, None]))
    def register(self, index: int, incarnation: bytes | None) -> None:
        self.line = {**self.line, NodeId(ME + index): incarnation}
        self.follow()

    @rule(index=st.integers(1, 5))
    def remove(self, index: int) -> None:
        self.line = {node: value for node, value in self.line.items() if node != ME + index}
        self.follow()

    @rule(index=st.integers(1, 6), lamport=st.integers(0, 9), incarnation=st.sampled_from([OLD, NEW]), relayed=st.booleans())
    def hear(self, index: int, lamport: int, incarnation: bytes, relayed: bool) -> None:
        self.now += 1
        node = NodeId(ME + index)
        rises = self.roster.rises(status_of(node, lamport, incarnation))
        assert not rises or self.line.get(node) == incarnation
        if self.roster.hear(status_of(node, lamport, incarnation), self.now, relayed=relayed):
            self.roster.count_broadcast([node])

    @rule(index=st.integers(1, 6), lamport=st.integers(0, 9))
    def hear_mini(self, index: int, lamport: int) -> None:
        self.roster.hear_mini(mini_of(NodeId(ME + index), lamport), self.now)

    @rule(index=st.integers(1, 6))
    def fail(self, index: int) -> None:
        self.roster.note_refusal(NodeId(ME + index))

    @rule(count=st.integers(1, 12))
    def be_silent(self, count: int) -> None:
        for _ in range(count):
            self.roster.count_broadcast([])

    @rule(room=st.integers(0, 800))
    def relay(self, room: int) -> None:
        page = self.roster.page(room, lambda _status: 100)
        assert len(page) == min(room // 100, len(self.roster.statuses()))

    @invariant()
    def tables_agree(self) -> None:
        roster = self.roster
        peers = [node for node in self.line if node != ME]
        assert list(roster.peers) == peers and roster.count == len(peers) + 1
        vacant = {node for node in peers if self.line[node] is None}
        assert set(roster.unheard()) == set(peers) - vacant - {status.node for status in roster.statuses()}
        assert roster.vacant_count == len(vacant)
        assert set(roster.refused()) <= set(peers) and set(roster.arcs()) <= set(peers)
        for node in peers:
            is_doubted = node in roster.silent() or node in roster.refused() or roster.heard_at(node) is None
            assert roster.is_believed_alive(node) == (not is_doubted)

    def follow(self) -> None:
        self.roster.set_members(Line(dict(self.line)), self.now)


TestLife = Life.TestCase
