"""What an organiser says to hold the places of a job, while nobody else asks: some nodes prepare longer than others, and films are merged."""

from __future__ import annotations

from collections.abc import Callable, Collection

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import NodeId
from scenefold.render.job import Job
from scenefold.render.pool.hold import WORD_S
from scenefold.render.pool.host import Host
from scenefold.wire import JobState


async def keep_places(host: Host, job: Job, nodes: Callable[[], Collection[NodeId]]) -> None:
    """Until cancelled, with those of the job's nodes that are not lost (`nodes`). What they answer hears who waits for it."""

    async def keep(node: NodeId) -> None:
        while True:
            await host.world.clock.sleep(WORD_S)
            if node not in nodes():
                continue
            try:
                await host.ask(node, JobState(job=job.id), WORD_S)
            except ScenefoldError:
                continue

    async with trio.open_nursery() as nursery:
        for node in job.nodes:
            nursery.start_soon(keep, node)
