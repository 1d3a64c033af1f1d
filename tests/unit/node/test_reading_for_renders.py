"""If this fails, an image is lost because a bound moved while a node read the scene."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.client.sealing import SceneIdentity
from scenefold.node.rendering import NodeReader
from scenefold.scene.head import NO_HEAD
from scenefold.wire import RecordBytes, RecordKey
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
