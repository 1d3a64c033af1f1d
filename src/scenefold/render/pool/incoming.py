"""The rays of a frame that came from another node, by batch (specs/30-ray-links.md). Pure."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.base.rays import RAY_BYTES, RAY_WORDS
from scenefold.base.reasons import RejectReason
from scenefold.render.passes import PassPlan
from scenefold.render.pool.outbox import Batch
from scenefold.render.pool.own_passes import pass_owner, passes_in_flight, rays_of_a_path
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


def check_room(batches: Sequence[Batch], known: Collection[int], waiting: int, nodes: int, depth: int) -> None:
    """PeerFault for what no honest node sends: rays of more passes than may be open, or more rays than those have (specs/30-ray-links.md).

    `known`: passes of which this node has had rays; `waiting`: rays that wait here. What is known here its owner does not know to be closed.
    """
    open_max = passes_in_flight(nodes) * nodes
    fresh = {batch.number for batch in batches}.difference(known)
    if fresh and len(known) + len(fresh) > 2 * open_max:
        raise PeerFault("rays of more passes came than may be open", where=f"{len(known)} and {len(fresh)} more")
    more = sum(len(batch.rays) for batch in batches)
    if more and waiting + more > open_max * PASS_PATHS_MAX * rays_of_a_path(depth):
        raise PeerFault("more rays came than open passes have", where=f"{waiting} and {more} more")


def check_senders(batches: Sequence[Batch], plan: PassPlan, nodes: int, sender: int) -> None:
    """Refused (12) if rays from a node of another pool are not of a pass that it owns: paths are dealt by who owns them, and stay in a pool."""
    if any(pass_owner(plan, batch.number, nodes) != sender for batch in batches):
        raise Refused(RejectReason.NOT_AUTHORISED, "paths are dealt by the owner of their pass", where=f"node {sender} of the job")
