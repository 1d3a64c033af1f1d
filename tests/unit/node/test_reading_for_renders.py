"""If this fails, an image is lost because a bound moved, or somebody wrote, while a node read the scene; or it shows what a former writer forged."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import SceneId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.sealing import SceneIdentity
from scenefold.node.rendering import NodeReader, RenderHost
from scenefold.scene.head import NO_HEAD, SceneHead
from scenefold.scene.payloads.splits import Cut, Part, SplitEntry, contents_of, encode_entry, encode_part
from scenefold.wire import RecordBytes, RecordKey, SceneMode
from unit.client.fake_nodes import FakeNodes, make_world
from unit.client.test_records import FILES, ITEMS, PLACES, _scene


class Owners:
    """The data service of a node, whose owners refuse some times first."""

    def __init__(self, nodes: FakeNodes, refusals: list[RejectReason]) -> None:
        self._nodes = nodes
        self.refusals = refusals

    async def read(self, scene: SceneId, keys: Sequence[RecordKey], position: int) -> list[RecordBytes | None]:
        if self.refusals:
            raise Refused(self.refusals.pop(), "the place is changing hands")
        found = [self._nodes.records.get((key.space, key.location)) for key in keys]
        return [None if item is None else RecordBytes(item.signature, item.header, item.ciphertext) for item in found]


async def _reader(monkeypatch: pytest.MonkeyPatch, refusals: list[RejectReason]) -> tuple[NodeReader, Owners]:
    nodes = FakeNodes()
    scene = _scene(nodes)
    await scene.space(FILES).put_many(ITEMS)
    identity = scene.access.identity

    async def known(_: NodeReader, _position: int = 0) -> SceneIdentity:
        return identity

    monkeypatch.setattr(NodeReader, "_identity", known)
    owners = Owners(nodes, refusals)
    context: Any = SimpleNamespace(world=make_world(), data=owners)
    return NodeReader(context, identity.scene, identity.genesis, identity.keys, NO_HEAD), owners


async def test_a_bound_that_moves_is_waited_for(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    reader, owners = await _reader(monkeypatch, [RejectReason.NOT_READY, RejectReason.BUSY])
    assert await reader.get_many(FILES, PLACES) == [payload for _, payload in ITEMS]
    assert not owners.refusals


async def test_what_lasts_is_said_at_once(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    reader, owners = await _reader(monkeypatch, [RejectReason.BUSY, RejectReason.NOT_AUTHORISED])
    with pytest.RaisesGroup(Refused):
        await reader.get_many(FILES, PLACES)
    assert owners.refusals == [RejectReason.BUSY]


def _header_known_up_to(monkeypatch: pytest.MonkeyPatch, newest: int) -> list[int]:
    """The node knows position 1, and learns of others as they are asked for. Gives what was asked for."""
    asked: list[int] = []
    original = NodeReader._identity

    async def known(self: NodeReader, position: int = 0) -> SceneIdentity:
        asked.append(position)
        return replace(await original(self), position=max(1, min(position, newest)))

    monkeypatch.setattr(NodeReader, "_identity", known)
    return asked


async def _written_at(owners: Owners, *epochs: int) -> None:
    scene = _scene(owners._nodes)
    for epoch, item in zip(epochs, ITEMS, strict=False):
        scene.access.identity = replace(scene.access.identity, position=epoch)
        await scene.space(FILES).put(*item)


async def test_records_of_several_later_positions_are_read(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    reader, owners = await _reader(monkeypatch, [])
    await _written_at(owners, 2, 3, 4)
    asked = _header_known_up_to(monkeypatch, 4)
    assert await reader.get_many(FILES, PLACES) == [payload for _, payload in ITEMS]
    assert asked == [0, 2, 3, 4]


async def test_a_record_of_a_position_that_has_not_come_is_not_shown(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    reader, owners = await _reader(monkeypatch, [])
    await _written_at(owners, 2**64 - 1)
    asked = _header_known_up_to(monkeypatch, 4)
    with pytest.RaisesGroup(pytest.RaisesExc(DamagedData, match="has not come to")):
        await reader.get_many(FILES, PLACES)
    assert asked == [0, 2**64 - 1, 2**64 - 1]


async def test_a_split_record_is_read_as_a_whole(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    reader, owners = await _reader(monkeypatch, [RejectReason.NOT_READY])
    files = _scene(owners._nodes).space(FILES)
    whole, places = bytes(range(200)), [Location.from_number(number) for number in (77, 78)]
    contents = contents_of(whole, Cut.BYTES, 2)
    parts = [encode_part(Part(Cut.BYTES, number, 2, PLACES[4], bytes(32), (0, 0, 0, 0, bytes(32)), contents[number])) for number in (0, 1)]
    await files.put_many(zip(places, parts, strict=True))
    await files.put(PLACES[4], encode_entry(SplitEntry.of(Cut.BYTES, whole, places, parts)))
    payloads = [payload for _, payload in ITEMS]
    assert await reader.get_many(FILES, PLACES) == [*payloads[:4], whole, *payloads[5:]]
    del owners._nodes.records[FILES, places[1]]
    with pytest.RaisesGroup(pytest.RaisesExc(DamagedData, match="part 1 of 2")):
        await reader.get_many(FILES, PLACES)


async def test_in_render_mode_what_was_edited_since_ends_the_render(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    """The scene was switched back meanwhile: one image must not show both."""
    reader, owners = await _reader(monkeypatch, [])
    _header_known_up_to(monkeypatch, 9)
    before, behind = replace(reader, head=SceneHead(4, bytes(32), 4)), replace(reader, head=SceneHead(4, bytes(32), 3))
    await _written_at(owners, 1, 2, 3)
    assert await before.get_many(FILES, PLACES) == [payload for _, payload in ITEMS]
    with pytest.RaisesGroup(pytest.RaisesExc(Refused, match="switched back to edit mode")):
        await behind.get_many(FILES, PLACES)
    assert await reader.get_many(FILES, PLACES), "in edit mode the image shows what lies there"


class Held:
    """What an observer does by its own lease of a scene."""

    def __init__(self, refusal: Refused | None = None) -> None:
        self._refusal = refusal
        self.modes: list[SceneMode] = []
        self.is_held = False

    @asynccontextmanager
    async def hold(self, mode: SceneMode) -> AsyncIterator[None]:
        if self._refusal is not None:
            raise self._refusal
        self.modes.append(mode)
        self.is_held = True
        yield
        self.is_held = False


@pytest.mark.parametrize(("floor", "observes", "held"), [(4, True, True), (0, True, False), (4, False, False)])
async def test_who_observes_holds_a_lease_while_it_reads_in_render_mode(floor: int, observes: bool, held: bool) -> None:
    use, scene = Held(), SceneId(7)
    participation = SimpleNamespace(own_use=lambda of: use if observes and of == scene else None)
    host = RenderHost(SimpleNamespace(participation=participation))  # type: ignore[arg-type]
    async with host.reader(scene, bytes(32), None, SceneHead(5, bytes(32), floor)) as reader:  # type: ignore[arg-type]
        assert isinstance(reader, NodeReader) and use.is_held is held
    assert not use.is_held and use.modes == [SceneMode.RENDER] * held


async def test_without_that_lease_nothing_is_read() -> None:
    use = Held(Refused(RejectReason.MODE_FORBIDS, "no lease"))
    host = RenderHost(SimpleNamespace(participation=SimpleNamespace(own_use=lambda _: use)))  # type: ignore[arg-type]
    with pytest.raises(Refused, match="no lease"):
        async with host.reader(SceneId(7), bytes(32), None, SceneHead(5, bytes(32), 4)):  # type: ignore[arg-type]
            raise AssertionError("it reads")
