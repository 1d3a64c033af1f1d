"""What is said when a position of a scene's log is proposed, and what of the answers is believed. Pure."""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.errors import DamagedData, PeerFault, Refused
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


def refusal_of(reason: RejectReason, name: str) -> Refused:
    """In words, for whoever proposed something."""
    where = f"scene {name}"
    if reason is RejectReason.LIMIT_EXCEEDED:
        what = f"the cluster takes no more scenes: {SCENES_PER_USER_MAX} of one user, {SCENES_LISTED_MAX} in all"
        return Refused(reason, what, where=where, remedy="use one of those that there are: `scenectl scene list`")
    if reason is RejectReason.BUSY:
        return Refused(reason, "the cluster is busy: the scene was changed too often lately", where=where, remedy="try again in a while")
    words = reason.name.lower().replace("_", " ")
    return Refused(reason, f"the cluster refused the scene: {words}", where=where)
