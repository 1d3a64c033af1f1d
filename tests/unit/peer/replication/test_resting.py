"""If one fails, repair that was paused goes on, does not go on again, or a pause takes copies that a write needs."""

from __future__ import annotations

from collections.abc import Sequence

import trio

from scenefold.base.location import Location
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, Blacklist
from scenefold.peer.replication.placing_wishes import target_of
from scenefold.store import Put
from unit.peer.line.street import places
from unit.peer.replication.terrace import THIRDS, Home, Terrace, record_at
from unit.peer.replication.test_comparing import arc_of, holders_of, is_settled, lies_with_all, played
from unit.peer.replication.test_placing import until

PAYLOAD = b"x" * 4_000
LONG_S = 30.0
"""Repair would have done all of it several times over."""


def forbid(home: Home, *others: Home) -> None:
    assert home.own is not None
    home.own.blacklist = Blacklist(home.own.blacklist.version + 1, tuple(sorted(AddressPrefix(one.node, ADDRESS_BITS) for one in others)))


def rest(home: Home, *, rests: bool) -> None:
    home.living.parts.resting.repair = rests


async def filled(terrace: Terrace, count: int) -> list[Location]:
    """Records that all of their holders have."""
    first = terrace.homes[0]
    await until(lambda: all(map(is_settled, terrace.homes)))
    spots = places(arc_of(first), count)
    await first.store.put([Put(record_at(place, payload=PAYLOAD)) for place in spots])
    first.replication.comparing.check_all()
    await until(lambda: lies_with_all(terrace, first, spots))
    return spots


def with_new_holders(terrace: Terrace, first: Home, spots: Sequence[Location]) -> dict[Location, list[Home]]:
    """Who is to have each of these and has it."""
    found: dict[Location, list[Home]] = {}
    for place in spots:
        segment = first.copies.configurations.at(THIRDS, place)
        assert segment is not None
        target = target_of(segment, first.member)
        assert target is not None
        found[place] = [home for home in terrace.homes if home.member in target[0] and place in home.places()]
    return found


def test_copies_that_are_complete_are_not_compared_while_repair_rests() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        rest(first, rests=True)
        spots = places(arc_of(first), 50)
        # Behind the back of everything, as if debts had been lost.
        await first.store.put([Put(record_at(place)) for place in spots])
        first.replication.comparing.check_all()
        await trio.sleep(LONG_S)
        assert not any(home.places() & set(spots) for home in terrace.homes[1:])
        rest(first, rests=False)
        await until(lambda: lies_with_all(terrace, first, spots))

    played(main)


def test_as_many_as_a_write_needs_are_completed_and_no_more() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 60)
        former = holders_of(terrace, first, spots[0])
        spots = [place for place in spots if holders_of(terrace, first, place) == former]
        rest(first, rests=True)
        others = [home for home in terrace.homes if home is not first and home not in former]
        assert len(others) == 2
        # Where both comparisons end at once both count: one cannot end before the other has.
        terrace.net.cut(first.address, others[1].address)
        forbid(first, *former)

        def is_needed_there() -> bool:
            return all(others[0] in holders for holders in with_new_holders(terrace, first, spots).values())

        await until(is_needed_there)
        terrace.net.mend(first.address, others[1].address)
        await trio.sleep(LONG_S)
        assert all(len(holders) == 1 for holders in with_new_holders(terrace, first, spots).values()), (
            "and two are needed, the owner among them"
        )
        kept = set().union(*(home.places() for home in former))
        assert kept >= set(spots), "what was acknowledged by them still counts"
        rest(first, rests=False)
        await until(lambda: is_settled(first))
        assert all(len(holders) == 2 for holders in with_new_holders(terrace, first, spots).values())

    played(main, homes=5, seed=17)


def test_what_is_under_way_is_broken_off_and_what_came_stays() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 300)
        former, *others = holders_of(terrace, first, spots[0])
        spots = [place for place in spots if holders_of(terrace, first, place) == [former, *others]]
        (spare,) = [home for home in terrace.homes if home not in (first, former, *others)]
        assert not spare.places() & set(spots)
        first.living.parts.budget.bytes_per_s = 8_000.0
        forbid(first, former)
        await until(lambda: bool(spare.places() & set(spots)))
        broken_off = first.living.parts.events["comparisons broken off"]
        rest(first, rests=True)
        await until(lambda: first.living.parts.events["comparisons broken off"] > broken_off)
        # What was on its way, or waited for the budget, still comes.
        await trio.sleep(LONG_S)
        came = spare.places() & set(spots)
        await trio.sleep(2 * LONG_S)
        assert spare.places() & set(spots) == came < set(spots)
        assert first.replication.comparing.left.segments > 0
        first.living.parts.budget.bytes_per_s = 1e9
        rest(first, rests=False)
        await until(lambda: is_settled(first) and lies_with_all(terrace, first, spots))

    played(main, seed=3)
