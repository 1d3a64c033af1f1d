"""If one fails, a node's report does not say what its copies lack, or counts its store anew whenever somebody looks."""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenefold.base.location import Arc, Location
from scenefold.base.prefixes import AddressPrefix, Blacklist
from scenefold.crypto import Record
from scenefold.peer.replication import health
from scenefold.peer.replication.placing_wishes import Shortage
from scenefold.wire import pack_value
from unit.peer.replication.terrace import SPACE, THIRDS, record_at
from unit.peer.replication.writers import Row, in_a_row, until


async def told(row: Row) -> dict[str, Any]:
    document = await row.owner.replication.health.document()
    pack_value(document)
    return document


async def written(row: Row, count: int) -> list[Record]:
    """So many records with copies, and five without."""
    row.owner.replication.placing.layouts = {THIRDS: 2}
    records = [row.next_at(place) for place in row.places(count)]
    assert all(outcome.reason == 0 for outcome in await row.put(*records))
    await row.put(*(record_at(place, space=SPACE) for place in row.places(5)))
    return records


def test_in_order_it_says_how_much_there_is() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        await written(row, 20)
        await until(lambda: not row.owner.debts())
        document = await told(row)
        assert document["owned"] == {"records": 25, "records_with_copies": 20}
        assert document["segments"] == 1
        assert document["under_copied"] == {"segments": 0, "missing_max": 0, "records": 0}
        assert document["owed"] == {"records": 0, "records_to_silent": 0, "nodes": []}
        assert document["unsettled"] == {"records": 0, "pieces": 0, "read": True}
        assert document["rotten"] == {"waiting": 0, "unhealed": 0, "healed": 0, "more": False}
        assert document["shortages"] == []
        held = await row.homes[1].replication.health.document()
        assert held["held"] == {"segments": 1, "whole": 1}

    in_a_row(story)


def test_a_holder_that_falls_silent_leaves_its_records_under_copied() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        await written(row, 20)
        row.cut_off(2)
        silent = row.homes[2].node
        row.owner.roster.is_believed_alive = lambda node: node != silent
        await row.put(*(row.next_at(place) for place in row.places(3)))
        await until(lambda: row.owner.living.parts.store.owed.keys() == {silent})
        document = await told(row)
        assert document["under_copied"] == {"segments": 1, "missing_max": 1, "records": len({*row.places(20), *row.places(3)})}
        assert document["owed"]["records_to_silent"] == document["owed"]["records"] == 3
        assert document["owed"]["nodes"] == [{"address": row.homes[2].address, "records": 3, "alive": False}]

    in_a_row(story)


def test_where_more_pieces_lack_copies_than_are_counted_their_records_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        monkeypatch.setattr(health, "ARCS_COUNTED_MAX", 2)
        await row.hold(1, 2)
        records = await written(row, 4)
        await until(lambda: not row.owner.debts())
        # Of four pieces apart, of which only the third has a record, the copies are on nobody.
        place = records[2].header.location
        pieces = [Arc(at, at) for at in (_behind(row.arc.first, 1), _behind(row.arc.first, 3), place, row.arc.last)]
        for piece in pieces:
            await row.change(lambda found, piece=piece: found.give(piece)[0])  # type: ignore[misc]
        document = await told(row)
        assert document["under_copied"]["segments"] == 4
        assert document["under_copied"]["records"] >= 1

    in_a_row(story)


def _behind(place: Location, steps: int) -> Location:
    return Location.from_number(place.number + steps)


def test_a_node_that_has_come_back_empty_is_no_copy_though_it_answers() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        await written(row, 20)
        await until(lambda: not row.owner.debts())
        # As another incarnation; the one before may hold a lease for a while, and is no holder that is counted out yet.
        row.remove(2)
        row.owner.roster.is_believed_alive = lambda _node: True
        document = await told(row)
        assert document["under_copied"] == {"segments": 1, "missing_max": 1, "records": 20}
        assert document["by_copies"] == [{"copies": 3, "records": 20, "under_copied": 20, "missing_max": 1, "forbidden": 0}]

    in_a_row(story)


def test_what_a_blacklist_forbids_and_too_few_nodes_are_told() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        await written(row, 4)
        row.owner.replication.placing.shortages = {THIRDS: Shortage(THIRDS, 2, 2, row.owner.node, most=3)}
        assert row.owner.own is not None
        row.owner.own.blacklist = Blacklist(1, (AddressPrefix(row.homes[2].node, 32),))
        document = await told(row)
        assert document["forbidden"] == {"segments": 1, "records": 4, "nodes": [row.homes[2].address]}
        assert document["shortages"] == [{"copies": 3, "needed": 2, "needed_most": 3, "possible": 2, "blacklist_of": row.owner.address}]
        (of,) = document["by_copies"]
        assert (of["copies"], of["records"], of["forbidden"]) == (3, 4, 4)

    in_a_row(story)


def test_records_are_counted_again_only_if_something_has_changed() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        await written(row, 10)
        await until(lambda: not row.owner.debts())
        await trio.sleep(3.0)
        store, counted = row.owner.living.parts.store, 0
        sums = store.sums

        async def counting(*arguments: Any) -> Any:
            nonlocal counted
            counted += 1
            return await sums(*arguments)

        store.sums = counting  # type: ignore[method-assign]
        first = await told(row)
        assert counted
        counted = 0
        assert await told(row) == first
        assert counted == 0
        await trio.sleep(3.0)
        await row.put(*(record_at(place, 2, space=SPACE) for place in row.places(7)))
        assert (await told(row))["owned"]["records"] == 10 + len({*row.places(5), *row.places(7)})
        assert counted

    in_a_row(story)
