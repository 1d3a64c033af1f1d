"""If this fails, the observer does not see a wrong step when it is made, or sees one where there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import LAST, Arc, Location
from scenefold.crypto import Record, RecordPlace, SigningKey, seal_record
from scenefold.crypto.record_header import version_key
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Holding, handover_id
from scenefold.peer.line.holding_note import encode_holding
from scenefold.simulation import laws
from scenefold.simulation.disks import place_of, records_of
from scenefold.simulation.history import Loss, Place, Version
from scenefold.simulation.lineage import Holder
from scenefold.simulation.watch import Watch
from scenefold.store.layout import HOLDING, IDENTITY, NOTES, OBJECTS, RECORDS, SUSPECTS, pack_record, record_key
from scenefold.store.sealing import sealed
from scenefold.wire import Member

SCENE, SPACE = SceneId(7), SpaceId(1)
MIDDLE = Location.from_number(1 << 159)
LEFT = Arc(Location.from_number(0), Location.from_number(MIDDLE.number - 1))
RIGHT = Arc(MIDDLE, LAST)
HERE = Location.from_number(MIDDLE.number + 5)
PLACE = Place(SCENE, SPACE, HERE)
KEY = SigningKey(bytes(32))


def member(slot: int) -> Member:
    return Member(NodeId(100 + slot), bytes([slot + 1]) * 16)


class Machine:
    """A disk, and a node that answers as it is told to."""

    def __init__(self, slot: int) -> None:
        self.tables: dict[str, dict[bytes, bytes]] = {RECORDS: {}, OBJECTS: {}, HOLDING: {}, IDENTITY: {}, SUSPECTS: {}, NOTES: {}}
        self.tables[IDENTITY] = {b"incarnation": sealed(IDENTITY, b"incarnation", member(slot).incarnation)}
        self.last_commit: list[tuple[bytes, bytes | None]] = []
        self.lease = True
        self.holding = Holding()

    def peek(self, table: str, /) -> Mapping[bytes, bytes]:
        return self.tables[table]

    written = peek

    def replaced(self, table: str, /) -> list[tuple[bytes, bytes | None]]:
        return self.last_commit if table == RECORDS else []

    def owns(self, location: Location) -> bool:
        return self.holding.owns(location)

    def has_lease(self) -> bool:
        return self.lease

    def keep(self, holding: Holding) -> None:
        arc = holding.arc
        self.holding = holding
        kept = {b"arc": b"" if arc is None else arc.first + arc.last, b"note": encode_holding(holding)}
        self.tables[HOLDING] = {key: sealed(HOLDING, key, value) for key, value in kept.items()}

    def store(self, record: Record) -> None:
        self.tables[RECORDS][record_key(RecordPlace(SCENE, SPACE, HERE))] = pack_record(record)


def record(seq: int) -> Record:
    return seal_record(
        b"payload",
        scene=SCENE,
        genesis=bytes(32),
        space=SPACE,
        location=HERE,
        epoch=1,
        seq=seq,
        session=1,
        nonce=seq.to_bytes(12, "big"),
        symmetric_key=bytes(24),
        signing_key=KEY,
    )


def version(seq: int) -> Version:
    header = record(seq).header
    return Version(version_key(header), header.digest)


class Stage:
    """Three machines: 0 owns the left half, 1 the right one, 2 nothing."""

    def __init__(self) -> None:
        self.now = 0.0
        self.machines = {slot: Machine(slot) for slot in range(3)}
        self.watch = Watch(lambda: self.now, self.machines, self.machines, lambda node: node - 100)
        for slot, arc in ((0, LEFT), (1, RIGHT)):
            self.change(slot, Holding().found(arc))
        assert self.laws == []

    def change(self, slot: int, holding: Holding) -> None:
        self.machines[slot].keep(holding)
        self.watch.committed(slot)

    @property
    def laws(self) -> list[str]:
        return [violation.law for violation in self.watch.violations]

    def give(self, giver: int, receiver: int, *, copied: bool = True, number: int = 2) -> None:
        """Hand the whole arc of one over to another, all steps."""
        holding = self.machines[giver].holding
        assert holding.arc is not None
        number = holding.revision + 1
        offered = holding.offer(handover_id(number, bytes(8)), Side.RIGHT, member(receiver), holding.arc)
        self.change(giver, offered)
        noted = self.machines[receiver].holding.note(handover_id(number, bytes(8)), Side.LEFT, member(giver), holding.arc)
        self.change(receiver, noted)
        if copied:
            self.machines[receiver].tables[RECORDS].update(self.machines[giver].tables[RECORDS])
        self.change(giver, offered.release(handover_id(number, bytes(8))))
        taken = noted.claim(handover_id(number, bytes(8)), holding.arc)
        self.change(receiver, taken)
        self.change(receiver, taken.drop(handover_id(number, bytes(8))))


def test_an_acknowledgement_by_the_owner_alone_is_right() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert stage.laws == []


def test_an_acknowledgement_must_be_durable_and_not_older() -> None:
    stage = Stage()
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    stage.machines[1].store(record(2))
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    stage.watch.acknowledges(1, PLACE, version(3), HERE)
    assert stage.laws == [laws.DURABLE, laws.DURABLE]


def test_an_acknowledgement_needs_arc_and_lease() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.machines[1].lease = False
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert stage.laws == [laws.RIGHT_TO_ANSWER]
    stage.machines[0].store(record(1))
    stage.watch.acknowledges(0, PLACE, version(1), HERE)
    assert stage.laws[1:] == [laws.RIGHT_TO_ANSWER, laws.RIGHT_TO_ANSWER]


def test_two_that_could_acknowledge_are_one_too_many() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.machines[2].holding = Holding().found(RIGHT)
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert stage.laws == [laws.ONE_OWNER]
    stage.machines[2].lease = False
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert len(stage.laws) == 1


def test_a_handover_with_its_records_is_right() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.give(1, 2)
    assert stage.laws == []
    assert stage.watch.moves.count == 1


def test_a_release_before_the_copy_is_seen_at_the_release() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.give(1, 2, copied=False)
    assert stage.laws[0] == laws.CARRIED
    assert stage.watch.violations[0].location == HERE


def test_a_claim_of_what_another_owns_is_seen() -> None:
    stage = Stage()
    stage.change(2, Holding().found(RIGHT))
    assert stage.laws == [laws.ONE_OWNER]


def test_a_record_that_moves_on_at_once_is_seen() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.give(1, 2)
    stage.now = 9.0
    stage.machines[1].keep(Holding())
    stage.give(2, 1)
    assert stage.laws == [laws.SETTLED]


def test_a_wiped_disk_takes_its_only_copies_with_it() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    before = records_of(stage.machines[1])
    stage.machines[1].tables = {RECORDS: {}, HOLDING: {}, IDENTITY: {}}
    stage.watch.disk_replaced(1, before, member(1).incarnation, "is wiped")
    (event,) = stage.watch.recorder.histories.of(PLACE)
    assert isinstance(event, Loss)
    assert event.left == ()
    stage.change(0, stage.machines[0].holding.adopt(RIGHT, revision=1))
    assert stage.laws == []
    assert stage.watch.counts["adoption"] == 1


def test_adopting_what_another_disk_holds_loses_it_until_it_is_offered() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.watch.lineage.gone(Holder(1, member(1).incarnation))
    stage.change(0, stage.machines[0].holding.adopt(RIGHT, revision=1))
    (event,) = stage.watch.recorder.histories.of(PLACE)
    assert isinstance(event, Loss)
    assert event.left == (version(1),)
    assert stage.laws == []


def rots(stage: Stage, slot: int) -> None:
    before = stage.watch.records(slot)
    table, key = stage.machines[slot].tables[RECORDS], record_key(RecordPlace(SCENE, SPACE, HERE))
    table[key] = table[key][:-1] + bytes([table[key][-1] ^ 1])
    stage.watch.damaged(slot, key, before)


def test_what_rots_between_commit_and_answer_was_durable() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    rots(stage, 1)
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert stage.laws == []
    stage.machines[1].tables[RECORDS].clear()
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert stage.laws == [laws.DURABLE], "it is not there at all"


def test_what_rotted_is_excused_until_it_is_written_anew() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    rots(stage, 1)
    stage.watch.committed(1)
    assert stage.watch.recorder.damaged == {PLACE}
    (event,) = stage.watch.recorder.histories.of(PLACE)
    assert isinstance(event, Loss)
    stage.machines[1].store(record(2))
    stage.watch.committed(1)
    assert stage.watch.recorder.damaged == set()
    stage.give(1, 2, copied=False)
    assert stage.laws[0] == laws.CARRIED, "the new record must be carried, though an old one rotted once"


def test_what_rotted_need_not_be_carried_and_is_no_excuse_elsewhere() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    rots(stage, 1)
    stage.give(1, 2, copied=False)
    assert stage.laws == []
    assert stage.watch.recorder.damaged == set(), "who owns the place now has nothing rotten there"


def test_what_is_left_of_it_may_be_carried() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    rots(stage, 1)
    stage.machines[2].store(replace(record(1), ciphertext=b""))
    stage.give(1, 2, copied=False)
    assert stage.laws == []
    assert stage.watch.recorder.damaged == {PLACE}


def test_a_copy_that_rots_with_the_receiver_is_not_the_givers_fault() -> None:
    stage = Stage()
    for slot in (1, 2):
        stage.machines[slot].store(record(1))
    rots(stage, 2)
    stage.give(1, 2, copied=False)
    assert stage.laws == []


def test_a_stray_that_rots_takes_nothing_from_the_owner() -> None:
    stage = Stage()
    for slot in (1, 2):
        stage.machines[slot].store(record(1))
    rots(stage, 2)
    assert stage.watch.recorder.histories.of(PLACE) == []
    assert stage.watch.recorder.damaged == set()
    rots(stage, 1)
    assert len(stage.watch.recorder.histories.of(PLACE)) == 1


def test_a_backup_may_bring_the_rot_back() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    rots(stage, 1)
    backup = dict(stage.machines[1].tables[RECORDS])
    stage.machines[1].store(record(2))
    stage.watch.committed(1)
    before = stage.watch.records(1)
    stage.machines[1].tables[RECORDS] = backup
    stage.watch.disk_replaced(1, before, None, "is put back")
    assert stage.watch.recorder.damaged == {PLACE}


@pytest.mark.parametrize("claimed", [True, False])
def test_whose_word_of_having_taken_a_piece_is_on_its_way_may_take_the_records_along(claimed: bool) -> None:
    """Its giver, which has them still, deletes them once it hears that; if nothing was claimed, they stay where they are."""
    stage = Stage()
    stage.machines[1].store(record(1))
    if claimed:
        stage.give(1, 2)
    else:
        stage.machines[2].tables[RECORDS].update(stage.machines[1].tables[RECORDS])
    before = stage.watch.records(2)
    assert before
    stage.machines[2].tables = {RECORDS: {}, HOLDING: {}, IDENTITY: {}}
    stage.watch.disk_replaced(2, before, member(2).incarnation, "is wiped")
    assert [type(event) for event in stage.watch.recorder.histories.of(PLACE)] == [Loss] * claimed


def test_keys_and_places_are_the_same_thing() -> None:
    assert place_of(record_key(RecordPlace(SCENE, SPACE, HERE))) == PLACE
