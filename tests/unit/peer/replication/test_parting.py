"""If one fails, a node never leaves a small cluster, or takes the only copy of something with it."""

from __future__ import annotations

import pytest
import trio

from scenefold.base.location import Location
from scenefold.peer.line import Side
from scenefold.peer.line.parting import lies_with_all_others
from scenefold.store import Outcome, Put, PutResult
from scenefold.wire import OfferStrays
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import SPACE, Home, Terrace, record_at
from unit.peer.replication.test_custody_strays import BUSY, held_of
from unit.peer.replication.test_placing import is_told, until


async def written(home: Home, spots: list[Location]) -> None:
    results = await home.replication.spreading.put([Put(record_at(place)) for place in spots], home.scenes)
    assert [isinstance(result, PutResult) and result.outcome for result in results] == [Outcome.STORED] * len(spots)


async def emptied(home: Home) -> None:
    """The last node gives all that it owns to the one before it, as one that leaves does."""
    arc = home.living.arc
    assert arc is not None
    await until(lambda: home.living.settled(arc))
    await home.living.give(Side.LEFT, arc, why="it leaves")
    await until(lambda: home.living.arc is None and not home.living.open_handovers())


@pytest.mark.parametrize("houses", [2, 3])
def test_who_leaves_waits_for_others_in_its_stead_where_there_can_be_any(houses: int) -> None:
    async def main() -> None:
        terrace = Terrace(houses)
        leaving = terrace.homes[-1]
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: all(map(is_told, terrace.homes)))
            arcs = [home.living.arc for home in terrace.homes]
            spots = [place for arc in arcs if arc is not None for place in places(arc, 4)]
            for home, arc in zip(terrace.homes, arcs, strict=True):
                await written(home, [place for place in spots if arc is not None and place in arc])
            assert not await lies_with_all_others(leaving.living.parts), "it owns some of it"
            await emptied(leaving)
            parts = leaving.living.parts
            if houses == 2:
                with trio.fail_after(30.0):
                    while not await lies_with_all_others(parts):  # noqa: ASYNC110 - services tell nobody how far they are
                        await trio.sleep(1.0)
                assert leaving.places() == terrace.homes[0].places() == set(spots)
                await parts.store.merge([Put(record_at(spots[0], space=SPACE))])
                assert not await lies_with_all_others(parts), "a stray of a space with one copy comes home first"
            else:
                assert not await lies_with_all_others(parts)
                await until(lambda: not leaving.places())
            nursery.cancel_scope.cancel()

    run_simulated(5, main, virtual_s_max=400.0, wall_s_max=120.0)


def test_what_an_owner_lacks_or_has_not_settled_lies_nowhere_else() -> None:
    async def main() -> None:
        terrace = Terrace(2)
        owner, other = terrace.homes
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: all(map(is_told, terrace.homes)))
            arc = owner.living.arc
            assert arc is not None
            spots = places(arc, 3)
            await written(owner, spots)
            offer = OfferStrays(tuple(held_of(record_at(place)) for place in spots))
            few = 22
            assert (await owner.asked(offer, other.node)).reasons == (few,) * 3
            newer = OfferStrays((held_of(record_at(spots[0], seq=2)),))
            assert (await owner.asked(newer, other.node)).reasons == (BUSY,)
            owner.leased = False
            assert (await owner.asked(offer, other.node)).reasons == (BUSY,) * 3
            nursery.cancel_scope.cancel()

    run_simulated(6, main, virtual_s_max=200.0, wall_s_max=120.0)
