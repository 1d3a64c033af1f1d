"""If this fails, somebody edits a scene that is being rendered, or nobody can edit, or switch, where all is well (specs/26-modes.md, Lent leases)."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest
import trio

from scenefold.base.errors import Refused, ScenefoldError
from scenefold.base.reasons import RejectReason
from scenefold.client.modes import set_mode
from scenefold.client.space import Space
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.timing import T_WAIT_S
from scenefold.simulation.clients import Client, MemoryKeyring, open_client
from scenefold.simulation.cluster import key_of
from scenefold.wire import SceneMode
from simulation.test_client_participants import Court, held


def modes(court: Court, slot: int) -> SceneModes:
    context = court.cluster.nodes[slot].context
    one = None if context is None else context.participation.of(court.scene.id)
    assert one is not None
    return one.modes


def lenders(court: Court, count: int = 3) -> list[int]:
    """Participants that hold for live what they lent."""
    found = []
    for slot in range(count):
        context = court.cluster.nodes[slot].context
        if context is not None and modes(court, slot).standing.lender.borrowers(context.world.clock.now()):
            found.append(slot)
    return found


def place(number: int) -> tuple[float, float, float]:
    return ((number + 0.5) / 64, 0.5, 0.5)


def test_who_edits_borrows_once_and_gives_back() -> None:
    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        for number in range(10):
            await court.hall.put_at(place(number), b"a chair")
        assert len(lenders(court)) == 1
        await court.until(lambda: not lenders(court), 5.0)
        began = trio.current_time()
        shown = await set_mode(court.scene.access, SceneMode.RENDER)
        assert shown.is_active
        with pytest.raises(Refused, match="render mode"):
            await court.hall.put_at(place(11), b"a table")
        assert (await set_mode(court.scene.access, SceneMode.EDIT)).is_active
        await court.hall.put_at(place(12), b"a table")
        assert trio.current_time() - began < 3 * T_WAIT_S

    held(3, main)


def test_a_switch_waits_for_what_is_under_way_and_gets_through() -> None:
    """Somebody writes all the time; whatever was acknowledged is there, and once the mode is active nothing more is."""

    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        stored: list[tuple[int, float]] = []
        refused: list[Refused] = []

        async def write_on() -> None:
            other = await court.client.scenes.open("kitchen")
            space = other.space(court.hall.id)
            for number in range(10_000):
                try:
                    await space.put_at(((number + 0.5) / 10_000, 0.1, 0.1), b"%d" % number)
                except Refused as refusal:
                    refused.append(refusal)
                    return
                stored.append((number, trio.current_time()))
                await trio.sleep(0.05)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write_on)
            await trio.sleep(3.0)
            began = trio.current_time()
            shown = await set_mode(court.scene.access, SceneMode.RENDER)
            active_at = trio.current_time()
            assert shown.is_active and active_at - began < 30.0
            await court.until(lambda: bool(refused), 60.0)
        assert refused[0].reason is RejectReason.MODE_FORBIDS and "render mode" in str(refused[0])
        assert stored and max(at for _, at in stored) < active_at
        found = {payload async for _, payload in _all(court.hall)}
        assert {b"%d" % number for number, _ in stored} <= found

    held(3, main)


async def got(court: Court, at: tuple[float, float, float]) -> bytes | None:
    """What lies there, by its owner's word."""
    space = await court.hall.info()
    return await court.hall.get(space.locations_of([at])[0])


async def _all(space: Space):  # type: ignore[no-untyped-def]
    async for found in space.query_box((0, 0, 0), (1, 1, 1)):
        yield found.location, await space.get(found.location)


