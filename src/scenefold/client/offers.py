"""What is said when a position of a scene's log is proposed, and what of the answers is believed. Pure."""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.errors import DamagedData, PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import SCENES_LISTED_MAX, SCENES_PER_USER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.scene.log import check_decided
from scenefold.wire import AcceptSceneProposal, ProposeSceneLog, RejectSceneProposal, SceneLogPublic


def proposal_of(header: SceneLogPublic, private: bytes) -> ProposeSceneLog:
    """Packet 118: please have this header, with its sealed log, decided."""
    return ProposeSceneLog(header.genesis, header, private)


def as_decided(packet: ProposeSceneLog, reply: AcceptSceneProposal) -> SceneLogPublic:
    """The header that was proposed, with the decision of an answer that `check_answer` has let pass."""
    return replace(packet.public, decision=reply.decision)


def check_answer(packet: ProposeSceneLog, reply: AcceptSceneProposal | RejectSceneProposal) -> None:
    """PeerFault if an answer says that a proposal was accepted and does not show it, for it may be that of a relay that lies."""
    if isinstance(reply, RejectSceneProposal):
        return
    try:
        check_decided(as_decided(packet, reply))
    except DamagedData as problem:
        raise PeerFault(f"a proposal is said to be accepted: {problem.what}", where=problem.where) from problem


def refusal_of(reason: RejectReason, name: str, by: int = 0, before: SceneLogPublic | None = None) -> Refused:
    """In words, for whoever proposed something. `by`: who says so, if that is known; `before`: the header that it was to follow."""
    where = f"scene {name}" + (f", says {address_of(NodeId(by))}" if by else "")
    if before is not None and before.participants:
        return _refusal_of_participants(reason, where, name, before)
    if reason is RejectReason.LIMIT_EXCEEDED:
        what = f"the cluster takes no more scenes: {SCENES_PER_USER_MAX} of one user, {SCENES_LISTED_MAX} in all"
        return Refused(reason, what, where=where, remedy="use one of those that there are: `scenectl scene list`")
    if reason is RejectReason.BUSY:
        return Refused(reason, "the cluster is busy: the scene was changed too often lately", where=where, remedy="try again in a while")
    words = reason.name.lower().replace("_", " ")
    return Refused(reason, f"the cluster refused the scene: {words}", where=where)


def _refusal_of_participants(reason: RejectReason, where: str, name: str, before: SceneLogPublic) -> Refused:
    nodes = [address_of(entry.member.node) for entry in before.participants]
    see = f"`scenectl scene participants {name}` shows them"
    match reason:
        case RejectReason.NO_MAJORITY:
            what = (
                f"no majority of the nodes that decide the scene's log could be reached: {len(nodes) // 2 + 1} of {len(nodes)} must agree"
            )
            return Refused(
                reason, what, where=f"{where}; {', '.join(nodes)}", remedy="start those that are down, and repeat it; nothing was changed"
            )
        case RejectReason.PEER_MISSED:
            remedy = f"start it, or wait until the others have noticed; {see}"
            return Refused(reason, "a node that takes part in the scene's log does not answer", where=where, remedy=remedy)
        case RejectReason.NOT_AUTHORISED:
            what = "it is not for you to change, or not for that node to decide: you own the scene no more, or it takes part no more"
            return Refused(reason, what, where=where, remedy=f"`scenectl scene access {name}` shows who may; {see}")
        case RejectReason.BUSY:
            what = "not now: one of the nodes that decide the scene's log has too much to do, or something under way that forbids it"
            return Refused(reason, what, where=where, remedy="try again in a while")
        case RejectReason.MODE_FORBIDS:
            what = "the scene's mode forbids it: it is being rendered, between two modes, or ended"
            return Refused(reason, what, where=where, remedy="wait until it may be edited again")
        case RejectReason.NOT_READY:
            what = "the nodes that decide the scene's log do not know yet what became of it"
            return Refused(reason, what, where=where, remedy="try again in a while")
        case RejectReason.LIMIT_EXCEEDED:
            what = "the scene's log is too long for this, or who decides it has changed as often as it can"
            return Refused(reason, what, where=where)
        case _:
            words = reason.name.lower().replace("_", " ")
            return Refused(reason, f"the nodes that decide the scene's log refused it: {words}", where=where, remedy=see)
