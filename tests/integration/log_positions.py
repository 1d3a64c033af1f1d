"""`python -m integration.log_positions PROFILE GENESIS POSITION ADDRESS...`: ends once each of these nodes has decided so much of a scene's log.

A program, since it has to run where the nodes can be reached (cut_networks.py). It says of one after the other when it was there.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import trio

from scenefold.base.errors import Unreachable
from scenefold.consensus.packets import scene_of
from scenefold.wire import RequestSceneLog, RespondSceneLog, Want
from scenefold.world import Links, Priority, open_links, real_world
from scenefold.world.profile import ClusterProfile

ANSWER_S_MAX = 10.0
LOOK_S = 0.2


async def decided_by(links: Links, address: str, genesis: bytes, position: int) -> int:
    """How far a node is by its own log, whatever newer header it was shown; 0 if it does not say."""
    request = RequestSceneLog(scene_of(genesis), genesis, position, 1, Want.DECIDED)
    try:
        reply = await links.request(address, Priority.HIGH, request, ANSWER_S_MAX)
    except Unreachable:
        return 0
    return reply.decided.newest if isinstance(reply, RespondSceneLog) and reply.decided is not None else 0


async def all_come_to(profile: Path, genesis: bytes, position: int, addresses: Sequence[str]) -> None:
    known = ClusterProfile.load(profile)
    world = real_world(known.user_identity(), known.authority_certificate(), ports=known.ports)
    begun = trio.current_time()
    async with open_links(world) as links:
        for address in addresses:
            first = await decided_by(links, address, genesis, position)
            at = first
            while at < position:
                await trio.sleep(LOOK_S)
                at = await decided_by(links, address, genesis, position)
            print(f"{address}: at {first} when first asked, at {at} after {trio.current_time() - begun:.1f} s", flush=True)


if __name__ == "__main__":
    folder, genesis, position, *nodes = sys.argv[1:]
    trio.run(all_come_to, Path(folder), bytes.fromhex(genesis), int(position), nodes)
