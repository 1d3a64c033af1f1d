"""If this fails, a node that loads a cell for long is taken for lost when another one has refused to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.render.pool.cell import Cell
from scenefold.render.pool.moving import Held, Moving
from scenefold.render.pool.promises import Promises

LOADS_S = 80.0
FIRST = Division((Partition.voronoi([[0, 0, 0], [1, 0, 0]], epoch=1),))


class Scene:
    """One that says whether it was closed."""

    def __init__(self) -> None:
        self.is_closed = False

    def close(self) -> None:
        self.is_closed = True


class Workers:
    async def run(self, _lane: str, function: Any, *args: Any) -> Any:
        await trio.lowlevel.checkpoint()
        return function(*args)


class SlowMoving(Moving):
    """It takes long to load a cell."""

    def __init__(self) -> None:
        host = SimpleNamespace(world=SimpleNamespace(workers=Workers()))
        self.account = Promises(1 << 30).account()
        job = SimpleNamespace(nodes=(1, 2), division=FIRST)
        super().__init__(cast(Any, host), cast(Any, None), cast(Any, job), 0, self.account)
        self.loaded: list[Scene] = []
        self.held = Held(Cell(FIRST, 0, []), cast(Any, None), cast(Any, Scene()), "cell 0")

    async def _moved(self, now: Held, division: Division, place: int) -> Held:
        scene = Scene()
        self.loaded.append(scene)
        await trio.sleep(LOADS_S)
        name = f"cell {len(self.loaded)}"
        self.account.take(name, 100, "a cell", "")
        return Held(Cell(division, place, []), now.loaded, cast(Any, scene), name)


async def test_what_is_wanted_no_more_is_let_go_of_once_it_is_there(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Cell, "can_route", True)
    moving = SlowMoving()
    refused: list[Refused] = []

    async def fetch(epoch: int) -> None:
        try:
            await moving.fetch(FIRST.with_epoch(epoch).to_document())
        except Refused as refusal:
            refused.append(refusal)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(fetch, 2)
        await trio.sleep(0.5)
        await moving.forget(2)
        assert trio.current_time() == 0.5
    assert len(refused) == 1 and moving.loaded[0].is_closed and moving.account.held == 0
    # The next one is another matter.
    await fetch(3)
    assert len(refused) == 1 and moving.account.held == 100
    await moving.forget(3)
    assert moving.loaded[1].is_closed and moving.account.held == 0
