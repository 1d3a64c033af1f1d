"""What one other member knows of scenes: its list, or one header. Nothing of it is believed here. And telling all of them."""

from __future__ import annotations

import logging

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.limits import SCENES_KEPT_MAX
from scenefold.peer.peers import Peers
from scenefold.peer.scene_log.proposals import answer_of
from scenefold.wire import ListScenes, RequestSceneLog, RespondSceneLog, SceneLogPublic, ScenesListed, Want, check_page
from scenefold.world import Priority

ASK_S_MAX = 2.0
"""For one node to answer about a scene; the next one is asked then."""

_log = logging.getLogger("scenefold.peer.scene_log.scenes")


async def listed_by(peers: Peers, member: NodeId) -> list[SceneLogPublic]:
    """All scenes that a member knows, page by page. Unreachable, Refused or PeerFault if it does not say."""
    listed: list[SceneLogPublic] = []
    while len(listed) < SCENES_KEPT_MAX:
        after = listed[-1].scene if listed else 0
        answer = await peers.ask(member, Priority.HIGH, ListScenes(after), ScenesListed, ASK_S_MAX)
        listed += check_page(answer, after, address_of(member))
        if not answer.more:
            break
    return listed


async def shown_by(peers: Peers, member: NodeId, request: RequestSceneLog) -> SceneLogPublic | None:
    """The header that a member has of a scene, of the position that is asked for if it has that; None if it is silent, or has none."""
    try:
        return await _answer_of(peers, member, request)
    except (Unreachable, Refused, PeerFault):
        return None


async def said_by(peers: Peers, member: NodeId, scene: SceneId) -> SceneLogPublic | None:
    """The newest header that a member has of a scene, or None. Unreachable, Refused or PeerFault if it does not say."""
    return await _answer_of(peers, member, RequestSceneLog(scene=scene, genesis=b"", have=0, nonce=0, want=Want.HEADER))


async def _answer_of(peers: Peers, member: NodeId, request: RequestSceneLog) -> SceneLogPublic | None:
    answer = (await peers.ask(member, Priority.HIGH, request, RespondSceneLog, ASK_S_MAX)).answer
    return answer.public if answer is not None and answer.public.scene == request.scene else None


async def tell_all(peers: Peers, public: SceneLogPublic) -> None:
    """Push a decided header to all others, waiting a bounded time. Whoever misses it pulls it later."""
    packet = RespondSceneLog(answer=answer_of(public, 0, None))

    async def tell(member: NodeId) -> None:
        try:
            await peers.tell(member, Priority.HIGH, packet, ASK_S_MAX)
        except Unreachable as problem:
            _log.info("scene %08x not told to %s: %s", public.scene, address_of(member), problem)

    async with trio.open_nursery() as nursery:
        for member in peers.others():
            nursery.start_soon(tell, member)
