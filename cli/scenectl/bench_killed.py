"""What `bench log` does about deaths: the participant that proposes is ended with `kill -9` while it is at it, and somebody else goes on."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

import trio

if TYPE_CHECKING:
    from scenefold.client.scene_log import ReadLog
    from scenefold.node.local import LocalCluster

Change = Callable[[], Awaitable["ReadLog"]]

REST_S = 2.0
"""After the dead one is back: it learns what was decided meanwhile."""
NEXT_S_MAX = 60.0


async def killed(nodes: LocalCluster, one: Change, other: Change, kills: int, goal_s: float) -> dict[str, Any]:
    """`one` and `other` change the same scene, each by connections of its own; the report.

    Each time at another moment of a change of `one`; `other` begins to ask at that moment, and what it is told counts.
    """
    next_s, own_s, lost = [], [], 0
    for number in range(kills):
        await other()
        begun = time.monotonic()
        proposer = proposer_of(await one())
        usual_s = time.monotonic() - begun
        async with trio.open_nursery() as nursery:
            ends: list[float | None] = []
            nursery.start_soon(_ended, one, ends)
            await trio.sleep(usual_s * (number + 1) / (kills + 1))
            await nodes.kill(proposer)
            dead_at = time.monotonic()
            with trio.fail_after(NEXT_S_MAX):
                await _until_told(other)
            next_s.append(time.monotonic() - dead_at)
        if ends[0] is None:
            lost += 1
        else:
            own_s.append(max(0.0, ends[0] - dead_at))
        nodes.start(proposer)
        await nodes.wait([proposer])
        await trio.sleep(REST_S)
    most = max(next_s)
    return {
        "kills": kills,
        "next_commit_s": next_s,
        "own_commit_s": own_s,
        "own_unknown": lost,
        "goal_s": goal_s,
        "is_reached": most <= goal_s,
    }


def proposer_of(log: ReadLog) -> str:
    """The address of who had the newest position decided."""
    from scenefold.base.ids import address_of
    from scenefold.wire import SceneCertificate

    assert log.header.decision is not None
    return address_of(SceneCertificate.decode(log.header.decision.certificates[-1]).ballot.node)


async def _ended(change: Change, ends: list[float | None]) -> None:
    """Whether it was acknowledged, and when."""
    from scenefold.base.errors import Refused, Unreachable

    try:
        await change()
    except (Refused, Unreachable):
        ends.append(None)
    else:
        ends.append(time.monotonic())


async def _until_told(change: Change) -> None:
    from scenefold.base.errors import Refused, Unreachable

    while True:
        try:
            await change()
        except (Refused, Unreachable):
            continue
        return
