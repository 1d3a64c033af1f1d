"""If one fails, a disk on which much has rotted counts as healthy, or what rotted on it past knowing counts as copied."""

from __future__ import annotations

from collections.abc import Sequence

import hypothesis.strategies as st
import pytest
import trio
from hypothesis import given, settings

from scenefold.base.errors import DamagedData
from scenefold.base.location import Arc, Location
from scenefold.crypto import Record
from scenefold.peer.replication import healing
from scenefold.store import noticing
from unit.peer.line.street import rot
from unit.peer.replication.terrace import SCENE, THRICE, Home, Terrace
from unit.peer.replication.test_comparing import arc_of, holders_of, is_settled, played
from unit.peer.replication.test_healing import HEADER_BYTE, LAST_BYTE, filled, until_sound
from unit.peer.replication.test_husks import forbid
from unit.peer.replication.test_placing import until

SAID = pytest.mark.expect_log("damaged|rotten|changed")


async def met(home: Home, spots: Sequence[Location]) -> list[Record | DamagedData | None]:
    """Somebody reads these there."""
    return await home.store.read([home.spot(place) for place in spots])


@SAID
def test_what_is_met_while_many_others_are_asked_for_is_asked_for_after_these(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(healing, "QUEUE_MAX", 2)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 7)
        rot(first, spots, LAST_BYTE)
        await met(first, spots)
        document = await first.replication.health.document()
        assert document["rotten"] == {"waiting": 7, "unhealed": 0, "healed": 0, "more": False}
        for place in spots:
            # What heals is not read again, so nothing here tells of it anew.
            await until(lambda place=place: not first.store.noticed.is_rotten(first.spot(place)))  # type: ignore[misc]
            await until_sound(first, place)
        assert first.replication.healing.waiting == 0

    played(main, seed=11)


@SAID
def test_a_wreck_that_nobody_is_asked_about_yet_holds_up_a_comparison(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(healing, "QUEUE_MAX", 0)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 3)
        awaits_within = first.living.parts.keeping.awaits_within
        scene = SCENE.public.scene
        rot(first, spots[:1], LAST_BYTE)
        await met(first, spots)
        assert not await awaits_within(scene, THRICE, [arc_of(first)]), "its header says which version it is"
        rot(first, spots[1:2], HEADER_BYTE)
        await met(first, spots)
        assert await awaits_within(scene, THRICE, [arc_of(first)])
        assert not await awaits_within(scene, THRICE, [arc_of(terrace.homes[1])])

    played(main, seed=12)


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 9)), max_size=6), st.integers(0, 50))
def test_a_place_lies_in_any_of_many_arcs(pieces: list[tuple[int, int]], place: int) -> None:
    arcs = [Arc(Location.from_number(first), Location.from_number(first + length)) for first, length in pieces]
    home = Location.from_number(place)
    assert healing._inside(arcs)(home) == any(home in arc for arc in arcs)


@SAID
def test_what_rotted_past_knowing_and_cannot_even_be_remembered_counts_as_copied_to_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 2)
        former, other = holders_of(terrace, first, spots[1])
        (spare,) = [home for home in terrace.homes if home not in (first, former, other)]
        with monkeypatch.context() as patches:
            patches.setattr(noticing, "MET_MAX", 0)
            # Who could give it back does not come to that.
            patches.setattr(healing, "QUEUE_MAX", 0)
            rot(first, spots[1:], HEADER_BYTE)
            forbid(first, former)
            await trio.sleep(60.0)
            assert spare not in whole(first, spots[1])
            document = await first.replication.health.document()
            assert document["rotten"] == {"waiting": 0, "unhealed": 0, "healed": 0, "more": True}
        await until(lambda: spare in holders_of(terrace, first, spots[1]) and is_settled(first))
        await until_sound(spare, spots[1])
        await until_sound(first, spots[1])

    def whole(owner: Home, place: Location) -> list[Home]:
        segment = next(found for found in owner.copies.configurations.segments if place in found.arc)
        return [home for home in owner.street.homes if home.member in segment.sound]

    played(main, seed=27)
