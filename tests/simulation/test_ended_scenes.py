"""If this fails, a scene that was ended goes on somewhere, is brought back by who was away, or leaves its data on disks for ever."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import trio

from scenefold.base.errors import LocalFault, Refused, ScenefoldError
from scenefold.base.ids import SceneId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.store.layout import HEADERS, LOGS, NOTES, RECORDS, log_note, scene_key
from scenefold.wire import SceneMode
from simulation.test_client_participants import BOX, STEP, Court, held

PLACES = [Location.from_number(((2 * number + 1) << 160) // 16) for number in range(8)]


async def made(court: Court, *slots: int, records: int = 8) -> None:
    """A scene that these decide, or the origin alone, with a hall full of records."""
    court.scene = await court.client.scenes.create("kitchen", participants=[court.entry(slot) for slot in slots] if slots else 0)
    court.hall = await court.scene.create_space("hall", BOX)
    await court.hall.put_many([(place, b"a pot") for place in PLACES[:records]])


def disk_of(court: Court, slot: int) -> dict[str, list[bytes]]:
    """What lies on a node's disk of the scene: keys, by table."""
    node, scene = court.cluster.nodes[slot], court.scene
    disk = court.cluster.net.machine(node.address).disk
    prefixes = {RECORDS: scene_key(scene.id), LOGS: scene.genesis, NOTES: log_note(scene.id), HEADERS: scene_key(scene.id)}
    return {table: [key for key in disk.peek(table) if key.startswith(prefix)] for table, prefix in prefixes.items()}


def is_empty(court: Court, slot: int) -> bool:
    """Whether nothing but the header is left there."""
    left = disk_of(court, slot)
    return not (left[RECORDS] or left[LOGS] or left[NOTES]) and len(left[HEADERS]) == 1


async def all_empty(court: Court, slots: Sequence[int], within_s: float = 120.0) -> None:
    await court.until(lambda: all(is_empty(court, slot) for slot in slots), within_s)


async def is_over(court: Court, scene: Scene) -> None:
    """Nobody reads, writes or changes it, and each is told why."""
    hall = court.hall
    for attempt in (lambda: hall.put(PLACES[0], b"a pan"), lambda: hall.translate(STEP), scene.access.read_log):
        with pytest.raises(Refused, match="was ended at position") as told:
            await attempt()
        assert told.value.reason is RejectReason.MODE_FORBIDS


@pytest.mark.parametrize("deciding", [(), (0, 1, 2)], ids=["by its origin", "by participants"])
def test_a_scene_ends_and_its_data_goes_from_all_disks(deciding: tuple[int, ...]) -> None:
    async def main(court: Court) -> None:
        await made(court, *deciding)
        planned = await court.scene.end(dry_run=True)
        assert (planned.position, planned.records) == (None, 8)
        assert [one.name for one in await court.client.scenes.list()] == ["kitchen"]
        ended = await court.scene.end()
        assert ended.position == 3 and not ended.was_ended
        again = await court.scene.end()
        assert (again.position, again.was_ended) == (3, True)
        await is_over(court, court.scene)
        await all_empty(court, range(4))
        assert await court.client.scenes.list() == []
        (kept,) = await court.client.scenes.list(ended=True)
        assert kept.is_ended and kept.name == "kitchen"
        with pytest.raises(LocalFault, match="was ended"):
            await court.client.scenes.create("kitchen")
        with pytest.raises(Refused, match="ended"):
            await court.hall.get(PLACES[0])
        await is_over(court, await court.client.scenes.open("kitchen"))
        court.crash(*range(4))
        await court.start(*range(4))
        assert all(is_empty(court, slot) for slot in range(4))
        assert (await (await court.client.scenes.open("kitchen")).end()).was_ended
        court.scene = await court.client.scenes.create("parlour")
        await court.until(lambda: all(court.position(slot) for slot in range(4)))
        assert [one.name for one in await court.client.scenes.list()] == ["parlour"]

    held(4, main)


@pytest.mark.parametrize(("deciding", "away"), [((), 3), ((0, 1, 2), 2)], ids=["by its origin", "a participant"])
def test_who_was_away_holds_it_up_and_brings_nothing_back(deciding: tuple[int, ...], away: int) -> None:
    async def main(court: Court) -> None:
        await made(court, *deciding)
        await trio.sleep(20.0)
        court.crash(away)
        there = [slot for slot in range(4) if slot != away]
        await court.scene.end()
        await court.until(lambda: all(court.position(slot) == 3 for slot in there))
        await trio.sleep(60.0)
        assert any(disk_of(court, slot)[RECORDS] for slot in there), "somebody may still believe that it goes on"
        assert disk_of(court, away)[RECORDS]
        await court.start(away)
        await all_empty(court, range(4), 300.0)
        await trio.sleep(120.0)
        assert all(is_empty(court, slot) for slot in range(4))
        context = court.cluster.nodes[away].context
        assert context is not None
        known = context.scenes.here(SceneId(court.scene.id))
        assert known is not None and known.public.mode is SceneMode.ENDED

    held(4, main)


def test_all_die_while_they_let_go_and_go_on_where_they_were() -> None:
    async def main(court: Court) -> None:
        await made(court, 0, 1, 2)
        await court.scene.end()
        # Some have dropped what they held by then, and some have not.
        await court.until(lambda: any(is_empty(court, slot) for slot in range(4)))
        court.crash(*range(4))
        await court.start(*range(4))
        await all_empty(court, range(4))
        with pytest.raises(ScenefoldError, match="ended"):
            await court.hall.get(PLACES[0])

    held(4, main)


def test_it_is_ended_in_edit_mode_by_owners_alone() -> None:
    from scenefold.client.modes import set_mode

    async def main(court: Court) -> None:
        await made(court, 0, 1, 2, records=1)
        await set_mode(court.scene.access, SceneMode.RENDER)
        for dry_run in (True, False):
            with pytest.raises(Refused, match="render mode") as told:
                await court.scene.end(dry_run=dry_run)
            assert "scene mode kitchen edit" in told.value.remedy
        await set_mode(court.scene.access, SceneMode.EDIT)
        court.crash(1, 2)
        with pytest.raises(ScenefoldError):
            await court.scene.end()
        await court.start(1, 2)
        await court.scene.end()
        await all_empty(court, range(3))

    held(3, main)
