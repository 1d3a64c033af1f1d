"""If this fails, a node can keep a user from the renders of all others, or a render that was interrupted while it began goes on for ever."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import fields
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster, Scene
from scenefold.render.anew import may_pass
from scenefold.render.choice import Renderers
from scenefold.render.job import RenderOptions
from scenefold.render.layers import BESIDE
from scenefold.render.lens import Lens
from scenefold.render.levels import Adaptive
from scenefold.render.one_image import Choice, OneImage
from scenefold.render.pool.request import RenderRequest, options_document, options_of
from scenefold.render.pool.telling import failure_fields
from scenefold.render.pool.unattended import Unattended
from scenefold.render.sampling import Sampling
from scenefold.render.unattended import Listing, list_renders
from scenefold.render.window import Window
from scenefold.wire import CancelJob, JobAnswer, JobState, JobStateReply, Packet, StartJob, pack_value
from unit.peer.village import TrioClock
from unit.render.test_reports import STATE

ROW: dict[str, Any] = {
    "job": 7,
    "phase": "done",
    **failure_fields(None),
    "passes": 3,
    "closed": 3,
    "age": 1.5,
    "options": options_document(RenderOptions()),
    "unattended": ["kitchen", None],
}
KITCHEN = Unattended("kitchen")
FIRST = NodeId(0x7F000002)


async def listed(*rows: object) -> Listing:
    """What a client makes of what nodes tell, one after the other, each of one job; None: the node does not answer."""
    told = {f"127.0.0.{2 + index}": row for index, row in enumerate(rows)}

    async def ask(address: str, _packet: Packet, _answer: object, timeout_s: float) -> Packet:
        await trio.lowlevel.checkpoint()
        if told[address] is None:
            raise Unreachable("no answer")
        return JobStateReply(job=0, document=pack_value({"jobs": [told[address]]}))

    async def nodes() -> list[SimpleNamespace]:
        return [SimpleNamespace(address=address) for address in told]

    return await list_renders(cast(Cluster, SimpleNamespace(calls=SimpleNamespace(ask=ask), nodes=nodes)))


@pytest.mark.parametrize(
    "change",
    [
        {"phase": "asleep"},
        {"job": 0},
        {"closed": 4},
        {"age": float("inf")},
        {"failure": 5},
        {"unattended": ["a\nkitchen", None]},
        {"options": None},
        {"options": {**ROW["options"], "width": 1 << 40}},
        {"options": {**ROW["options"], "layers": ["taste"]}},
        {"options": {**ROW["options"], "adaptive": [7.0, 16]}},
    ],
)
async def test_a_node_that_tells_nonsense_hides_no_render_of_others(change: dict[str, Any]) -> None:
    listing = await listed({**ROW, **change}, ROW, None)
    assert [one.organiser for one in listing.renders] == ["127.0.0.3"]
    assert listing.silent == ("127.0.0.2", "127.0.0.4")


async def test_how_cells_move_is_no_affair_of_who_only_fetches() -> None:
    listing = await listed({**ROW, "options": {**ROW["options"], "algorithm": "of-a-package"}})
    assert [one.options.algorithm for one in listing.renders] == ["of-a-package"]


async def test_why_it_failed_is_one_line() -> None:
    error = Refused(RejectReason.NOT_READY, "it is gone", where="127.0.0.9", remedy="look")
    (one,) = (await listed({**ROW, "phase": "failed", **failure_fields(error)})).renders
    assert one.failure == "it is gone (127.0.0.9): look"


def test_no_option_is_lost_on_the_way() -> None:
    options = RenderOptions(
        width=7,
        height=8,
        samples=9,
        seed=10,
        depth=11,
        sky=(0.5, 1.0, 2.0),
        camera="left",
        algorithm="kd",
        moving=False,
        layers=BESIDE,
        crop=Window(1, 2, 3, 4),
        lens=Lens(0.5, 2.0),
        sampling=Sampling("independent", 5, 1.0, 2.0),
        environment_rotation=-30.0,
        adaptive=Adaptive(0.25, 8),
        mips=False,
        pools=3,
        skips=True,
    )
    usual = RenderOptions()
    assert [one.name for one in fields(options) if getattr(options, one.name) == getattr(usual, one.name)] == []
    assert options_of(options_document(options)) == options


class Beginning:
    """A client that begins a render which nobody waits for, and a node that answers what it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, answer: Callable[[Packet], Packet | None]) -> None:
        self.asked: list[Packet] = []
        self.addresses: list[str] = []
        self.told: list[str] = []
        self.waits = trio.Event()

        async def ask(address: str, packet: Packet, _answer: object, timeout_s: float) -> Packet:
            self.asked.append(packet)
            self.addresses.append(address)
            await trio.lowlevel.checkpoint()
            known = answer(packet)
            if known is None:
                self.waits.set()
                await trio.sleep_forever()
            assert known is not None
            return known

        @asynccontextmanager
        async def rendering(_access: object) -> AsyncIterator[None]:
            yield

        async def request(*_: object, **__: object) -> object:
            await trio.lowlevel.checkpoint()
            return SimpleNamespace(to_bytes=bytes)

        monkeypatch.setattr(OneImage, "_request", cast(RenderRequest, request))
        world = SimpleNamespace(clock=TrioClock(), entropy=SimpleNamespace(token=os.urandom))
        calls = SimpleNamespace(ask=ask, world=world, leases=SimpleNamespace(rendering=rendering))
        cluster, scene = SimpleNamespace(calls=calls), SimpleNamespace(access=None)
        self._image = OneImage(
            cast(Cluster, cluster), cast(Scene, scene), RenderOptions(), None, lambda *_: None, organised_by=self.told.append
        )

    async def begin(self, *others: NodeId) -> Choice:
        renderers = cast(Renderers, SimpleNamespace(nodes=(FIRST, *others)))
        return await self._image.begin(Choice(renderers, FIRST, 7, cast(Any, None), frozenset()), KITCHEN)


