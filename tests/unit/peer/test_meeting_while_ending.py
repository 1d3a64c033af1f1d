"""If this fails, a node that is ended while it keeps a scene's header calls that a bug of its own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import trio
import trio.testing

from scenefold.base.ids import SceneId
from scenefold.peer.scene_log import observations, participation
from scenefold.peer.scene_log.observations import Observations
from scenefold.peer.scene_log.participation import Participation
from unit.client.fake_nodes import make_world

ME: Any = SimpleNamespace(node=1)
OTHER: Any = SimpleNamespace(node=2)


class Began:
    """A log, or an observer, whose task is never begun."""

    def __init__(self, *_: object, **__: object) -> None:
        self.begun = False

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        self.begun = True
        task_status.started()
        await trio.sleep_forever()


def header(*, participants: tuple[Any, ...] = (), observers: tuple[Any, ...] = ()) -> Any:
    """Of scene 3."""
    of = [tuple(SimpleNamespace(member=member) for member in members) for members in (participants, observers)]
    return SimpleNamespace(scene=SceneId(3), genesis=bytes(32), participants=of[0], observers=of[1])


async def test_of_a_scene_in_which_it_would_take_part_nothing_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(participation, "SceneRun", Began)

    async def kept() -> frozenset[bytes]:
        await trio.lowlevel.checkpoint()
        return frozenset()

    intake: Any = SimpleNamespace()
    store: Any = SimpleNamespace(logs_kept=kept, has_let_go=lambda _: False)
    own: Any = SimpleNamespace(member=ME)
    scenes: Any = SimpleNamespace(everyone=list, known=None)
    taking: Any = Participation(make_world(), store, SimpleNamespace(), own, SimpleNamespace(intake=intake), trio.Event())  # type: ignore[arg-type]
    async with trio.open_nursery() as nursery:
        await nursery.start(taking.run, scenes)
        nursery.cancel_scope.cancel()
    known: Any = SimpleNamespace(public=header(participants=(ME, OTHER)), is_ended=False)
    taking.meets(known)
    assert not taking._runs[SceneId(3)].begun


async def test_nor_of_one_that_it_would_observe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observations, "SceneObserver", Began)
    own: Any = SimpleNamespace(member=ME)
    nobody: Any = SimpleNamespace()
    watching = Observations(make_world(), nobody, own)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(watching.run, nobody)
        await trio.testing.wait_all_tasks_blocked()
        nursery.cancel_scope.cancel()
    watching.meets(header(participants=(OTHER,), observers=(ME,)))
    watching._is_behind(SceneId(3), 7)
    assert not watching._all[SceneId(3)].begun  # type: ignore[attr-defined]
