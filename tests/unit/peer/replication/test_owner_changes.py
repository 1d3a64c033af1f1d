"""If one fails, copies do not follow when bounds move or owners crash, or a node for ever waits for what nobody says."""

from __future__ import annotations

import pytest
import trio

from scenefold.base.location import Arc, Location
from scenefold.peer.line.ends import Side
from scenefold.store import Put
from unit.peer.line.street import places
from unit.peer.replication.terrace import Terrace, record_at
from unit.peer.replication.test_comparing import arc_of, holders_of, is_settled, lies_with_all, played
from unit.peer.replication.test_placing import until


async def filled(terrace: Terrace, number: int, count: int) -> list[Location]:
    """Records in a node's arc, at all who hold them."""
    home = terrace.homes[number]
    await until(lambda: all(map(is_settled, terrace.homes)))
    spots = places(arc_of(home), count)
    await home.store.put([Put(record_at(place)) for place in spots])
    home.replication.comparing.check_all()
    await until(lambda: lies_with_all(terrace, home, spots))
    return spots


def test_who_takes_a_piece_goes_on_with_those_who_hold_it() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first, second = terrace.homes[:2]
        spots = await filled(terrace, 0, 60)
        await trio.sleep(12.0)
        arc = arc_of(first)
        piece = Arc(spots[30], arc.last)
        await first.living.give(Side.RIGHT, piece, why="a test")
        assert arc_of(second).first == piece.first
        await until(lambda: all(map(is_settled, terrace.homes)), 90.0)
        assert lies_with_all(terrace, first, spots[:30])
        assert lies_with_all(terrace, second, spots[30:])
        for home, place in ((first, spots[0]), (second, spots[40])):
            assert len(holders_of(terrace, home, place)) == 2
        segments = [segment for segment in second.copies.configurations.segments if spots[40] in segment.arc]
        assert [segment.configurations[0].members[0] for segment in segments] == [second.member], (
            "who answered for the former owner is over"
        )

    played(main, seed=5)


@pytest.mark.expect_log("the connection was cut|was reset by the peer")
@pytest.mark.parametrize("after_s", [0.3, 1.0, 2.5])
def test_an_owner_that_crashes_goes_on_where_it_was(after_s: float) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = places(arc_of(first), 100)
        await first.store.put([Put(record_at(place)) for place in spots])
        await trio.sleep(after_s)
        first.crash()
        await trio.sleep(0.2)
        await first.up.wait()
        await until(lambda: all(map(is_settled, terrace.homes)), 90.0)
        await until(lambda: lies_with_all(terrace, first, spots))

    played(main, seed=6)


@pytest.mark.expect_log("the connection was cut|was reset by the peer")
def test_a_holder_that_was_down_gets_what_it_missed() -> None:
    async def main(terrace: Terrace, nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 0, 20)
        holder = holders_of(terrace, first, spots[0])[0]
        holder.stays_down = True
        holder.crash()
        await trio.sleep(3.0)
        mine = [place for place in spots if holder in holders_of(terrace, first, place)]
        await first.store.put([Put(record_at(place, seq=2)) for place in mine])
        first.replication.comparing.check_all()
        await until(lambda: not first.roster.is_believed_alive(holder.node))
        holder.stays_down = False
        nursery.start_soon(holder.run)
        await holder.up.wait()

        async def has_newest() -> bool:
            found = await holder.store.get_many([holder.spot(place).place for place in mine])
            return all(record is not None and record.header.seq == 2 for record in found)

        with trio.fail_after(60.0):
            while not await has_newest():  # noqa: ASYNC110 - a disk tells nobody what it has
                await trio.sleep(0.5)

    played(main, seed=7)


@pytest.mark.expect_log("the connection was cut|was reset by the peer|had no owner any more|is not known until")
def test_what_a_lost_owner_had_gets_all_its_copies_again() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await filled(terrace, 1, 40)
        lost = terrace.homes[1]
        lost.stays_down = True
        lost.crash()
        terrace.remove(1)
        rest = [home for home in terrace.homes if home is not lost]

        def are_all_there() -> bool:
            owners = [home for home in rest for place in spots if home.living.owns(place)]
            return len(owners) == len(spots) and all(map(is_settled, rest)) and not any(home.copies.unrecovered for home in rest)

        await until(are_all_there, 200.0)
        for place in spots:
            (owner,) = [home for home in rest if home.living.owns(place)]
            assert len(holders_of(terrace, owner, place)) == 2
            assert lies_with_all(terrace, owner, [place])

    played(main, seed=8)
