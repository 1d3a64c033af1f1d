"""If one fails, the harness of the tests of copies is not what they take it for."""

from __future__ import annotations

import trio

from scenefold.base.location import WHOLE_LINE
from scenefold.store import Put
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import HEADER, OBJECTS, SCENE, THIRDS, THRICE, Terrace, item_of, object_record, record_at
from unit.peer.scenes_made import SPACE


def test_the_scene_has_spaces_with_copies_and_one_without() -> None:
    assert SCENE.layouts == {SPACE: (), THRICE: THIRDS, OBJECTS: THIRDS}
    assert SCENE.needed == {SPACE: 1, THRICE: 2, OBJECTS: 2}


def test_houses_know_each_other_and_take_records() -> None:
    async def main() -> None:
        terrace = Terrace(3)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            for home in terrace.homes:
                assert home.routing.owners == [(other.node, other.living.arc) for other in terrace.homes]
                assert home.roster.alive() == [other.node for other in terrace.homes]
            first = terrace.homes[0]
            arc = first.living.arc
            assert arc is not None
            spots = places(arc, 3)
            await first.store.put([Put(record_at(place)) for place in spots])
            assert first.places() == set(spots)
            assert first.durable_copies() == first.copies
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=100.0, wall_s_max=60.0)


def test_records_and_objects_can_be_handed_over() -> None:
    place = places(WHOLE_LINE, 2)[1]
    assert item_of(record_at(place)).location == place
    thing = item_of(object_record(b"t" * 16))
    assert (thing.scene, thing.space, thing.object) == (HEADER.scene, OBJECTS, b"t" * 16)
