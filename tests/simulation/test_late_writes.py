"""If this fails, what was signed under a mode that is over comes in behind the switch, its author having slept between looking at
the lease and sending (design scenarios 30 and 34)."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest
import trio

from scenefold.base.errors import NoLease, Refused, ScenefoldError
from scenefold.base.reasons import RejectReason
from scenefold.client.modes import set_mode
from scenefold.client.scene import Scene
from scenefold.client.space import Space
from scenefold.peer import Handlers
from scenefold.peer.timing import T_LEASE_S
from scenefold.simulation.clients import MemoryKeyring, open_client
from scenefold.simulation.cluster import Node, key_of
from scenefold.wire import LeaseUse, Packet, PutMany, PutManyReply, SceneMode
from simulation.test_client_participants import BOX, Court, held
from simulation.test_editing import got, place

AUTHOR = "user:author"
RATE_ERROR = 0.0099
"""Just within what is assumed of clocks."""


class Door:
    """Where the author's writes come in at nodes. Shut, it keeps them: they are signed, and on their way."""

    def __init__(self) -> None:
        self.is_shut = False
        self.kept: list[PutMany] = []

    async def late(self, court: Court) -> list[int]:
        """What was kept comes to all nodes now; what each says to each record."""
        reasons = []
        for packet in self.kept:
            for node in running(court):
                assert node.context is not None
                reply = await _HANDLE(node.context.handlers, packet, AUTHOR)
                assert isinstance(reply, PutManyReply)
                reasons += [outcome.reason for outcome in reply.outcomes]
        return reasons


_HANDLE = Handlers.handle


@pytest.fixture
def door(monkeypatch: pytest.MonkeyPatch) -> Door:
    one = Door()

    async def handle(self: Handlers, packet: Packet, peer: str) -> Packet | None:
        if one.is_shut and isinstance(packet, PutMany) and peer == AUTHOR:
            one.kept.append(packet)
            await trio.sleep_forever()
        return await _HANDLE(self, packet, peer)

    monkeypatch.setattr(Handlers, "handle", handle)
    return one


def running(court: Court) -> list[Node]:
    return [node for node in court.cluster.nodes.values() if node.context is not None]


@asynccontextmanager
async def author_of(court: Court) -> AsyncIterator[Scene]:
    """The scene as a second client with the writer's key has it, on a machine of its own."""
    world, writer = court.cluster.net.world(AUTHOR), key_of(1, "the writer")
    async with open_client("author", world, court.cluster.facts, MemoryKeyring(), writer, court.cluster.watch.recorder) as client:
        yield await client.scenes.open("kitchen")


def cut_off(court: Court) -> None:
    court.cluster.net.partition([node.address for node in running(court)], [AUTHOR])


def may_act(court: Court, scene: Scene, use: LeaseUse) -> bool:
    """By its own clock."""
    access = scene.access
    assert access.writer is not None
    return access.calls.leases.of(access, access.writer, use).may_sign(access.identity)


async def put_late(space: Space) -> None:
    with pytest.raises(ScenefoldError):
        await space.put_at(place(2), b"too late")


@pytest.mark.parametrize("sign", [1, -1])
def test_30_who_slept_between_look_and_sending_is_refused_whatever_the_clocks_do(door: Door, sign: int) -> None:
    """Its clock is as slow as it may be and theirs, who decide, as fast, or the other way round."""

    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        net = court.cluster.net
        async with author_of(court) as scene:
            net.machine(AUTHOR).clock.set_rate(1 - sign * RATE_ERROR)
            for node in running(court):
                net.machine(node.address).clock.set_rate(1 + sign * RATE_ERROR)
            hall = scene.space(court.hall.id)
            await hall.put_at(place(1), b"in time")
            door.is_shut = True
            async with trio.open_nursery() as nursery:
                nursery.start_soon(put_late, hall)
                await court.until(lambda: bool(door.kept), 1.0)
                cut_off(court)
                cut_at = trio.current_time()
                assert may_act(court, scene, LeaseUse.EDIT)
                assert (await set_mode(court.scene.access, SceneMode.RENDER)).is_active
                assert T_LEASE_S / 2 < trio.current_time() - cut_at < 2 * T_LEASE_S
                assert not may_act(court, scene, LeaseUse.EDIT)
                assert await got(court, place(2)) is None, "and from now on who has told this is fenced"
                reasons = await door.late(court)
                assert RejectReason.MODE_FORBIDS in reasons and 0 not in reasons, reasons
            assert await got(court, place(2)) is None and await got(court, place(1)) == b"in time"

    held(3, main)


def test_34_nobody_edits_while_who_is_cut_off_may_render_and_what_it_made_comes_too_late(door: Door) -> None:
    """The switch is forced, so nobody is asked whether a render is under way."""

    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        sums = await court.scene.create_space("sums", BOX, render_output=True)
        await set_mode(court.scene.access, SceneMode.RENDER)
        async with author_of(court) as scene:
            out = scene.space(sums.id)
            ended_at: list[float] = []
            edited_at: list[float] = []

            async def render() -> None:
                async with scene.access.calls.leases.rendering(scene.access):
                    await out.put_at(place(1), b"a part")
                    door.is_shut = True
                    await put_late(out)
                    await trio.sleep_forever()

            async def render_on() -> None:
                with pytest.raises(NoLease):
                    await render()
                ended_at.append(trio.current_time())

            async def switch() -> None:
                assert (await set_mode(court.scene.access, SceneMode.EDIT, force=True)).is_active

            async def edit() -> None:
                while not edited_at:
                    with suppress(Refused):
                        await court.hall.put_at(place(3), b"a chair")
                        edited_at.append(trio.current_time())
                    await trio.sleep(0.2)

            async with trio.open_nursery() as nursery:
                nursery.start_soon(render_on)
                await court.until(lambda: bool(door.kept), 10.0)
                cut_off(court)
                assert may_act(court, scene, LeaseUse.RENDER)
                nursery.start_soon(switch)
                await edit()
                assert ended_at and ended_at[0] < edited_at[0]
                reasons = await door.late(court)
                assert RejectReason.MODE_FORBIDS in reasons and 0 not in reasons, reasons
            where = (await sums.info()).locations_of([place(1), place(2)])
            parts = [await sums.get(location) for location in where]
            assert parts == [b"a part", None] and await got(court, place(3)) == b"a chair"

    held(3, main)
