"""If this fails, a node that cannot write a byte ends, and what it acknowledged reads as if it had never been."""

from __future__ import annotations

import pytest
import trio

from scenefold.crypto import RecordPlace
from scenefold.scene.layout import META
from scenefold.store import Put, Spot
from scenefold.store.layout import RECORDS
from simulation.quiet import Rest, at_rest

FULL_S = 300.0
IN_HEADER, IN_BODY = 10, -1
"""A byte of each part of a stored record."""


async def leave_rotten_stray(rest: Rest, byte: int) -> None:
    """A copy of a record of n2 lies at n1, and has changed on the disk."""
    holder, owner = rest.cluster.nodes[1], rest.cluster.nodes[2]
    assert holder.context is not None and owner.context is not None
    location = rest.places[4]
    [record] = await owner.context.store.read([Spot(RecordPlace(rest.scene.id, META, location))])
    await holder.context.store.merge([Put(record)])  # type: ignore[arg-type]
    key = rest.key(1, 4)
    value = bytearray(holder.disk.peek(RECORDS)[key])
    value[byte] ^= 1
    for folder in holder.disk._folders.values():
        folder.rot(RECORDS, key, bytes(value))


@pytest.mark.parametrize("byte", [IN_HEADER, IN_BODY], ids=["in the header", "in the body"])
def test_a_node_serves_on_with_a_full_disk_and_a_rotten_stray(byte: int) -> None:
    async def look(rest: Rest) -> None:
        node = rest.cluster.nodes[1]
        await leave_rotten_stray(rest, byte)
        node.disk.fill(0)
        await trio.sleep(FULL_S)
        assert node.context is not None and node.starts == 1 and node.context.store.identity.boot == 1
        assert await rest.scene.space(META).get(rest.places[2]) == b"quiet"
        assert await rest.scene.space(META).get(rest.places[4]) == b"quiet"
        node.disk.fill(None)
        await trio.sleep(100.0)
        assert node.context.line.events["damaged strays discarded"] == 1
        await rest.scene.space(META).put(rest.places[2], b"room again")
        assert [str(violation) for violation in rest.cluster.watch.violations] == []

    at_rest(look)
