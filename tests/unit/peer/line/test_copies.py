"""If one fails, a handover loses a record whose ciphertext somebody has put at another place, too."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.location import Arc
from scenefold.crypto import RECORD_DOMAIN, Record
from scenefold.peer.line import Side, copying
from scenefold.store import Put
from scenefold.world.sim import run_simulated
from unit.peer.line.street import Street, record_at
from unit.peer.scenes_made import WRITER


def test_a_ciphertext_that_lies_at_two_places_is_copied_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copying, "HANDOVER_BATCH_RECORDS_MAX", 4)

    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            spots = await street.fill(0, 16)
            # A writer cannot open what it copies, but it can sign it for another place.
            victim = record_at(spots[-1])
            header = replace(victim.header, location=spots[8], seq=2).encode()
            forged = Record(header, WRITER.sign(RECORD_DOMAIN, header), victim.ciphertext)
            await street.houses[0].store.put([Put(forged)])
            await trio.sleep(11.0)
            giver = street.houses[0].line
            assert giver is not None and giver.arc is not None
            await giver.give(Side.RIGHT, Arc(spots[8], giver.arc.last), why="a test")
            await street.until_whole()
            street.check()
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)
