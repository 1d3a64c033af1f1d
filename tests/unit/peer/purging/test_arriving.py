"""If one fails, a node acts on an old disk before it knows what was purged since, or never gets to work."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.arrival import Arrival
from scenefold.peer.line.carrying import Carrying
from scenefold.peer.purging.arriving import Arriving
from scenefold.wire import AskPlaces, Member, PlacesAsked, SceneLogPublic
from scenefold.world import offline_world
from unit.peer.scenes_made import first_header, later_header

ME, ONE, TWO = (Member(NodeId(number), bytes([number]) * 16) for number in (1, 2, 3))
OLD = first_header()
NEW = later_header(OLD, position=7, write_floor=7, purged=7)


class Town:
    """A newcomer and its neighbours. `answers`: the reason that each gives; `lists`: the headers that it has."""

    def __init__(self, *others: Member, holding: object = None, is_founder: bool = False) -> None:
        self.answers: dict[Member, int] = dict.fromkeys(others, 0)
        self.lists: dict[NodeId, list[SceneLogPublic]] = {member.node: [NEW] for member in others}
        self.knows = {OLD.scene: OLD}
        self.asked: list[AskPlaces] = []
        self.lease = trio.Event()
        members = {member.node: SimpleNamespace(member=member) for member in (ME, *others)}
        registry = SimpleNamespace(
            position=9, members=tuple(members), current=members.get, founding_arc=lambda _: WHOLE_LINE if is_founder else None
        )

        async def kept() -> object:
            return holding

        self.keeper = SimpleNamespace()
        self.parts: Any = SimpleNamespace(
            world=offline_world(),
            arrival=Arrival(),
            keeper=self.keeper,
            cluster_log=SimpleNamespace(registry=registry),
            own=SimpleNamespace(me=ME.node, member=ME),
            store=SimpleNamespace(holding=kept),
            peers=self,
        )

    @property
    def arrival(self) -> Arrival:
        arrival: Arrival = self.parts.arrival
        return arrival

    def arriving(self) -> Arriving:
        return Arriving(self.parts, cast(Any, self), self.lease.wait)

    async def ask(self, _node: NodeId, _priority: object, packet: AskPlaces, *_: object) -> PlacesAsked:
        self.asked.append(packet)
        if self.answers[packet.asked] < 0:
            raise Unreachable("away")
        return PlacesAsked(self.answers[packet.asked], 1, (), "")

    async def take_list(self, member: NodeId) -> Sequence[SceneLogPublic]:
        for public in self.lists[member]:
            self.knows[public.scene] = public
        return self.lists[member]

    async def known(self, scene: int, *, ask: bool) -> Any:
        return SimpleNamespace(public=self.knows[cast(Any, scene)])


def require(town: Town) -> Callable[[], None]:
    found: Callable[[], None] = town.keeper.require_arrival
    return found


async def test_a_newcomer_waits_for_its_lease_and_for_the_headers_and_then_for_what_must_come_first(autojump_clock: object) -> None:
    town = Town(ONE, TWO)
    done: list[int] = []

    async def prepare() -> None:
        assert not town.arrival.is_done
        done.append(town.knows[OLD.scene].purged)

    town.arrival.before.append(prepare)
    arriving = town.arriving()
    with pytest.raises(Refused) as problem:
        require(town)()
    assert problem.value.reason is RejectReason.NOT_READY
    async with trio.open_nursery() as nursery:
        nursery.start_soon(arriving.run)
        await trio.testing.wait_all_tasks_blocked()
        assert not town.asked, "without a lease its disk may be an older one"
        town.lease.set()
        await town.arrival.done()
    require(town)()
    assert done == [7]
    assert town.asked == [AskPlaces(ME, ONE, 9, None)]


async def test_it_is_told_only_by_who_has_arrived_and_knows_the_log_as_far(autojump_clock: object) -> None:
    town = Town(ONE, TWO)
    town.answers = {ONE: int(RejectReason.NOT_READY), TWO: -1}
    town.lists[ONE.node] = [OLD]
    town.lease.set()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(town.arriving().run)
        await trio.testing.wait_all_tasks_blocked(0.5)
        assert not town.arrival.is_done
        town.answers[TWO] = 0
        await town.arrival.done()
    assert town.knows[OLD.scene] == NEW


@pytest.mark.parametrize("town", [lambda: Town(ONE, holding=object()), lambda: Town(ONE, is_founder=True), Town])
async def test_who_was_there_before_asks_nobody(town: Callable[[], Town], autojump_clock: object) -> None:
    found = town()
    found.lease.set()
    await found.arriving().run()
    assert found.arrival.is_done and not found.asked


@pytest.mark.usefixtures("only_errors")
async def test_what_must_come_first_is_tried_until_it_is_done(autojump_clock: object) -> None:
    town = Town(is_founder=True)
    tries = 0

    async def prepare() -> None:
        nonlocal tries
        tries += 1
        if tries < 3:
            raise Refused(RejectReason.STORAGE_FULL, "no room")

    prepared: Callable[[], Awaitable[None]] = prepare
    town.arrival.before.append(prepared)
    town.lease.set()
    await town.arriving().run()
    assert (tries, town.arrival.is_done) == (3, True)


async def test_what_is_carried_later_is_not_waited_for(autojump_clock: object) -> None:
    carrying = Carrying()
    await carrying.ended()
    async with trio.open_nursery() as nursery:
        with carrying.begun():
            ended = trio.Event()

            async def wait() -> None:
                await carrying.ended()
                ended.set()

            nursery.start_soon(wait)
            await trio.testing.wait_all_tasks_blocked()
            later = carrying.begun()
            later.__enter__()
            assert not ended.is_set()
        await ended.wait()
        later.__exit__(None, None, None)
