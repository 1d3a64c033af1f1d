"""If this fails, a storage node takes an edit behind an answer that somebody renders by (design scenarios 27 to 35, as far as nodes see them)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING
from scenefold.peer.records.fence import Fence
from scenefold.peer.records.verification import KnownScene, verified_copy, verify_all
from scenefold.store import Put, PutResult
from scenefold.wire import (
    EmptyData,
    Fault,
    GetData,
    GetMany,
    GetManyReply,
    HandItem,
    ProposeData,
    PutItem,
    PutMany,
    PutManyReply,
    RecordKey,
    RejectData,
    ReturnData,
    SceneLogPublic,
    SceneMode,
    SpaceEntry,
)
from scenefold.world.sim import run_simulated
from unit.peer import data_nodes
from unit.peer.data_nodes import LEFT, RIGHT, SCENE, Neighbours, Node, with_nodes
from unit.peer.scenes_made import SPACE, later_header, offered, sealed

OUTPUT = SpaceId(9)
SPACES = (*SCENE.spaces, SpaceEntry(OUTPUT, SpaceId(0), FIRST, 1, 1, render_output=True, node_managed=False))
EDITED = later_header(SCENE, spaces=SPACES)
RENDERED = later_header(EDITED, mode=SceneMode.RENDER, write_floor=3)
"""Position 3 is a SetMode."""
AGAIN = later_header(RENDERED, mode=SceneMode.EDIT, write_floor=4)


def record(header: SceneLogPublic, number: int = 1, *, space: SpaceId = SPACE, seq: int = 1, expects: bytes = EXPECTS_ANYTHING) -> PutItem:
    """As somebody signs it who knows this header."""
    return offered(sealed(header, location=Location.from_number(number), space=space, seq=seq, expects=expects))


async def put(node: Node, *items: PutItem) -> list[int]:
    reply = await node.ask(PutMany(items))
    assert isinstance(reply, PutManyReply)
    return [outcome.reason for outcome in reply.outcomes]


async def get(node: Node, position: int, number: int = 1) -> GetManyReply:
    reply = await node.ask(GetMany(SCENE.scene, position, (RecordKey(SPACE, Location.from_number(number)),)))
    assert isinstance(reply, GetManyReply)
    return reply


@pytest.mark.parametrize(
    "known, signed_by, space, reason",
    [
        (EDITED, EDITED, SPACE, None),
        (RENDERED, EDITED, SPACE, RejectReason.MODE_FORBIDS),
        (RENDERED, RENDERED, SPACE, RejectReason.MODE_FORBIDS),
        (RENDERED, RENDERED, OUTPUT, None),
        (RENDERED, EDITED, OUTPUT, RejectReason.MODE_FORBIDS),
        (AGAIN, AGAIN, SPACE, None),
        (AGAIN, RENDERED, OUTPUT, RejectReason.MODE_FORBIDS),
        (EDITED, RENDERED, SPACE, RejectReason.NOT_READY),
    ],
)
def test_what_a_node_without_keys_takes(
    known: SceneLogPublic, signed_by: SceneLogPublic, space: SpaceId, reason: RejectReason | None
) -> None:
    """34: back in edit mode a late part of an image is refused, too."""
    (verdict,) = verify_all([(record(signed_by, space=space), KnownScene.of(known))])
    assert (verdict.reason if isinstance(verdict, Refused) else None) is reason


def test_35_copies_travel_in_every_mode() -> None:
    item = record(EDITED)
    handed = HandItem(item.scene, item.space, item.location, b"", item.signature, item.header, item.ciphertext)
    assert verified_copy(handed, KnownScene.of(RENDERED)).record.header.epoch == EDITED.position


def test_32_a_node_that_missed_the_switch_learns_of_it_from_a_reader_before_it_answers() -> None:
    async def run(neighbours: Neighbours, node: Node) -> None:
        neighbours.headers[node.me] = EDITED
        neighbours.newest = RENDERED
        assert await put(node, record(EDITED)) == [0]
        answer = await get(node, RENDERED.position)
        assert (answer.position, answer.write_floor) == (3, 3) and answer.records[0] is not None
        assert await put(node, record(EDITED, seq=2)) == [RejectReason.MODE_FORBIDS]
        assert await put(node, record(RENDERED, seq=2)) == [RejectReason.MODE_FORBIDS]
        assert await put(node, record(RENDERED, space=OUTPUT)) == [0]

    with_nodes(run, data_nodes.arc(0, (1 << 160) - 1))


def test_a_single_write_is_refused_with_the_header() -> None:
    async def run(neighbours: Neighbours, node: Node) -> None:
        neighbours.headers[node.me] = RENDERED
        item = record(EDITED)
        refusal = await node.ask(ProposeData(item.scene, item.space, item.location, item.signature, item.header, item.ciphertext))
        assert isinstance(refusal, RejectData)
        assert (refusal.reason, refusal.public) == (RejectReason.MODE_FORBIDS, RENDERED)

    with_nodes(run, data_nodes.arc(0, (1 << 160) - 1))


def test_an_answer_tells_the_oldest_header_of_all_who_had_a_part_in_it() -> None:
    """The owner of the right half can have nothing newer than the header of edit mode; who asks can tell."""

    async def run(neighbours: Neighbours, left: Node, right: Node) -> None:
        neighbours.headers = {left.me: RENDERED, right.me: EDITED}
        far = data_nodes.MIDDLE
        assert await put(right, record(EDITED, far)) == [0]
        keys = tuple(RecordKey(SPACE, Location.from_number(number)) for number in (1, far))
        mixed = await left.ask(GetMany(SCENE.scene, RENDERED.position, keys))
        assert isinstance(mixed, GetManyReply) and (mixed.position, mixed.write_floor) == (2, 0)
        one = await left.ask(GetData(SCENE.scene, SPACE, Location.from_number(far), RENDERED.position))
        assert isinstance(one, ReturnData) and (one.position, one.write_floor) == (2, 0)
        none = await left.ask(GetData(SCENE.scene, SPACE, Location.from_number(1), RENDERED.position))
        assert isinstance(none, EmptyData) and (none.position, none.write_floor) == (3, 3)
        with pytest.raises(Refused) as late:
            await left.data.read(SCENE.scene, keys, RENDERED.position)
        assert late.value.reason is RejectReason.NOT_READY

    with_nodes(run, LEFT, RIGHT)


class _Held:
    """A store, of which puts wait until they are let go."""

    def __init__(self, store: Any) -> None:
        self._store = store
        self.begun, self.let_go = trio.Event(), trio.Event()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)

    async def put(self, puts: Sequence[Put]) -> list[PutResult]:
        self.begun.set()
        await self.let_go.wait()
        results: list[PutResult] = await self._store.put(puts)
        return results


def test_30_what_is_being_stored_by_an_older_header_comes_before_the_answer() -> None:
    """Else the reader has the record of before, and the node takes the newer one behind its answer."""

    async def run(neighbours: Neighbours, node: Node) -> None:
        neighbours.headers[node.me] = EDITED
        neighbours.newest = RENDERED
        held = _Held(node.store)
        node.data.writes._store = held  # type: ignore[assignment]
        found: list[GetManyReply] = []

        async def read() -> None:
            found.append(await get(node, RENDERED.position))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(put, node, record(EDITED))
            await held.begun.wait()
            nursery.start_soon(read)
            await trio.testing.wait_all_tasks_blocked()
            assert not found
            held.let_go.set()
        assert found[0].records[0] is not None

    with_nodes(run, data_nodes.arc(0, (1 << 160) - 1))


def test_a_reader_waits_for_a_write_whose_asker_has_hung_up() -> None:
    """The store may have begun with it: it must not come behind the answer."""

    async def run(neighbours: Neighbours, node: Node) -> None:
        neighbours.headers[node.me] = EDITED
        neighbours.newest = RENDERED
        held = _Held(node.store)
        node.data.writes._store = held  # type: ignore[assignment]
        found: list[GetManyReply] = []
        patience = trio.CancelScope()

        async def write() -> None:
            with patience:
                await put(node, record(EDITED))

        async def read() -> None:
            found.append(await get(node, RENDERED.position))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write)
            await held.begun.wait()
            patience.cancel()
            nursery.start_soon(read)
            await trio.testing.wait_all_tasks_blocked()
            assert not found
            held.let_go.set()
        assert found[0].records[0] is not None

    with_nodes(run, data_nodes.arc(0, (1 << 160) - 1))


def test_a_header_that_comes_while_a_record_is_looked_at_counts() -> None:
    async def run(neighbours: Neighbours, node: Node) -> None:
        neighbours.headers[node.me] = EDITED
        writing = node.line.writing

        def late(*places: Any, **more: Any) -> Any:
            neighbours.headers[node.me] = RENDERED
            return writing(*places, **more)

        node.line.writing = late  # type: ignore[method-assign]
        assert await put(node, record(EDITED), record(EDITED, 2)) == [RejectReason.MODE_FORBIDS] * 2

    with_nodes(run, data_nodes.arc(0, (1 << 160) - 1))


def test_a_reader_waits_for_writes_of_before_his_header_and_not_for_ever() -> None:
    async def run() -> None:
        fence = Fence()
        with fence.storing({SCENE.scene: 2}):
            await fence.passed(SCENE.scene, 2)
            with pytest.raises(Refused) as late:
                await fence.passed(SCENE.scene, 3)
            assert late.value.reason is RejectReason.NOT_READY
        await fence.passed(SCENE.scene, 3)

    run_simulated(1, run, virtual_s_max=60)


def test_what_is_asked_by_an_older_header_is_answered_as_ever() -> None:
    async def run(neighbours: Neighbours, node: Node) -> None:
        neighbours.headers[node.me] = RENDERED
        reply = await node.ask(GetMany(SCENE.scene, 1, (RecordKey(SPACE, Location.from_number(1)),)))
        assert isinstance(reply, GetManyReply) and not isinstance(reply, Fault)
        assert reply == replace(reply, records=(None,), position=3, write_floor=3)

    with_nodes(run, data_nodes.arc(0, (1 << 160) - 1))
