"""What one other member knows of scenes: its list, or one header. Nothing of it is believed here."""

from __future__ import annotations

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import SCENES_LISTED_MAX
from scenefold.peer.peers import Peers
from scenefold.wire import ListScenes, RequestSceneLog, RespondSceneLog, SceneLogPublic, ScenesListed, check_page
from scenefold.world import Priority

ASK_S_MAX = 2.0
"""For one node to answer about a scene; the next one is asked then."""


async def listed_by(peers: Peers, member: NodeId) -> list[SceneLogPublic]:
    """All scenes that a member knows, page by page. Unreachable, Refused or PeerFault if it does not say."""
    listed: list[SceneLogPublic] = []
    while len(listed) < SCENES_LISTED_MAX:
        after = listed[-1].scene if listed else 0
        answer = await peers.ask(member, Priority.HIGH, ListScenes(after), ScenesListed, ASK_S_MAX)
        listed += check_page(answer, after, address_of(member))
        if not answer.more:
            break
    return listed


async def shown_by(peers: Peers, member: NodeId, request: RequestSceneLog) -> SceneLogPublic | None:
    """The header that a member has of a scene; None if it is silent, or has none."""
    try:
        answer = (await peers.ask(member, Priority.HIGH, request, RespondSceneLog, ASK_S_MAX)).answer
    except (Unreachable, Refused, PeerFault):
        return None
    return answer.public if answer is not None and answer.public.scene == request.scene else None
