"""If one fails, strays of a node that is away keep those of all others from coming home."""

from __future__ import annotations

import pytest
import trio

from scenefold.peer.line import strays
from scenefold.store import Put
from scenefold.world.sim import run_simulated
from unit.peer.line.street import Street, places, record_at


def test_an_owner_that_is_silent_holds_up_its_own_strays_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strays, "BATCH_RECORDS", 4)

    async def main() -> None:
        street = Street(3)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            holder, silent, other = street.houses
            while other.durable() is None:  # noqa: ASYNC110 - its founding tells nobody
                await trio.sleep(0.1)
            street.net.cut(holder.address, silent.address)
            theirs, others = places(silent.durable().arc, 40), places(other.durable().arc, 8)
            await holder.store.merge([Put(record_at(place)) for place in (*theirs, *others)])
            # It looks after a minute at the latest, and waits for the silent one once.
            await trio.sleep(100.0)
            assert other.stored() == set(others)
            street.net.mend(holder.address, silent.address)
            await street.until_whole()
            assert silent.stored() == set(theirs)
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)
