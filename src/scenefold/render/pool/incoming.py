"""The rays of a frame that came from another node, by batch (specs/30-ray-links.md). Pure."""

from __future__ import annotations

import numpy as np

from scenefold.base.errors import PeerFault
from scenefold.base.rays import RAY_BYTES, RAY_WORDS
from scenefold.render.passes import PassPlan
from scenefold.render.pool.outbox import Batch
from scenefold.wire import SendRays


def batches_of(packet: SendRays, plan: PassPlan) -> list[Batch]:
    """In their order. PeerFault if there are more or fewer rays than they have, or rays of a pass or path that there is not."""
    if len(packet.rays) != RAY_BYTES * sum(batch.count for batch in packet.batches):
        raise PeerFault("a packet of rays is ill-formed", where=f"{len(packet.rays)} bytes")
    rays = np.frombuffer(packet.rays, np.uint32).reshape(-1, RAY_WORDS)
    batches, at = [], 0
    for batch in packet.batches:
        number, some = batch.pass_index, rays[at : at + batch.count]
        if number >= plan.count:
            raise PeerFault("the job has no such pass", where=f"pass {number}")
        if int(some[:, 7].max()) >> 16 >= plan.size(number):
            raise PeerFault("a ray belongs to a path that its pass does not have", where=f"pass {number}")
        # A few rays that wait for long keep nothing but themselves.
        batches.append(Batch(batch.partition_epoch, number, some if len(packet.batches) == 1 else some.copy()))
        at += batch.count
    return batches
