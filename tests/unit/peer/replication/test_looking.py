"""If one fails, what a holder has lost in silence waits for the hour though a reader met it, or readers keep an owner busy."""

from __future__ import annotations

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.location import Location
from scenefold.peer.replication import looking
from scenefold.store import Put
from scenefold.wire import CompareRange, LookAtCopies, RecordKey
from unit.peer.line.street import places
from unit.peer.replication.terrace import HEADER, SPACE, THRICE, Home, Terrace, record_at
from unit.peer.replication.test_comparing import arc_of, holders_of, played
from unit.peer.replication.test_healing import filled
from unit.peer.replication.test_placing import until


async def told(owner: Home, holder: Home, spots: list[Location], *, space: int = THRICE) -> int:
    """What a reader tells the owner; how many places it is going to look at."""
    packet = LookAtCopies(HEADER.scene, holder.node, tuple(RecordKey(space, place, b"") for place in spots))  # type: ignore[arg-type]
    answer = await owner.asked(packet)
    taken: int = answer.taken
    return taken


def test_what_a_holder_lost_or_has_older_comes_to_it_and_what_it_has_newer_comes_home() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await filled(terrace, 12)
        first = terrace.homes[0]
        holder = holders_of(terrace, first, spots[0])[0]
        mine = [place for place in spots if holder in holders_of(terrace, first, place)]
        lost, newer = mine[:2], mine[2]
        await holder.store.discard([holder.spot(place) for place in lost])
        await holder.store.merge([Put(record_at(newer, seq=2))])
        assert await told(first, holder, [*lost, newer]) == 3
        await until(lambda: set(lost) <= holder.places())
        with trio.fail_after(60):
            while (await first.store.get_many([first.spot(newer).place]))[0].header.seq != 2:  # type: ignore[union-attr]  # noqa: ASYNC110
                await trio.sleep(0.2)
        assert first.living.parts.events["looked at for readers"] == 3
        assert await told(first, holder, mine[:3]) == 0, "not so soon again"
        await trio.sleep(looking.AGAIN_S)
        assert await told(first, holder, mine[:3]) == 3

    played(main)


def test_only_holders_of_own_places_are_looked_at() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await filled(terrace, 8)
        first, other = terrace.homes[:2]
        holder = holders_of(terrace, first, spots[0])[0]
        theirs = places(arc_of(other), 2)
        assert await told(first, first, spots[:1]) == 0
        assert await told(first, holder, theirs) == 0
        assert await told(first, holder, spots[:1], space=SPACE) == 0, "it has one copy"
        strangers = [home for home in terrace.homes if home is not first and home not in holders_of(terrace, first, spots[0])]
        assert [await told(first, stranger, spots[:1]) for stranger in strangers] == [0] * len(strangers)
        with pytest.raises(Refused):
            await first.asked(LookAtCopies(SceneId(5), holder.node, ()))

    played(main, seed=2)


def test_however_much_is_told_so_much_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        spots = await filled(terrace, 4)
        first = terrace.homes[0]
        holder = holders_of(terrace, first, spots[0])[0]
        mine = [place for place in places(arc_of(first), 3_000) if holder in holders_of(terrace, first, place)]
        asked: list[int] = []
        ask = first.peers.ask

        async def counted(*args: object) -> object:
            if isinstance(args[2], CompareRange):
                asked.append(len(args[2].arcs))
            return await ask(*args)  # type: ignore[arg-type]

        monkeypatch.setattr(first.peers, "ask", counted)
        taken = 0
        for start in range(0, len(mine), 64):
            taken += await told(first, holder, mine[start : start + 64])
        assert taken == looking.QUEUE_MAX
        begun = trio.current_time()
        await trio.sleep(2.0)
        assert sum(asked) <= 64 + (trio.current_time() - begun) / looking.PLACE_S

    played(main, seed=3)
