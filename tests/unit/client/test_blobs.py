"""If this fails, an image that is kept in a scene is lost, mixed up with another one, or its parts stay behind for good."""

from __future__ import annotations

from contextlib import suppress

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.reasons import RejectReason
from scenefold.client import blobs as blobs_module
from scenefold.client.blobs import PART_BYTES, Blobs
from scenefold.client.scene import Scene
from scenefold.wire import Packet, PutMany
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import _scene

SPACE = SpaceId(9)
SHORT, LONG = b"a small image", bytes(range(256)) * 1000
"""One part, and five."""


def kept(scene: Scene, kind: str = "image") -> Blobs:
    return Blobs(scene.access, SPACE, kind)


async def alive(nodes: FakeNodes, scene: Scene) -> int:
    """Records of the space that are there, and were not deleted."""
    found = [place async for place in scene.space(SPACE).managed.query()]
    assert len({place.object for place in found}) == len(found)
    return len(found)


@pytest.mark.parametrize("payload", [b"x", SHORT, LONG, bytes(PART_BYTES), bytes(PART_BYTES + 1)])
async def test_what_is_kept_is_read_by_anybody_who_has_its_name(payload: bytes, autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    told: list[tuple[int, int]] = []
    written = await kept(_scene(nodes)).write("hall", payload, {"width": 640}, lambda done, every: told.append((done, every)))
    assert told[-1] == (len(payload), len(payload))
    blob, found = await kept(_scene(nodes)).read("hall")
    assert found == payload and blob == written and blob.about == {"width": 640} and blob.size == len(payload)
    assert await kept(_scene(nodes)).names() == ["hall"]


async def test_names_are_of_their_kind(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    await kept(scene).write("hall", SHORT, {})
    await kept(scene, "film").write("hall", LONG, {})
    await kept(scene).write("attic", LONG, {})
    assert await kept(scene).names() == ["attic", "hall"] and await kept(scene, "film").names() == ["hall"]
    assert (await kept(scene).read("hall"))[1] == SHORT and (await kept(scene, "film").read("hall"))[1] == LONG
    with pytest.raises(LocalFault, match="no film of that name"):
        await kept(scene, "film").read("attic")
    assert await kept(scene, "film").look("attic") is None


async def test_what_is_replaced_or_removed_leaves_no_parts(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    await kept(scene).write("hall", LONG, {})
    assert await alive(nodes, scene) == 2 + 5
    await kept(scene).write("hall", SHORT, {})
    assert await alive(nodes, scene) == 2 + 1 and (await kept(scene).read("hall"))[1] == SHORT
    await kept(scene).remove("hall")
    assert await alive(nodes, scene) == 1 and await kept(scene).names() == []
    with pytest.raises(LocalFault, match="no image of that name"):
        await kept(scene).remove("hall")
    await kept(scene).write("hall", LONG, {})
    assert (await kept(scene).read("hall"))[1] == LONG


class CutShort(FakeNodes):
    """They take so many records more, and are gone."""

    left = 1 << 30

    async def request(self, address: str, priority: object, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, PutMany):
            if self.left <= 0:
                raise Refused(RejectReason.STORAGE_FULL, "no room", where=address)
            self.left -= 1
        return await super().request(address, priority, packet, timeout)  # type: ignore[arg-type]


async def test_wherever_it_is_interrupted_there_is_the_old_one_or_the_new_one_and_in_the_end_nothing_else(
    autojump_clock: MockClock,
) -> None:
    cuts = 0
    for left in range(40):
        nodes = CutShort()
        scene = _scene(nodes)
        await kept(scene).write("hall", LONG, {"old": True})
        nodes.left = left
        try:
            await kept(scene).write("hall", LONG[::-1], {"old": False})
        except (Refused, Unreachable):
            cuts += 1
        nodes.left = 1 << 30
        blob, found = await kept(scene).read("hall")
        assert found == (LONG if blob.about["old"] else LONG[::-1])
        await kept(scene).write("hall", SHORT, {})
        assert await alive(nodes, scene) == 2 + 1
        if cuts <= left - 3:
            break
    assert cuts > 5


async def test_of_two_who_write_at_once_one_is_told_and_leaves_nothing(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    outcomes: list[str] = []

    async def write(payload: bytes) -> None:
        try:
            await kept(_scene(nodes)).write("hall", payload, {})
            outcomes.append("written")
        except Refused as refused:
            outcomes.append(refused.reason.name)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(write, LONG)
        nursery.start_soon(write, LONG[::-1])
    assert "written" in outcomes and set(outcomes) <= {"written", RejectReason.STALE_VERSION.name}
    _, found = await kept(scene).read("hall")
    assert found in (LONG, LONG[::-1])
    await kept(scene).write("hall", SHORT, {})
    assert await alive(nodes, scene) == 2 + 1


async def test_who_reads_while_it_is_replaced_has_the_one_or_the_other(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blobs_module, "PARTS_AT_ONCE", 1)
    nodes = FakeNodes()
    scene = _scene(nodes)
    await kept(scene).write("hall", LONG, {})
    done = False

    async def write() -> None:
        nonlocal done
        for number in range(4):
            await kept(scene).write("hall", LONG[::-1] if number % 2 else LONG, {})
        done = True

    async with trio.open_nursery() as nursery:
        nursery.start_soon(write)
        while not done:
            with suppress(Refused):
                _, found = await kept(_scene(nodes)).read("hall")
                assert found in (LONG, LONG[::-1])


async def test_other_bytes_than_were_written_are_damage(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    blob = await kept(scene).write("hall", LONG, {})
    part = blobs_module._part_id(blob.parts, 2)
    (place,) = [place async for place in scene.space(SPACE).managed.query() if place.object == part]
    await scene.space(SPACE).managed.replace(place, b"something else")
    with pytest.raises(DamagedData, match="not those that were written"):
        await kept(scene).read("hall")
    head = kept(scene)._head_id("hall")
    (place,) = [place async for place in scene.space(SPACE).managed.query() if place.object == head]
    await scene.space(SPACE).managed.replace(place, b"\x01")
    with pytest.raises(DamagedData):
        await kept(scene).read("hall")


@pytest.mark.parametrize("name", ["", "a/b", "-x", "x" * 65, "ä"])
async def test_names_that_cannot_be(name: str, autojump_clock: MockClock) -> None:
    with pytest.raises(LocalFault, match="can be called so"):
        await kept(_scene(FakeNodes())).write(name, SHORT, {})


async def test_there_are_only_so_many(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blobs_module, "BLOBS_MAX", 2)
    scene = _scene(FakeNodes())
    for name in ("one", "two", "one"):
        await kept(scene).write(name, SHORT, {})
    with pytest.raises(LocalFault, match="may have no more"):
        await kept(scene).write("three", SHORT, {})
    with pytest.raises(LocalFault, match="0 bytes"):
        await kept(scene).write("one", b"", {})