@pytest.mark.parametrize("asleep_s", [3.0, 40.0])
def test_a_cut_off_editor_wakes_after_the_switch_and_its_edit_gets_in_nowhere(asleep_s: float) -> None:
    """What it signed in time, and could not send, is below the floor; it signs nothing more."""

    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        await court.hall.put_at(place(0), b"a chair")
        assert lenders(court)
        cluster = court.cluster
        nodes, sleeper = [node.address for node in cluster.nodes.values()], "user:sleeper"
        world, writer = cluster.net.world(sleeper), key_of(1, "the writer")
        async with open_client("sleeper", world, cluster.facts, MemoryKeyring(), writer, cluster.watch.recorder) as editor:
            scene = await editor.scenes.open("kitchen")
            hall = scene.space(court.hall.id)
            await hall.put_at(place(1), b"a chair")
            parted = cluster.net.partition(nodes, [sleeper])
            ended: list[ScenefoldError | str] = []

            async def edit() -> None:
                try:
                    await hall.put_at(place(2), b"too late")
                except ScenefoldError as error:
                    ended.append(error)
                else:
                    ended.append("stored")

            async with trio.open_nursery() as nursery:
                nursery.start_soon(edit)
                shown = await set_mode(court.scene.access, SceneMode.RENDER)
                assert shown.is_active
                await trio.sleep(asleep_s)
                assert await got(court, place(2)) is None
                cluster.net.unite(parted)
                await court.until(lambda: bool(ended), 120.0)
            assert ended != ["stored"]
            with pytest.raises(Refused, match="render mode"):
                await hall.put_at(place(3), b"too late")
            for number, there in ((0, b"a chair"), (1, b"a chair"), (2, None), (3, None)):
                assert await got(court, place(number)) == there

    held(3, main)


def test_force_ends_a_render_and_nobody_edits_before_its_lease_is_over() -> None:
    """It is lent by one of three, and in the second case by two of them, so that no majority can vote before."""

    @asynccontextmanager
    async def renderer(court: Court, name: str) -> AsyncIterator[Client]:
        world, writer = court.cluster.net.world(f"user:{name}"), key_of(1, "the writer")
        async with open_client(name, world, court.cluster.facts, MemoryKeyring(), writer, court.cluster.watch.recorder) as client:
            yield client

    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        access = court.scene.access
        for names in (("r1",), ("r1", "r2", "r3", "r4", "r5")):
            await set_mode(access, SceneMode.RENDER)
            ended: list[tuple[float, str]] = []

            async def render(name: str, begun: trio.Event, ended: list[tuple[float, str]] = ended) -> None:
                async with renderer(court, name) as client:
                    scene = await client.scenes.open("kitchen")
                    try:
                        async with client.calls.leases.rendering(scene.access):
                            begun.set()
                            await trio.sleep_forever()
                    except Refused as refused:
                        ended.append((trio.current_time(), str(refused)))

            async with trio.open_nursery() as nursery:
                for name in names:
                    begun = trio.Event()
                    nursery.start_soon(render, name, begun)
                    await begun.wait()
                with pytest.raises(Refused) as told:
                    await set_mode(access, SceneMode.EDIT)
                assert told.value.reason is RejectReason.BUSY and not ended
                began = trio.current_time()
                shown = await set_mode(access, SceneMode.EDIT, force=True)
                assert shown.is_active and len(ended) == len(names), "all of them had ended"
                assert all("ran out" in words for _, words in ended)
                assert max(at for at, _ in ended) <= trio.current_time() < began + 2 * T_WAIT_S + 5.0
            await court.hall.put_at(place(len(names)), b"a chair")

    held(3, main)


def test_nobody_edits_before_who_renders_has_ended_or_has_lost_his_lease() -> None:
    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        access, leases = court.scene.access, court.client.calls.leases
        await set_mode(access, SceneMode.RENDER)
        async with leases.rendering(access):
            with pytest.raises(Refused) as told:
                await set_mode(access, SceneMode.EDIT)
            assert told.value.reason is RejectReason.BUSY
            assert lenders(court)
        assert (await set_mode(access, SceneMode.EDIT)).is_active
        await set_mode(access, SceneMode.RENDER)

        net, renderer = court.cluster.net, "user:renderer"
        world, writer = net.world(renderer), key_of(1, "the writer")
        async with open_client("renderer", world, court.cluster.facts, MemoryKeyring(), writer, court.cluster.watch.recorder) as other:
            scene = await other.scenes.open("kitchen")
            ended: list[float] = []

            async def render() -> None:
                with pytest.raises(Refused, match="ran out"):
                    async with other.calls.leases.rendering(scene.access):
                        await trio.sleep_forever()
                ended.append(trio.current_time())

            async with trio.open_nursery() as nursery:
                nursery.start_soon(render)
                await court.until(lambda: bool(lenders(court)))
                parted = net.partition([node.address for node in court.cluster.nodes.values()], [renderer])
                shown = None
                while shown is None:
                    # Busy, as long as what was lent is live.
                    with suppress(Refused):
                        shown = await set_mode(access, SceneMode.EDIT)
                assert shown.is_active and ended, "it lost its lease before anybody could edit"
                net.unite(parted)
            await court.hall.put_at(place(1), b"a chair")

    held(3, main)
