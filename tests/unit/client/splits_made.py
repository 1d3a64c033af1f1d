"""Scenes with records to split, and nodes that end a client in the midst of it."""

from __future__ import annotations

import numpy as np
import trio

from scenefold.base.location import Location
from scenefold.client.scene import Scene
from scenefold.client.sealing import Opened
from scenefold.client.space import Space
from scenefold.scene.payloads.geometry import encode_atom
from scenefold.scene.payloads.splits import is_part
from scenefold.wire import Packet, PutMany
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes

AT = Location.from_number(1 << 158)


def atom(triangles: int = 40, seed: int = 1, prototype: int = 0) -> bytes:
    """Triangles in the unit box."""
    dice = np.random.default_rng(seed)
    corners = np.sort(dice.integers(0, 3 * triangles, (triangles, 3)), axis=0).astype(np.uint32)
    positions = dice.random((3 * triangles, 3)).astype(np.float32)
    return encode_atom(prototype, 0, positions, None, None, corners, np.zeros(triangles, np.uint16))


class Ending(FakeNodes):
    """From the `left`-th write of records on, whoever writes is ended: before it was carried out, or, if `carried_out`, behind it."""

    left: int | None = None
    carried_out = False
    scope: trio.CancelScope | None = None

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if not isinstance(packet, PutMany) or self.left is None:
            return await super().request(address, priority, packet, timeout)
        self.left -= 1
        is_last = self.left <= 0
        if not is_last or self.carried_out:
            reply = await super().request(address, priority, packet, timeout)
        if is_last:
            assert self.scope is not None
            self.scope.cancel()
            await trio.lowlevel.checkpoint()
        return reply


async def ended_at(nodes: Ending, write: int, work: object, *, carried_out: bool) -> bool:
    """Do some work until its write of this number, from 1 on; whether it was ended there."""
    nodes.left, nodes.carried_out = write, carried_out
    with trio.CancelScope() as nodes.scope:
        await work()  # type: ignore[operator]
    nodes.left = None
    return nodes.scope.cancelled_caught


async def lying(space: Space) -> dict[Location, Opened]:
    """What lies in a space, as it lies there; no deletions."""
    places = [location async for location in space.query(deleted=True)]
    found = await space._access.get([(space.id, place) for place in places])
    return {place: one for place, one in zip(places, found, strict=True) if one is not None and not one.deleted}


async def part_places(space: Space) -> list[Location]:
    return [place for place, one in (await lying(space)).items() if is_part(one.payload)]


async def listed(space: Space) -> list[Location]:
    return [location async for location in space.query()]


async def hall_of(scene: Scene) -> Space:
    """A space of one's own."""
    return await scene.create_space("hall", ((0.0,) * 3, (1.0,) * 3))