def answers(packet: Packet, state: dict[str, Any] | None) -> Packet | None:
    if isinstance(packet, JobState):
        return None if state is None else JobStateReply(job=7, document=pack_value(state))
    return JobAnswer(job=7, reason=0, text="")


@pytest.mark.parametrize("waits_in", [StartJob, JobState])
async def test_who_is_interrupted_while_it_begins_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch, waits_in: type[Packet]) -> None:
    beginning = Beginning(monkeypatch, lambda packet: None if isinstance(packet, waits_in) else answers(packet, None))
    async with trio.open_nursery() as nursery:
        nursery.start_soon(beginning.begin)
        await beginning.waits.wait()
        nursery.cancel_scope.cancel()
    assert isinstance(beginning.asked[-1], CancelJob)


async def test_a_node_that_would_give_it_up_is_no_use(monkeypatch: pytest.MonkeyPatch) -> None:
    older = Beginning(monkeypatch, lambda packet: answers(packet, {**STATE, "phase": "rendering"}))
    with pytest.raises(LocalFault, match="of a version that gives up what nobody waits for"):
        await older.begin()
    assert isinstance(older.asked[-1], CancelJob)
    known = Beginning(monkeypatch, lambda packet: answers(packet, {**STATE, "phase": "rendering", "unattended": KITCHEN.row()}))
    assert (await known.begin()).job == 7
    assert not any(isinstance(packet, CancelJob) for packet in known.asked)


async def test_who_has_no_place_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = tuple(NodeId(int(FIRST) + number) for number in range(4))
    asked = list[Packet]()

    def answer(packet: Packet) -> Packet | None:
        asked.append(packet)
        if isinstance(packet, StartJob) and len(asked) < 3:
            return JobAnswer(job=packet.job, reason=int(RejectReason.BUSY), text="as many jobs as it may")
        return answers(packet, {**STATE, "phase": "rendering", "unattended": KITCHEN.row()})

    some = Beginning(monkeypatch, answer)
    taken = await some.begin(*nodes[1:])
    assert len(set(some.told)) == 3 and some.told == some.addresses[:3]
    assert address_of(taken.organiser) == some.told[-1]
    assert len({packet.job for packet in some.asked if isinstance(packet, StartJob)}) == 3
    full = Beginning(monkeypatch, lambda packet: JobAnswer(job=7, reason=int(RejectReason.BUSY), text="as many jobs as it may"))
    with pytest.raises(Refused, match="as many jobs"):
        await full.begin(*nodes[1:])
    assert sorted(full.told) == sorted(map(address_of, nodes)) and all(isinstance(packet, StartJob) for packet in full.asked)


async def test_a_node_that_was_started_anew_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(packet: Packet) -> Packet | None:
        if isinstance(packet, JobState):
            raise Refused(RejectReason.NOT_READY, "this node organises no such job")
        return answers(packet, None)

    with pytest.raises(Refused, match="started anew") as refused:
        await Beginning(monkeypatch, answer).begin()
    assert refused.value.where == address_of(FIRST) and may_pass(refused.value)
