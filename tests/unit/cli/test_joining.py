"""If this fails, a node that joins says what becomes of it in an order that nobody understands."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import wait_all_tasks_blocked

from scenectl.joining import Telling
from scenectl.output import Output
from scenefold.base.location import WHOLE_LINE


async def at_once() -> None:
    await trio.lowlevel.checkpoint()


async def no_records(arc: object) -> SimpleNamespace:
    await trio.lowlevel.checkpoint()
    return SimpleNamespace(records=0, bytes=0)


async def test_nothing_is_told_before_the_node_is_said_to_be_ready(nursery: trio.Nursery, capsys: pytest.CaptureFixture[str]) -> None:
    """One that is started again is a member before it listens."""
    joined = trio.Event()
    joined.set()
    registry = SimpleNamespace(neighbours=lambda me: (None, None), order=[1])
    context: Any = SimpleNamespace(
        address="127.0.0.4",
        me=1,
        joined=joined,
        facts=SimpleNamespace(name="studio"),
        enrolment=SimpleNamespace(registered=at_once),
        cluster_log=SimpleNamespace(registry=registry),
        line=SimpleNamespace(arc=WHOLE_LINE),
        store=SimpleNamespace(arc_totals=no_records),
    )
    telling = Telling(Output(json=True))
    await nursery.start(telling.run, context)
    await wait_all_tasks_blocked()
    assert capsys.readouterr().out == ""
    telling.may_begin.set()
    await wait_all_tasks_blocked()
    assert [line.split('"')[3] for line in capsys.readouterr().out.splitlines()] == ["member", "arrived"]
