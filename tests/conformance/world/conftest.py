"""Runs the suite on each world: in real time, and in virtual time."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
import trio

from conformance.world.makers import RealWorlds, SimWorlds, Worlds
from scenefold.world.sim import VirtualTime, run_on

MAKERS = {"real": RealWorlds, "sim": SimWorlds}
SEED = 1


@pytest.fixture(params=sorted(MAKERS))
def worlds(request: pytest.FixtureRequest) -> Worlds:
    return MAKERS[request.param]()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if _world_of(item) == "sim" and inspect.iscoroutinefunction(getattr(item, "obj", None)):
            item.add_marker(pytest.mark.trio(run=_in_virtual_time))


def _world_of(item: pytest.Item) -> object:
    callspec = getattr(item, "callspec", None)
    return callspec.params.get("worlds") if callspec is not None else None


def _in_virtual_time(test: Callable[..., Awaitable[None]], *, clock: trio.abc.Clock | None = None, **options: Any) -> None:
    assert clock is None
    run_on(VirtualTime(virtual_s_max=1e5, wall_s_max=60), SEED, test, **options)
