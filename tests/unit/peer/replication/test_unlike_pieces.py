"""If one fails, a claim makes of what a former life has left on one disk what is told as if it were acknowledged."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import Senders
from scenefold.peer.line import likeness
from scenefold.peer.line.ends import Side
from scenefold.store import Put
from scenefold.wire import CompareRange, GetMany, GetManyReply, Packet, RecordKey
from unit.peer.replication.terrace import HEADER, OBJECTS, SPACE, THIRDS, THRICE, Home, Terrace, object_record, record_at
from unit.peer.replication.test_comparing import is_settled, played
from unit.peer.replication.test_owner_changes import filled
from unit.peer.replication.test_placing import until
from unit.peer.replication.writers import Row, in_a_row, names, seq_of

SETTLES_S = 12.0
"""So long a founding arc stays with its founder."""


async def read(home: Home, *places: Location) -> tuple[list[int], bool]:
    """Which versions it tells, and whether they may be stale."""
    keys = tuple(RecordKey(THRICE, place, b"") for place in places)
    reply: GetManyReply = await home.asked(GetMany(HEADER.scene, HEADER.position, keys))
    return [seq_of(found) for found in reply.records], reply.stale


async def written(row: Row, count: int) -> list[Location]:
    """Places in an arc that two others hold than the neighbour, each with a record that is acknowledged but for the last one."""
    await row.hold(2, 3)
    spots = row.places(count)
    assert [outcome.reason for outcome in await row.put(*map(record_at, spots[:-1]))] == [0] * (count - 1)
    await trio.sleep(SETTLES_S)
    return spots


@pytest.mark.expect_log("the connection was cut")
@pytest.mark.parametrize("which", [4, 5], ids=["newer", "alone"])
def test_what_only_the_receiver_has_is_not_told_as_if_it_counted(which: int) -> None:
    async def story(row: Row) -> None:
        spots, heir = await written(row, 6), row.homes[1]
        left = record_at(spots[which], 2)
        await heir.store.merge([Put(left)])
        await row.given(Side.RIGHT, Arc(spots[3], row.arc.last))
        assert row.copies_of(left) == 1
        assert await read(heir, spots[which]) == ([2], True)
        assert [(doubt.layout, doubt.arc.first, doubt.rules) for doubt in heir.living.parts.unsettled.doubts] == [(THIRDS, spots[3], 2)]
        heir.crash()
        await until(lambda: heir.lives == 2 and heir.up.is_set())
        await trio.sleep(1.0)
        assert await read(heir, spots[which]) == ([2], True), "a start knows no more than that"

    in_a_row(story, 4)


def test_an_object_that_only_the_receiver_has_is_noticed_by_its_home() -> None:
    async def story(row: Row) -> None:
        spots, heir = await written(row, 6), row.homes[1]
        piece = Arc(spots[3], row.arc.last)
        record = next(
            found for found in (object_record(name) for name in names()) if Location(found.header.location[4:] + bytes(4)) in piece
        )
        await heir.store.merge([Put(record, at=Location(record.header.location[4:] + bytes(4)))])
        await row.given(Side.RIGHT, piece)
        assert heir.living.parts.unsettled.is_doubted(THIRDS, piece)
        assert heir.spots(OBJECTS)

    in_a_row(story, 4)


async def with_older_ones(row: Row, spots: Sequence[Location]) -> None:
    """The receiver has what an earlier handover brought, and what has no copies."""
    await row.homes[1].store.merge([Put(record_at(place)) for place in spots[3:5]])
    await row.put(*[record_at(place, 2) for place in spots[4:]])
    await row.homes[1].store.merge([Put(record_at(spots[5], space=SPACE))])


def test_where_the_receiver_has_just_what_was_given_all_is_told_at_once() -> None:
    """Else readers would have to wait after each move of a bound."""

    async def story(row: Row) -> None:
        spots, heir = await written(row, 6), row.homes[1]
        await with_older_ones(row, spots)
        await row.given(Side.RIGHT, Arc(spots[3], row.arc.last))
        assert heir.living.parts.unsettled.is_quiet
        begin = trio.current_time()
        assert await read(heir, *spots[3:]) == ([1, 2, 2], False)
        assert trio.current_time() - begin < 0.5

    in_a_row(story, 4)


@pytest.mark.parametrize("has_any", [False, True])
@pytest.mark.parametrize("is_slow", [False, True])
def test_a_giver_that_does_not_say_what_it_has_holds_up_no_claim(monkeypatch: pytest.MonkeyPatch, is_slow: bool, has_any: bool) -> None:
    monkeypatch.setattr(likeness, "LOOK_S_MAX", 0.5)

    async def mute(_packet: CompareRange, _peer: str) -> Packet:
        if is_slow:
            await trio.sleep(60.0)
        raise Refused(RejectReason.BUSY, "not now")

    async def story(row: Row) -> None:
        spots, heir = await written(row, 6), row.homes[1]
        if not has_any:
            spots = [*spots, row.arc.last]
        row.owner.handlers._table[CompareRange] = mute, Senders.NODES
        await row.given(Side.RIGHT, Arc(spots[3 if has_any else 6], row.arc.last))
        assert heir.living.parts.unsettled.is_quiet is not has_any, "what nobody has, nobody can be told"

    in_a_row(story, 4)


async def with_a_piece_given(terrace: Terrace, *left: int) -> list[Location]:
    """Places of it. `left`: at which of them the receiver alone has something newer."""
    first, second = terrace.homes[:2]
    spots = await filled(terrace, 0, 6)
    await trio.sleep(SETTLES_S)
    await second.store.merge([Put(record_at(spots[which], 2)) for which in left])
    arc = first.living.arc
    assert arc is not None
    await first.living.give(Side.RIGHT, Arc(spots[3], arc.last), why="a test")
    return spots[3:]


def test_what_was_doubted_settles_by_itself() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots, heir = await with_a_piece_given(terrace, 5), terrace.homes[1]
        assert heir.living.parts.unsettled.doubts
        begin = trio.current_time()
        await until(lambda: heir.living.parts.unsettled.is_quiet)
        assert trio.current_time() - begin < 5.0
        assert await read(heir, *spots) == ([1, 1, 2], False)
        found = [await home.store.get_many([home.spot(spots[2]).place]) for home in terrace.homes]
        assert sum(record is not None and record.header.seq == 2 for (record,) in found) >= 2
        await until(lambda: all(map(is_settled, terrace.homes)), 90.0)

    played(main, seed=9)


def test_where_all_goes_on_by_itself_nothing_is_doubted_without_a_reason() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots, heir = await with_a_piece_given(terrace), terrace.homes[1]
        assert not heir.living.parts.unsettled.doubts
        assert await read(heir, *spots) == ([1, 1, 1], False)

    played(main, seed=9)
