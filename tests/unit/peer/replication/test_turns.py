"""If one fails, somebody is answered by copies that nobody counts any more, or the old ones go before the new ones are there (specs/23-turns.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.location import FIRST, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, RecordHeader
from scenefold.peer.line.ends import Side
from scenefold.peer.records.verification import KnownScene
from scenefold.scene.log import free_offsets
from scenefold.store import Put
from scenefold.wire import Configuration, CopyState, GetCopies, GetMany, PutMany, RecordKey, SceneLogPublic
from unit.peer.line.street import places
from unit.peer.replication.terrace import HEADER, SCENE, THIRDS, THRICE, Home, Terrace, _space, record_at
from unit.peer.replication.test_comparing import arc_of, had_by, is_settled, played
from unit.peer.replication.test_placing import until
from unit.peer.replication.writers import offered

MORE = 40
"""Numbers of shadows that are made later."""


def turned(copies: int, least: int, position: int = 2) -> SceneLogPublic:
    """The header by which the space has so many copies from this position on."""
    at = Location.from_number(position)
    spaces = [replace(entry, copies=copies, copies_min=least, offset=at) if entry.space == THRICE else entry for entry in HEADER.spaces]
    more = free_offsets(THIRDS, max(0, copies - 3))
    return replace(
        HEADER,
        position=position,
        spaces=(*spaces, *(_space(MORE + index, 1, 1, parent=THRICE, offset=offset) for index, offset in enumerate(more))),
    )


def learn(public: SceneLogPublic, homes: Iterable[Home]) -> None:
    for home in homes:
        home.scenes[public.scene] = KnownScene.of(public)


def layout_of(home: Home) -> tuple[Location, ...]:
    return home.scenes[HEADER.scene].layouts[THRICE]


def holders_of(terrace: Terrace, owner: Home, place: Location) -> list[Home]:
    segment = owner.copies.configurations.at(layout_of(owner), place)
    return [] if segment is None else [home for home in terrace.homes if home.member in segment.holders(owner.member)]


async def put(owner: Home, *records: Record) -> list[int]:
    return [outcome.reason for outcome in (await owner.asked(PutMany(tuple(map(offered, records))))).outcomes]


async def read(owner: Home, place: Location) -> tuple[int, bool]:
    """What it tells of a place, and whether that may be stale."""
    reply = await owner.asked(GetMany(HEADER.scene, HEADER.position, (RecordKey(THRICE, place, b""),)))
    (found,) = reply.records
    return 0 if found is None else RecordHeader.decode(found.header).seq, reply.stale


async def word(holder: Home, place: Location) -> tuple[int, Configuration] | None:
    """Which version a holder answers with to a client that knows the first header, and for whom; None if it has nothing to say."""
    request = GetCopies(HEADER.scene, HEADER.position, (RecordKey(THRICE, place, b""),), digests_only=False, any_copy=False)
    reply = await holder.asked(request)
    (copy,) = reply.copies
    if copy.state is CopyState.NO_CUSTODY:
        return None
    return 0 if copy.record is None else RecordHeader.decode(copy.record.header).seq, reply.holders[copy.holders]


async def said(holder: Home, place: Location) -> int | None:
    """Likewise, the version alone."""
    told = await word(holder, place)
    return None if told is None else told[0]


def lies_as_it_should(terrace: Terrace, spots: Iterable[Location], copies: int) -> bool:
    """Whether each lies with its owner and those by its placement, and nowhere else."""
    had = had_by(terrace)
    for place in spots:
        (owner,) = [home for home in terrace.homes if place in arc_of(home)]
        holders = holders_of(terrace, owner, place)
        having = {node for node, lying in had.items() if place in lying}
        if len(holders) != copies - 1 or having != {home.node for home in (owner, *holders)}:
            return False
    return True


async def begun(terrace: Terrace, count: int = 12) -> list[Location]:
    """Records all along the line, with all who are to hold them."""
    await until(lambda: all(map(is_settled, terrace.homes)))
    spots: list[Location] = []
    for home in terrace.homes:
        mine = places(arc_of(home), count)
        assert await put(home, *(record_at(place) for place in mine)) == [0] * count
        spots += mine
    await until(lambda: lies_as_it_should(terrace, spots, 3))
    return spots


@pytest.mark.parametrize(("copies", "least"), [(4, 2), (2, 2), (1, 1)])
def test_copies_are_as_many_as_the_header_says_and_none_goes_before_others_are_there(copies: int, least: int) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await begun(terrace)
        former = 3
        for step, (number, needed) in enumerate([(copies, least), (3, 2)], 2):
            learn(turned(number, needed, step), terrace.homes)

            def is_so(number: int = number, fewest: int = min(former, needed)) -> bool:
                had = had_by(terrace).values()
                for place in spots:
                    having = sum(place in lying for lying in had)
                    assert having >= fewest, "a copy went before others were there"
                return lies_as_it_should(terrace, spots, number)

            await until(is_so, 180.0)
            former = number
            for home in terrace.homes:
                mine = [place for place in spots if place in arc_of(home)]
                assert await put(home, *(record_at(place, seq=step) for place in mine)) == [0] * len(mine)
                assert [await read(home, place) for place in mine] == [(step, False)] * len(mine)

    played(main, homes=5, seed=copies)


@pytest.mark.parametrize("copies", [1, 2])
def test_nothing_counts_by_new_copies_alone_while_the_old_ones_may_be_asked(copies: int) -> None:
    """Holders that do not know the new header answer for the old one; those of them that would be enough for a reader must have it."""

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await begun(terrace)
        owner = terrace.homes[0]
        place = next(spot for spot in spots if spot in arc_of(owner))
        former = holders_of(terrace, owner, place)
        for home in former:
            home.is_deaf = True
        learn(turned(copies, 1), [home for home in terrace.homes if home not in former])
        await trio.sleep(5.0)
        assert [await said(home, place) for home in former] == [1, 1]
        (reason,) = await put(owner, record_at(place, seq=2))
        told = [await said(home, place) for home in former]
        assert reason == RejectReason.NOT_READY or told != [1, 1], "who asks those two would be told something older than what counts"
        assert await read(owner, place) in [(1, False), (2, reason != 0)]
        former[0].is_deaf = False
        await until(lambda: layout_of(former[0]) == layout_of(owner))
        await until(lambda: owner.living.parts.knowing.knows_all(former[0].member))
        assert await put(owner, record_at(place, seq=3)) == [0]
        assert await read(owner, place) == (3, False)
        told_now = await word(former[0], place)
        # Where no write waits for it, it may lag; but then there are too few beside the owner for any reader.
        assert told_now is None or told_now[0] == 3 or told_now[1].quorum > len(told_now[1].members) - 1
        former[1].is_deaf = False
        await until(lambda: lies_as_it_should(terrace, spots, copies), 180.0)

    played(main, homes=5, seed=7)


def test_an_owner_that_does_not_know_of_it_goes_on_and_learns_it() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await begun(terrace)
        owner = terrace.homes[0]
        mine = [spot for spot in spots if spot in arc_of(owner)]
        owner.is_deaf = True
        # Who decides the scene's log tells everybody; on this terrace that is none of them.
        learn(turned(2, 2), terrace.homes[1:])
        await trio.sleep(12.0)
        assert await put(owner, *(record_at(place, seq=2) for place in mine)) == [0] * len(mine)
        assert all(sum(place in home.places() for home in terrace.homes) >= 3 for place in mine), "its holders give nothing up before"
        owner.is_deaf = False
        await terrace.homes[1].living.parts.knowing.teach(owner.member)
        await until(lambda: lies_as_it_should(terrace, spots, 2), 180.0)
        assert [await read(owner, place) for place in mine] == [(2, False)] * len(mine)

    played(main, homes=4, seed=8)


def test_nobody_gets_a_piece_who_may_go_by_an_older_header() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await begun(terrace)
        first, second = terrace.homes[:2]
        second.is_deaf = True
        learn(turned(4, 2), [home for home in terrace.homes if home is not second])
        arc = arc_of(first)
        piece = Arc(spots[9], arc.last)
        await trio.sleep(12.0)
        with pytest.raises(Refused, match=r"which spaces have other copies|has not taken a header") as refused:
            await first.living.give(Side.RIGHT, piece, why="a test")
        assert refused.value.reason is RejectReason.NOT_READY
        second.is_deaf = False
        await until(lambda: not first.living.busy(Side.RIGHT))
        await first.living.give(Side.RIGHT, piece, why="a test")
        assert layout_of(second) == layout_of(first)
        await until(lambda: lies_as_it_should(terrace, spots, 4), 180.0)
        assert await put(second, record_at(spots[10], seq=2)) == [0]

    played(main, homes=5, seed=9)


@pytest.mark.expect_log("the connection was cut|was reset by the peer")
def test_an_owner_that_crashes_in_the_midst_of_it_goes_on() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await begun(terrace)
        owner = terrace.homes[0]
        mine = [spot for spot in spots if spot in arc_of(owner)]
        for step, (copies, after_s) in enumerate([(1, 0.05), (4, 0.7), (2, 1.5)], 2):
            learn(turned(copies, min(copies, 2), step), terrace.homes)
            await trio.sleep(after_s)
            owner.crash()
            await trio.sleep(0.2)
            await owner.up.wait()
            await until(lambda copies=copies: lies_as_it_should(terrace, mine, copies), 180.0)  # type: ignore[misc]
            await until(lambda: owner.living.parts.unsettled.is_quiet)
            assert await put(owner, *(record_at(place, seq=step) for place in mine)) == [0] * len(mine)

    played(main, homes=5, seed=10)


def test_what_was_given_to_the_disk_by_an_old_header_is_not_missed() -> None:
    """A write that was verified before the space turned goes by what is known when it is stored."""

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await begun(terrace)
        owner = terrace.homes[0]
        place = next(spot for spot in spots if spot in arc_of(owner))
        alone = turned(1, 1)
        learn(alone, terrace.homes)
        await until(lambda: lies_as_it_should(terrace, spots, 1), 180.0)
        old = dict(owner.scenes)
        learn(turned(3, 2, 3), terrace.homes)
        await until(lambda: all(map(is_settled_now, terrace.homes)), 180.0)
        (kept,) = await owner.replication.spreading.put([Put(record_at(place, seq=2))], old)
        assert not getattr(kept, "reason", 0)
        holders = holders_of(terrace, owner, place)
        assert len(holders) == 2
        found = [await said(home, place) for home in holders]
        assert 2 in found, "it was acknowledged, and nobody who is asked knows of it"

    def is_settled_now(home: Home) -> bool:
        found = home.copies.configurations
        layout = layout_of(home)
        mine = [segment for segment in found.segments if segment.layout == layout]
        return bool(mine) and all(segment.is_idle(home.member) for segment in mine)

    played(main, homes=4, seed=11)


def test_the_first_header_is_that_of_a_space_that_never_turned() -> None:
    assert not SCENE.turns and SCENE.turned == 0 and HEADER.spaces[1].offset == FIRST
    known = KnownScene.of(turned(4, 2, 5))
    assert known.turned == 5 and known.turns[THRICE].may_have_had(THIRDS) and not known.turns[THRICE].may_have_had(known.layouts[THRICE])
