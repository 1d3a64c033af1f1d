"""If this fails, what became durable while its asker gave up is forgotten: an older header follows it, or another one is decided beside it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused
from unit.peer.scenes_made import first_header, later_header
from unit.peer.test_scenes import FIRST, LONGER, OTHER, PlainStore, Rig, proposal, second_of


class SlowStore(PlainStore):
    """What is given to it becomes durable though nobody waits for that any more."""

    def __init__(self, writers: trio.Nursery) -> None:
        super().__init__()
        self._writers = writers

    async def put_header(self, scene: int, header: bytes) -> None:
        await self._write(super().put_header, scene, header)

    async def put_scene_log(self, scene: int, header: bytes, private: bytes) -> None:
        await self._write(super().put_scene_log, scene, header, private)

    async def _write(self, put: Callable[..., Awaitable[None]], *values: object) -> None:
        is_durable = trio.Event()

        async def commit() -> None:
            await trio.sleep(0.01)
            await put(*values)
            is_durable.set()

        self._writers.start_soon(commit)
        await is_durable.wait()


async def test_a_header_that_became_durable_while_its_taker_was_cancelled_is_not_followed_by_an_older_one(
    autojump_clock: MockClock,
) -> None:
    async with trio.open_nursery() as writers:
        rig = Rig(store=SlowStore(writers))
        first = first_header(origin=OTHER)
        later = second_of(first)
        with trio.move_on_after(0.005):
            await rig.scenes.adopt(later)
        with pytest.raises(Refused, match="position 2"):
            await rig.scenes.adopt(first)
        await trio.sleep(1.0)
        assert [header for header, _ in rig.store.written] == [later.encode()]
        assert rig.scenes.all() == [later]


async def test_what_was_decided_while_its_asker_was_cancelled_is_decided(autojump_clock: MockClock) -> None:
    async with trio.open_nursery() as writers:
        rig = Rig(store=SlowStore(writers))
        await rig.scenes.on_propose(proposal(FIRST), "user:writer")
        one, other = second_of(FIRST), later_header(FIRST, log=b"another log")
        with trio.move_on_after(0.005):
            await rig.scenes.on_propose(proposal(one, LONGER), "user:writer")
        await trio.sleep(1.0)
        await rig.scenes.on_propose(proposal(other, b"another log"), "user:writer")
        assert [public.log_hash for public in rig.scenes.all()] == [one.log_hash]
        assert len(rig.store.written) == 2
