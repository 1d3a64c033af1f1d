"""A node that starts, and the seeds that it was told of: whether any of them answers."""

from __future__ import annotations

import logging
from collections.abc import Callable

import trio

from scenefold.base.errors import Unreachable
from scenefold.peer.membership.gossip import Gossip

SEED_WARNING_S_MAX = 5.0
"""A person who starts a node wants to hear soon that nobody answers."""

_log = logging.getLogger("scenefold.peer")


async def watch_seeds(gossip: Gossip, wait_s: float, goes_on: Callable[[], bool]) -> None:
    """Say once that nobody answers; give up in the end, unless others of its log do, or have found us, or `goes_on`.

    So a seed does, that others look for, and a member: after a power failure it may just be the first one that is up again.
    """
    warning_s = min(SEED_WARNING_S_MAX, wait_s / 2)
    silent = ", ".join(gossip.seeds)
    with trio.move_on_after(warning_s):
        await gossip.a_seed_heard()
        return
    if not gossip.met():
        _log.warning("no seed answers yet (%s): trying on", silent)
    with trio.move_on_after(wait_s - warning_s):
        await gossip.a_seed_heard()
        return
    if not goes_on() and not gossip.met():
        raise Unreachable(
            f"no seed answered within {wait_s:g} s",
            where=silent,
            remedy="start these nodes first, or name others as seeds",
        )
    await gossip.a_seed_heard()
