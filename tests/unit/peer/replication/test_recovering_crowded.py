"""If this failed, nobody would hear whose word keeps a gap from being recovered; or what was acknowledged by that word would be forgotten."""

from __future__ import annotations

import pytest

from scenefold.base.location import FIRST, Arc
from scenefold.peer.copies import configurations
from scenefold.peer.handlers import Senders
from scenefold.peer.replication.comparing_dialogue import sixteenths
from scenefold.wire import CustodyEntry, HeldListed, ListHeld, Packet
from unit.peer.replication.heirs import Estate, inherit, places_of, spread, until


@pytest.mark.expect_log("was cut|had no owner any more|may be known|were named by 127.0.0.6 .30., 127.0.0.5 .1.: one that")
def test_who_names_more_pieces_than_can_be_kept_is_told_and_holds_a_gap_up_until_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is true of it nobody knows, so none of it may be left out: somebody may still be answered by that."""
    monkeypatch.setattr(configurations, "CONFIGURATIONS_MAX", 20)

    async def story(estate: Estate) -> None:
        arc, liar = await estate.entrust(2, 3), estate.homes[4]
        records = spread(arc, 4)
        for number in (1, 2, 3):
            await estate.homes[number].keep(*records)

        async def lie(packet: ListHeld, _peer: str) -> Packet:
            pieces = sixteenths(Arc(packet.first, packet.last))
            halves = [half for piece in pieces[:15] for half in sixteenths(piece)[:2]]
            told = [
                CustodyEntry((FIRST.next(),), half.first, half.last, 5 + index, (estate.homes[0].member, liar.member), 1, True)
                for index, half in enumerate(halves)
            ]
            return HeldListed(0, (), tuple(told), None)

        liar.handlers._table[ListHeld] = lie, Senders.NODES
        await estate.bury(1)
        heir = await estate.adopted(arc)
        await until(lambda: heir.replication.recovering.crowding)
        assert heir.replication.recovering.crowding == {liar.node: 30, estate.homes[3].node: 1}
        document = await heir.replication.health.document()
        assert document["unrecovered"]["named_most"][0] == {"address": liar.address, "pieces": 30}
        assert heir.gaps == (arc,)
        await estate.bury(4)
        await until(lambda: not heir.gaps, 90.0)
        assert heir.replication.recovering.crowding == {}
        assert heir.places() >= places_of(records)

    inherit(story)
