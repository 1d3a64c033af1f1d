"""What is said when a position of a scene's log is proposed, and what of the answers is believed. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from scenefold.base.errors import DamagedData, PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import SCENES_LISTED_MAX, SCENES_PER_USER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.scene.log import CHANGES_MAX, changes_left, check_decided
from scenefold.wire import AcceptSceneProposal, ProposeSceneLog, RejectSceneProposal, SceneLogPublic, SceneMode

NOBODY = NodeId(0)


def proposal_of(header: SceneLogPublic, private: bytes, *, forced: bool = False) -> ProposeSceneLog:
    """Packet 118: please have this header, with its sealed log, decided. `forced`: whomever the change of the mode does not suit."""
    return ProposeSceneLog(header.genesis, header, private, forced)


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


def refusal_of(
    reason: RejectReason,
    by: NodeId = NOBODY,
    silent_ms: int = 0,
    *,
    name: str,
    before: SceneLogPublic | None = None,
    after: SceneLogPublic | None = None,
    silent: Sequence[NodeId] = (),
    is_question: bool = False,
) -> Refused:
    """In words, for whoever proposed something. `by`: who says so, if that is known; `before`: the header that it was to follow; `after`: itself.

    `silent_ms`: with PEER_MISSED, since when `by`, who does not answer, gave no sign of life; 0: not known. `silent`: with NO_MAJORITY,
    participants that did not answer us either. `is_question`: nothing was proposed, but asked what became of something.
    """
    where = f"scene {name}" + (f", says {address_of(by)}" if by else "")
    if before is not None and before.participants:
        if reason is RejectReason.NO_MAJORITY:
            return _no_majority(where, before, silent, is_question=is_question)
        mode = None if after is None or after.mode is before.mode else after.mode
        if reason is RejectReason.PEER_MISSED and by:
            return _missed(by, silent_ms, name, before, mode)
        if reason is RejectReason.BUSY and _observes(by, before):
            what = f"an observer of the scene, {address_of(by)}, is reading it for an image"
            return Refused(reason, what, where=f"scene {name}", remedy=_waiting("the render", name, mode))
        if reason is RejectReason.BUSY and mode is not None:
            return _in_use(mode, where, name)
        changes = after is not None and after.participants != before.participants
        if reason is RejectReason.LIMIT_EXCEEDED and changes and not changes_left(before):
            return no_change_left(name, where=where)
        return _refusal_of_participants(reason, where, name)
    if reason is RejectReason.LIMIT_EXCEEDED:
        what = f"the cluster takes no more scenes: {SCENES_PER_USER_MAX} of one user, {SCENES_LISTED_MAX} in all"
        return Refused(reason, what, where=where, remedy="use one of those that there are: `scenectl scene list`")
    if reason is RejectReason.BUSY:
        return Refused(reason, "the cluster is busy: the scene was changed too often lately", where=where, remedy="try again in a while")
    words = reason.name.lower().replace("_", " ")
    return Refused(reason, f"the cluster refused the scene: {words}", where=where)


def _no_majority(where: str, before: SceneLogPublic, silent: Sequence[NodeId], *, is_question: bool) -> Refused:
    nodes = [address_of(entry.member.node) for entry in before.participants]
    what = f"no majority of the nodes that decide the scene's log could be reached: {len(nodes) // 2 + 1} of {len(nodes)} must agree"
    if silent:
        what += f", and {', '.join(map(address_of, silent))} {'does' if len(silent) == 1 else 'do'} not answer"
    told = "ask again; what was begun may be on the disk of one of them" if is_question else "repeat it; nothing was changed"
    remedy = f"start those that are down, and {told}"
    return Refused(RejectReason.NO_MAJORITY, what, where=f"{where}; {', '.join(nodes)}", remedy=remedy)


def _missed(node: NodeId, silent_ms: int, name: str, before: SceneLogPublic, mode: SceneMode | None) -> Refused:
    """Of a change of the mode: who seems alive has to agree."""
    address, part = address_of(node), "an observer" if _observes(node, before) else "a participant"
    since = f"; its last sign of life came {silent_ms / 1000:.1f} s ago" if silent_ms else ""
    what = f"{address}, {part} of the scene, was asked whether the mode may change, and does not answer{since}"
    forget = f"`scenectl scene remove-{part.split()[1]} {name} {address}` if it is gone for good"
    remedy = f"start it, or repeat this when the others have noticed that it is away; or {forget}"
    if mode is not SceneMode.ENDED:
        remedy += "; `--force` asks nobody"
    return Refused(RejectReason.PEER_MISSED, what, where=f"scene {name}", remedy=remedy)


def _in_use(mode: SceneMode, where: str, name: str) -> Refused:
    """Of a change of the mode: mostly somebody uses the scene, and what helps against that helps against the rest as well."""
    work = "somebody renders" if mode is SceneMode.EDIT else "somebody edits"
    what = (
        f"not now: {work} the scene, by a lease that a node has lent, or may do so by one that it lent before it was started anew, "
        "or a node that decides its log has too much to do"
    )
    return Refused(RejectReason.BUSY, what, where=where, remedy=_waiting("that", name, mode))


def _waiting(what: str, name: str, mode: SceneMode | None) -> str:
    """Behind a change of the mode. The end of a scene is one that nobody forces."""
    if mode is SceneMode.ENDED:
        return f"wait until {what} has ended, and repeat it"
    to = "MODE" if mode is None else mode.name.lower()
    return f"wait until {what} has ended; `scenectl scene mode {name} {to} --force` ends it"


def no_change_left(name: str, *, where: str = "") -> Refused:
    """Of participants that change no more."""
    what = f"the nodes that decide the scene's log have changed {CHANGES_MAX} times, as often as they can in its life"
    return Refused(RejectReason.LIMIT_EXCEEDED, what, where=where or f"scene {name}", remedy=_anew(name))


def one_change_left(name: str, leaving: NodeId | None) -> Refused:
    """Too few for another one in somebody's place. `leaving`: who that is, if the others can do without."""
    what = "the nodes that decide the scene's log can change once more in its life, and to replace one of them takes two changes"
    remedy = _anew(name)
    if leaving is not None:
        alone = f"`scenectl scene remove-participant {name} {address_of(leaving)}`"
        remedy = f"{alone} lets it decide no more, and nobody in its place; or {remedy}"
    return Refused(RejectReason.LIMIT_EXCEEDED, what, where=f"scene {name}", remedy=remedy)


def times_text(left: int) -> str:
    """How often something can be done."""
    return "no more" if not left else "once more" if left == 1 else f"{left} more times"


def _anew(name: str) -> str:
    archive = f"`scenectl scene export {name} {name}.tar`, and `scenectl scene import-archive {name}.tar --scene ANOTHER`"
    return f"put its content into a new scene, which begins anew with that: {archive}"


def _observes(node: NodeId, header: SceneLogPublic) -> bool:
    return any(entry.member.node == node for entry in header.observers)


def _refusal_of_participants(reason: RejectReason, where: str, name: str) -> Refused:
    see = f"`scenectl scene participants {name}` shows them"
    match reason:
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
            return Refused(reason, "the scene's log is too long for this", where=where, remedy=_anew(name))
        case _:
            words = reason.name.lower().replace("_", " ")
            return Refused(reason, f"the nodes that decide the scene's log refused it: {words}", where=where, remedy=see)
