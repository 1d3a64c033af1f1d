"""If one fails, an owner tells of a write that rotted before anybody else had it, or what was acknowledged before it is lost for that."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
import trio

from scenefold.base.errors import DamagedData, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.records.copying import NotKept
from scenefold.store import Put
from scenefold.wire import CopyState, Packet
from scenefold.world import Priority
from unit.peer.line.street import rot
from unit.peer.replication.terrace import Home, Terrace, record_at
from unit.peer.replication.test_comparing import holders_of, played
from unit.peer.replication.test_healing import HEADER_BYTE, LAST_BYTE, filled, until_sound
from unit.peer.replication.test_placing import until as until_placed
from unit.peer.replication.test_showing import copies, key
from unit.peer.replication.writers import Row, in_a_row, until

SAID = pytest.mark.expect_log("damaged|rotten|changed|lost|not acknowledged|does not|connection was cut|was reset")


def shut_off(owner: Home, others: Iterable[Home]) -> set[NodeId]:
    """Nothing that the owner asks comes to these, not even later, as long as they are in the set."""
    away, ask = {home.node for home in others}, owner.peers.ask

    async def asked(node: NodeId, priority: Priority, packet: Packet, answer: type[Any], timeout: float) -> Any:
        if node in away:
            raise Unreachable("the connection was cut", where=address_of(node))
        return await ask(node, priority, packet, answer, timeout)

    owner.peers.ask = asked  # type: ignore[method-assign]
    return away


@SAID
def test_what_rots_before_anybody_else_has_it_is_not_settled_by_that() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        former, record = row.next_at(place), row.next_at(place)
        await row.put(former)
        await until(lambda: row.copies_of(former) == 3)
        away = shut_off(row.owner, row.homes[1:])
        (outcome,) = await row.put(record)
        assert outcome.reason == RejectReason.NOT_READY
        rot(row.owner, [place], LAST_BYTE)
        away.clear()
        await until(lambda: row.owner.store.noticed.is_rotten(row.owner.spot(place)))
        await trio.sleep(5.0)
        assert row.owner.living.parts.unsettled.within(Arc(place, place))
        assert not any(row.homes[number].has(record) for number in (1, 2))
        (told,) = (await copies(row.owner, key(place), digests_only=True)).copies
        assert told.state is CopyState.NO_CUSTODY, "which version it is must not be known"
        (refused,) = await row.put(former)
        assert refused.reason == RejectReason.NOT_READY, "nor that something newer is there"
        (again,) = await row.put(record)
        assert again.reason == 0
        assert row.owner.living.parts.unsettled.is_quiet

    in_a_row(story)


async def written_alone(terrace: Terrace, place: Location, seq: int, byte: int = LAST_BYTE) -> set[NodeId]:
    """Nobody but the first one has it, and it has rotted there; those who are to hold it, as long as they cannot be reached."""
    first = terrace.homes[0]
    away = shut_off(first, holders_of(terrace, first, place))
    (kept,) = await first.replication.spreading.put([Put(record_at(place, seq))], first.scenes)
    assert isinstance(kept, NotKept)
    rot(first, [place], byte)
    await first.store.read([first.spot(place)])
    return away


async def found_at(home: Home, place: Location) -> object:
    (found,) = await home.store.read([home.spot(place)])
    return found


@SAID
def test_what_was_never_told_gives_way_to_the_newest_that_others_have() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        one, other = holders_of(terrace, first, place)
        away = await written_alone(terrace, place, seq=2)
        away.remove(one.node)
        await trio.sleep(20.0)
        assert isinstance(await found_at(first, place), DamagedData), "the other one may have it"
        assert await found_at(one, place) == record_at(place)
        away.remove(other.node)
        await until_sound(first, place, seq=1)
        unsettled = first.living.parts.unsettled
        await until_placed(lambda: unsettled.is_quiet and not any(first.store.owed.values()), 120.0)

    played(main, seed=31)


@SAID
@pytest.mark.parametrize("byte", [HEADER_BYTE, LAST_BYTE])
def test_what_was_never_told_and_nothing_was_there_before_holds_up_nothing(byte: int) -> None:
    """All say that it is damaged, as far as anybody knows what it was."""

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        for home in (first, *holders_of(terrace, first, place)):
            await home.store.remove([(home.spot(place), record_at(place).header.digest)])
        (await written_alone(terrace, place, 1, byte)).clear()
        unsettled = first.living.parts.unsettled
        await until_placed(lambda: unsettled.is_quiet and not any(first.store.owed.values()), 120.0)
        assert isinstance(await found_at(first, place), DamagedData)
        for home in holders_of(terrace, first, place):
            found = await found_at(home, place)
            assert found is None if byte == HEADER_BYTE else isinstance(found, DamagedData)

    played(main, seed=32)


@SAID
def test_what_somebody_may_have_been_told_gives_way_to_nothing_older() -> None:
    """As many are owed it, but whoever read it then knows that it was there."""

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        holders = holders_of(terrace, first, place)
        await first.store.put([Put(record_at(place, 2))], [[home.node for home in holders]])
        rot(first, [place], LAST_BYTE)
        await first.store.read([first.spot(place)])
        await until_placed(lambda: first.store.noticed.is_given_up(first.spot(place)), 120.0)
        await trio.sleep(10.0)
        assert isinstance(await found_at(first, place), DamagedData)
        assert await first.store.record_headers([first.spot(place)]) == [record_at(place, 2).header_bytes]

    played(main, seed=33)
