"""If this fails, what lies on disks of a scene's log is not looked at, or not understood: then the judge sees no second history."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from scenefold.consensus import Certificate, Slot, Tentative
from scenefold.scene.log import without_log
from scenefold.simulation import laws
from scenefold.simulation.log_history import Told
from scenefold.simulation.log_watch import LogWatch
from scenefold.store.layout import HEADERS, IDENTITY, LOGS, scene_key
from scenefold.store.log_rows import Decided, Votes, decided_key, pack_decided, pack_votes, votes_key
from scenefold.store.sealing import sealed
from scenefold.wire import Ballot, LogValue, SceneLogPublic, SceneMode, SetMode
from unit.scene.log.council import BALLOT, Council, added, node

MEMBERS = [node(number).member for number in (1, 2, 3, 4)]


class Machine:
    """A disk, to which a test writes what it likes."""

    def __init__(self, slot: int) -> None:
        self.tables: dict[str, dict[bytes, bytes]] = {HEADERS: {}, LOGS: {}, IDENTITY: {}}
        self.tables[IDENTITY][b"incarnation"] = sealed(IDENTITY, b"incarnation", MEMBERS[slot].incarnation)
        self._last: dict[str, list[bytes]] = {}

    def peek(self, table: str, /) -> Mapping[bytes, bytes]:
        return self.tables[table]

    written = peek

    def replaced(self, table: str, /) -> list[tuple[bytes, bytes | None]]:
        return [(key, None) for key in self._last.get(table, [])]

    def write(self, changes: Mapping[str, Mapping[bytes, bytes]]) -> None:
        self._last = {table: list(rows) for table, rows in changes.items()}
        for table, rows in changes.items():
            self.tables[table].update(rows)


class Town:
    """Three participants and a fourth node, and what the judge says of their disks."""

    def __init__(self) -> None:
        self.council = Council()
        self.genesis = self.council.header.genesis
        self.machines = {slot: Machine(slot) for slot in range(4)}
        self.found: list[str] = []
        self.put_back: dict[int, bytes] = {}
        nodes = {slot: member.node for slot, member in enumerate(MEMBERS)}
        self.watch = LogWatch(self.machines, nodes, self.put_back, lambda law, what, slots: self.found.append(law), lambda slot, what: None)
        self.watch.follow(self.council.header)
        self.header(0, self.council.header)

    def header(self, slot: int, header: SceneLogPublic) -> None:
        self._write(slot, {HEADERS: {scene_key(header.scene): header.encode()}})

    def votes(self, slot: int, position: int, promised: Ballot, accepted: Tentative | None = None) -> None:
        votes = Votes(MEMBERS[slot].incarnation, position, Slot(promised, accepted))
        self._write(slot, {LOGS: {votes_key(self.genesis): pack_votes(self.genesis, votes)}})

    def decided(self, slot: int, position: int, value: LogValue, certificate: Certificate) -> None:
        votes = Votes(MEMBERS[slot].incarnation, position + 1)
        row = pack_decided(self.genesis, Decided(position, value, certificate))
        rows = {votes_key(self.genesis): pack_votes(self.genesis, votes), decided_key(self.genesis, position): row}
        self._write(slot, {LOGS: rows})

    def decide(self, entry: object, slots: tuple[int, ...] = (0, 1, 2), *, by: tuple[int, ...] = (0, 1)) -> tuple[LogValue, Certificate]:
        """It is voted for, and then decided on these disks."""
        offered = self.council.offer(entry)  # type: ignore[arg-type]
        value, position = self.council.value(offered), offered.header.position
        votes = tuple(vote for vote in self.council.votes(value, BALLOT) if vote.member in [MEMBERS[slot] for slot in by])
        for slot in by:
            self.votes(slot, position, BALLOT, Tentative(BALLOT, value))
        certificate = Certificate(position, BALLOT, votes)
        self.council.settle(offered)
        for slot in slots:
            self.decided(slot, position, without_log(value), certificate)
        return value, certificate

    def _write(self, slot: int, changes: Mapping[str, Mapping[bytes, bytes]]) -> None:
        self.machines[slot].write(changes)
        self.watch.committed(slot)


def test_a_log_that_is_decided_as_it_should_be_passes_and_says_who_decides() -> None:
    town = Town()
    assert town.watch.participants() == MEMBERS[:3]
    for entry in (SetMode(SceneMode.RENDER), added(4), SetMode(SceneMode.EDIT)):
        town.decide(entry, by=(1, 2, 0) if town.council.header.position > 2 else (0, 1))
        town.header(3, town.council.header)
    assert town.found == []
    assert town.watch.participants() == MEMBERS and town.watch.agreement.newest == 4
    assert set(town.watch.agreement.at) >= {header.request for header in town.council.headers if header.request}


def test_another_value_is_seen_on_a_disk_in_a_header_and_with_a_client() -> None:
    for show in (lambda town, other: town.header(3, other), lambda town, other: town.watch.shown("c0", other)):
        town = Town()
        town.decide(SetMode(SceneMode.RENDER))
        assert town.found == []
        show(town, replace(town.council.header, write_floor=0))
        assert town.found == [laws.ONE_VALUE]


def test_a_certificate_without_votes_on_disks_is_seen() -> None:
    town = Town()
    offered = town.council.offer(SetMode(SceneMode.RENDER))
    value = town.council.value(offered)
    votes = tuple(town.council.votes(value, BALLOT)[:2])
    town.decided(2, 2, without_log(value), Certificate(2, BALLOT, votes))
    assert laws.CERTIFIED in town.found


def test_a_promise_that_falls_is_seen_and_one_of_a_new_position_is_none() -> None:
    town = Town()
    town.votes(0, 2, Ballot(5, MEMBERS[0].node))
    town.votes(0, 2, Ballot(6, MEMBERS[0].node))
    town.decide(SetMode(SceneMode.RENDER), by=(1, 2))
    assert town.found == []
    town.votes(0, 3, Ballot(2, MEMBERS[0].node))
    town.votes(0, 3, Ballot(1, MEMBERS[0].node))
    assert town.found == [laws.PROMISES]


def test_a_header_that_falls_back_is_seen_unless_the_disk_was_put_back() -> None:
    town = Town()
    first = town.council.header
    town.decide(SetMode(SceneMode.RENDER))
    town.header(3, town.council.header)
    town.put_back[3] = MEMBERS[3].incarnation
    town.header(3, first)
    assert town.found == []
    town.header(3, town.council.header)
    town.header(3, first)
    assert town.found == [laws.ENTRIES_STAY]


@pytest.mark.parametrize("is_shown", [True, False])
def test_a_log_may_go_on_behind_a_header_that_was_shown_and_not_behind_nothing(is_shown: bool) -> None:
    town = Town()
    town.decide(SetMode(SceneMode.RENDER))
    town.decide(added(4), slots=(0, 1))
    if is_shown:
        town.header(2, town.council.header)
    value, certificate = town.decide(SetMode(SceneMode.EDIT), slots=(0, 1), by=(0, 1, 3))
    assert town.found == []
    town.decided(2, 4, without_log(value), certificate)
    assert town.found == ([] if is_shown else [laws.ONE_VALUE])


def test_a_disk_that_was_put_back_may_learn_and_must_not_take_part() -> None:
    town = Town()
    town.votes(2, 2, BALLOT)
    town.put_back[2] = MEMBERS[2].incarnation
    town.decide(SetMode(SceneMode.RENDER), (0, 1, 2))
    assert town.found == [], "what it had promised is forgotten with the position"
    town.votes(2, 3, BALLOT)
    assert town.found == [laws.PROMISES]


def test_what_is_acknowledged_before_it_is_decided_is_seen() -> None:
    town = Town()
    attempt = town.watch.history.asks(b"r" * 16, "c0", 0.0)
    town.watch.history.ends(attempt, Told.COMMITTED, 9)
    town.watch.told(attempt)
    assert town.found == [laws.ENTRIES_STAY]


def test_other_scenes_and_damaged_rows_are_nothing() -> None:
    town = Town()
    other = replace(town.council.header, genesis=b"o" * 32, write_floor=7)
    town.header(3, other)
    town._write(3, {LOGS: {votes_key(town.genesis): b"damaged", decided_key(other.genesis, 2): b"another's"}})
    assert town.found == []
