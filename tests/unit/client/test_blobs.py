"""If this fails, an image that is kept in a scene is lost, mixed up with another one, or its parts stay behind for good."""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.reasons import RejectReason
from scenefold.client import blobs as blobs_module
from scenefold.client.blobs import PART_BYTES, Blobs
from scenefold.client.scene import Scene
from scenefold.client.tombstones import MARK
from scenefold.crypto import RecordHeader, object_of, signed_place
from scenefold.wire import GetMany, Packet, PutMany
from scenefold.world import Priority
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


@pytest.mark.parametrize("payload", [b"x", SHORT, LONG, bytes(PART_BYTES), bytes(PART_BYTES + 1), bytes(PART_BYTES) + MARK + b"rest"])
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
    assert cuts > 3


class Held(Blobs):
    """Before its n-th head it waits for something."""

    def __init__(self, scene: Scene, number: int, wait: Callable[[], Awaitable[object]]) -> None:
        super().__init__(scene.access, SPACE, "image")
        self._left, self._wait = number, wait

    async def _put_head(self, name: str, head: Any) -> Any:
        self._left -= 1
        if not self._left:
            await self._wait()
        return await super()._put_head(name, head)


async def test_who_is_overtaken_is_told_and_loses_nobody_anything(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    await kept(_scene(nodes)).write("hall", LONG, {})

    async def overtake() -> None:
        await kept(_scene(nodes)).write("hall", SHORT, {"by": "another"})

    slow = Held(_scene(nodes), 2, overtake)
    with pytest.raises(Refused, match="another version"):
        await slow.write("hall", LONG[::-1], {})
    blob, found = await kept(_scene(nodes)).read("hall")
    assert found == SHORT and blob.about == {"by": "another"}
    await kept(_scene(nodes)).write("hall", SHORT, {})
    assert await alive(nodes, _scene(nodes)) == 2 + 1


async def test_who_dies_while_he_overtakes_leaves_the_old_one(autojump_clock: MockClock) -> None:
    """His first head is there, and so the last one of whom he overtakes comes too late; nothing else is."""
    nodes = FakeNodes()
    await kept(_scene(nodes)).write("hall", LONG, {"old": True})

    async def overtake_and_die() -> None:
        other = _scene(nodes)
        with trio.CancelScope() as life:

            async def die() -> None:
                life.cancel()
                await trio.lowlevel.checkpoint()

            await Held(other, 2, die).write("hall", SHORT, {})

    slow = Held(_scene(nodes), 2, overtake_and_die)
    with pytest.raises(Refused):
        await slow.write("hall", LONG[::-1], {})
    blob, found = await kept(_scene(nodes)).read("hall")
    assert found == LONG and blob.about == {"old": True}


async def test_a_head_that_comes_late_is_not_taken(autojump_clock: MockClock) -> None:
    """Its answer was lost, and the same user has begun again."""
    nodes = FakeNodes()
    await kept(_scene(nodes)).write("hall", LONG, {})
    late: list[tuple[str, PutMany]] = []

    class Slow(FakeNodes):
        async def request(self, address: str, priority: Any, packet: Packet, timeout: float) -> Packet:
            if isinstance(packet, PutMany) and late is not None and self.holds:
                late.append((address, packet))
                raise Unreachable("the connection broke", where=address)
            return await super().request(address, priority, packet, timeout)

        holds = False

    slow = Slow(records=nodes.records)

    async def hold() -> None:
        slow.holds = True
        await trio.lowlevel.checkpoint()

    with pytest.raises(Unreachable):
        await Held(_scene(slow), 2, hold).write("hall", LONG[::-1], {})
    await kept(_scene(nodes)).write("hall", SHORT, {})
    for address, packet in late:
        await nodes.request(address, Priority.LOW, packet, 1.0)
    assert (await kept(_scene(nodes)).read("hall"))[1] == SHORT


async def test_a_head_that_is_sealed_anew_meanwhile_overtakes_nobody(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    blobs = kept(_scene(nodes))

    async def seal_anew() -> None:
        (found,) = await blobs._access.get([blobs._key(blobs._head_id("hall"))])
        assert found is not None
        await blobs._put(blobs._head_id("hall"), found.payload, found.digest)

    await Held(_scene(nodes), 2, seal_anew).write("hall", LONG, {})
    assert (await blobs.read("hall"))[1] == LONG


async def test_what_is_removed_while_it_is_written_is_there_or_not_and_listed_so(autojump_clock: MockClock) -> None:
    for number in (1, 2):
        nodes = FakeNodes()
        await kept(_scene(nodes)).write("hall", LONG, {})

        async def remove(nodes: FakeNodes = nodes) -> None:
            await kept(_scene(nodes)).remove("hall")

        with suppress(Refused):
            await Held(_scene(nodes), number, remove).write("hall", SHORT, {})
        names = await kept(_scene(nodes)).names()
        assert names == (["hall"] if await kept(_scene(nodes)).look("hall") is not None else names)
        await kept(_scene(nodes)).write("hall", SHORT, {})
        assert await kept(_scene(nodes)).names() == ["hall"] and await alive(nodes, _scene(nodes)) == 2 + 1


async def test_an_interrupted_removal_is_gone_on_with(autojump_clock: MockClock) -> None:
    for left in range(1, 12):
        nodes = CutShort()
        scene = _scene(nodes)
        await kept(scene).write("hall", LONG, {})
        nodes.left = left
        with suppress(Refused, Unreachable):
            await kept(scene).remove("hall")
        nodes.left = 1 << 30
        with suppress(LocalFault):
            await kept(scene).remove("hall")
        assert await kept(scene).names() == [] and await alive(nodes, scene) == 1


async def test_a_head_that_makes_no_sense_can_be_replaced_and_removed(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    blobs = kept(_scene(nodes))
    for act in (blobs.remove, lambda name: blobs.write(name, SHORT, {})):
        await blobs.write("hall", LONG, {})
        await blobs._put(blobs._head_id("hall"), b"\x01", None)
        with pytest.raises(DamagedData, match="makes no sense"):
            await blobs.look("hall")
        await act("hall")
        assert (await blobs.names() == []) == (await blobs.look("hall") is None)


async def test_a_rotten_part_holds_up_nobody(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    blobs = kept(_scene(nodes))
    blob = await blobs.write("hall", LONG, {})
    nodes.rotten.add(signed_place(blobs_module._part_id(blob.parts, 2)))
    await blobs.write("hall", SHORT, {})
    assert (await blobs.read("hall"))[1] == SHORT
    await blobs.remove("hall")
    assert await blobs.names() == []


async def test_a_part_that_is_gone_is_damage_and_no_haste(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    blob = await kept(_scene(nodes)).write("hall", LONG, {})
    gone = blobs_module._part_id(blob.parts, 1)
    del nodes.records[next(key for key, item in nodes.records.items() if object_of(RecordHeader.decode(item.header)) == gone)]
    with pytest.raises(DamagedData, match="are gone"):
        await kept(_scene(nodes)).read("hall")


async def test_what_is_deleted_is_not_fetched_before(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    blobs = kept(_scene(nodes))
    await blobs.write("hall", LONG * 20, {})
    before = len(nodes.asked)
    await blobs.write("hall", SHORT, {})
    await blobs.remove("hall")
    assert sum(len(packet.keys) for _, packet in nodes.asked[before:] if isinstance(packet, GetMany)) < 20


class Busy(FakeNodes):
    """Everything takes a while, and some answers are lost."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._dice = random.Random(seed)

    async def request(self, address: str, priority: Any, packet: Packet, timeout: float) -> Packet:
        await trio.sleep(self._dice.random())
        answer = await super().request(address, priority, packet, timeout)
        await trio.sleep(self._dice.random())
        if isinstance(packet, PutMany) and self._dice.random() < 0.02:
            raise Unreachable("the connection broke", where=address)
        return answer


@pytest.mark.parametrize("seed", range(60))
async def test_whatever_several_do_at_once_there_is_one_whole_and_all_else_goes(seed: int, autojump_clock: MockClock) -> None:
    nodes, dice = Busy(seed), random.Random(f"acts/{seed}")
    payloads = [bytes([number]) * dice.choice([10, PART_BYTES, 3 * PART_BYTES + 7]) for number in range(8)]

    async def act(payloads: list[bytes]) -> None:
        blobs = kept(_scene(nodes))
        for payload in payloads:
            with trio.move_on_after(dice.choice([5.0, 20.0, 1000.0])), suppress(Refused, Unreachable, LocalFault):
                if dice.random() < 0.25:
                    await blobs.remove("hall")
                else:
                    await blobs.write("hall", payload, {})

    async def look(over: trio.Event) -> None:
        while not over.is_set():
            with suppress(Refused, Unreachable, LocalFault):
                assert (await kept(_scene(nodes)).read("hall"))[1] in payloads
            await trio.sleep(1.0)

    over = trio.Event()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(look, over)
        async with trio.open_nursery() as actors:
            for _ in range(3):
                actors.start_soon(act, dice.sample(payloads, 4))
        over.set()
    nodes._dice = random.Random(0)
    calm = FakeNodes(records=nodes.records)
    with suppress(LocalFault):
        assert (await kept(_scene(calm)).read("hall"))[1] in payloads
    for _ in range(2):
        await kept(_scene(calm)).write("hall", SHORT, {})
    assert await kept(_scene(calm)).names() == ["hall"]
    assert await alive(calm, _scene(calm)) == 2 + 1


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


@pytest.mark.parametrize("name", ["", "a/b", "-x", "x" * 65, "ä", "\udcff"])
async def test_names_that_cannot_be(name: str, autojump_clock: MockClock) -> None:
    blobs = kept(_scene(FakeNodes()))
    for act in (blobs.read, blobs.look, blobs.remove, lambda name: blobs.write(name, SHORT, {})):
        with pytest.raises(LocalFault, match="can be called so"):
            await act(name)


async def test_there_are_only_so_many(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blobs_module, "BLOBS_MAX", 2)
    scene = _scene(FakeNodes())
    for name in ("one", "two", "one"):
        await kept(scene).write(name, SHORT, {})
    with pytest.raises(LocalFault, match="may have no more"):
        await kept(scene).write("three", SHORT, {})
    with pytest.raises(LocalFault, match="0 bytes"):
        await kept(scene).write("one", b"", {})
