"""If this fails, a node that observes a scene reads on for an image without a lease (specs/26-modes.md, Observers)."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import LEASE_LOOK_S
from scenefold.peer.modes import DecidedScene, Standing
from scenefold.peer.modes.own_use import OwnUse
from scenefold.peer.timing import RENEW_S, T_LEASE_S
from scenefold.peer.waiters import Waiters
from scenefold.wire import Member, SceneMode
from scenefold.world import World, background_tasks
from unit.client.fake_nodes import make_world

ME = Member(NodeId(1), bytes(16))
SLEPT_S = 3600.0


class Modes:
    """Of a node that grants itself all that it asks for."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.news = Waiters()
        self.public: Any = SimpleNamespace(scene=7)
        self.standing = Standing.started(ME, DecidedScene(1, SceneMode.RENDER, frozenset({ME})), -math.inf)

    @property
    def acts_in(self) -> SceneMode | None:
        return self.standing.acts_in(self._world.clock.now())

    async def may_act(self, mode: SceneMode, _within_s: float) -> bool:
        self.ask()
        return self.acts_in is mode

    def want(self) -> None:
        """It asks by itself, or not at all."""

    def ask(self) -> None:
        self.standing = self.standing.asks(1, self._world.clock.now())
        self.news.tell()


async def lost_after(world: World, modes: Modes, *, slept_after_s: float, monkeypatch: pytest.MonkeyPatch) -> float:
    """When the machine sleeps so long behind the beginning, by Trio's clock, which stands still meanwhile."""
    use, began, ended = OwnUse(modes, world), trio.current_time(), list[float]()  # type: ignore[arg-type]

    async def read() -> None:
        try:
            async with use.hold(SceneMode.RENDER):
                await trio.sleep(slept_after_s)
                monkeypatch.setattr(world.clock, "now", lambda: trio.current_time() + SLEPT_S)
                await trio.sleep(60.0)
        finally:
            ended.append(trio.current_time())

    with pytest.raises(Refused, match="lost its lease"):
        await read()
    return ended[0] - began


async def test_after_a_sleep_of_the_machine_it_ends_within_a_second(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    world = make_world()
    lost_s = await lost_after(world, Modes(world), slept_after_s=0.3, monkeypatch=monkeypatch)
    assert lost_s <= 0.3 + LEASE_LOOK_S


async def test_as_long_as_it_is_renewed_it_goes_on(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    world = make_world()
    modes = Modes(world)

    async def renew() -> None:
        while True:
            await trio.sleep(RENEW_S)
            if world.clock.now() < SLEPT_S:
                modes.ask()

    async with background_tasks() as nursery:
        nursery.start_soon(renew)
        lost_s = await lost_after(world, modes, slept_after_s=5 * T_LEASE_S, monkeypatch=monkeypatch)
    assert 5 * T_LEASE_S <= lost_s <= 5 * T_LEASE_S + LEASE_LOOK_S


async def test_what_is_done_before_its_end_is_noticed_counts_for_nothing(
    autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = make_world()
    use = OwnUse(Modes(world), world)  # type: ignore[arg-type]

    async def read() -> None:
        async with use.hold(SceneMode.RENDER):
            monkeypatch.setattr(world.clock, "now", lambda: trio.current_time() + SLEPT_S)
            await trio.sleep(LEASE_LOOK_S / 4)

    with pytest.raises(Refused, match="lost its lease"):
        await read()
