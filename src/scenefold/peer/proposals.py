"""May this become the scene's next position? (consensus.md §3, with one participant; specs/16-scene-log.md, Deciding.) Pure.

The node that a scene's headers name as origin decides alone. It cannot read the records, so it compares positions: what
extends its newest header by one is the next; what it holds already, byte for byte, is told so again, because an answer may
have been lost; anything else came too late, and its author rebases it.
"""

from __future__ import annotations

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.peer.headers import FIRST_POSITION
from scenefold.wire import Ballot, Phase, ProposeSceneLog, RejectSceneProposal, SceneLogAnswer, SceneLogPublic

_COMMIT_FLAG = 2


def is_decided(packet: ProposeSceneLog, known: SceneLogPublic | None, private: bytes | None) -> bool:
    """Whether exactly this was accepted before; False if it may be the next. Refused with the reason why it may not.

    `known`: the newest header here, and `private` the sealed log that was accepted with it.
    """
    public = packet.public
    if packet.genesis != public.genesis or packet.proposal.position != public.position:
        raise Refused(RejectReason.ILL_FORMED, "the proposal is for another genesis or position than its header's")
    if packet.proposal.phase is not Phase.ACCEPT:
        raise Refused(RejectReason.ILL_FORMED, "a scene with one participant has nothing to prepare")
    if known is None:
        if public.position != FIRST_POSITION:
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, "a scene begins with its first header")
        return False
    if public.position == known.position:
        # The first record follows from the genesis; sealing it again gives other bytes of the same.
        if public == known and (public.position == FIRST_POSITION or packet.private == private):
            return True
        raise Refused(RejectReason.POSITION_TAKEN, f"position {known.position} is decided otherwise")
    if public.position < known.position:
        raise Refused(RejectReason.POSITION_BEHIND, f"the scene's log is at position {known.position} already")
    if public.position != known.position + 1:
        raise Refused(RejectReason.ILL_FORMED, f"position {public.position} does not extend the log, which ends at {known.position}")
    return False


def rejection(packet: ProposeSceneLog, reason: RejectReason, node: NodeId) -> RejectSceneProposal:
    """9, by this node or about it."""
    return RejectSceneProposal(
        genesis=packet.genesis,
        proposal=packet.proposal,
        reason=reason,
        nodes=(),
        hint=Ballot(0, NodeId(0)),
        node=node,
        mac_epoch=0,
        mac=b"",
    )


def answer_of(public: SceneLogPublic, nonce: int, private: bytes | None) -> SceneLogAnswer:
    """What a 6 says of a position that was decided."""
    return SceneLogAnswer(
        nonce=nonce,
        flags=_COMMIT_FLAG,
        position=public.position,
        ballot=Ballot(0, NodeId(0)),
        nodes=(),
        public=public,
        private=private,
        mac_epoch=0,
        mac=b"",
    )
