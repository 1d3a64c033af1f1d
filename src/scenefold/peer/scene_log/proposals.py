"""May this become the scene's next position? (consensus.md §3, with one participant; specs/16-scene-log.md, Deciding.) Pure.

The node that a scene's headers name as origin decides alone. It cannot read the records, so it compares positions: what
extends its newest header by one is the next; what it holds already is told so again, because an answer may have been lost; anything
else came too late, and its author rebases it. That a header and a sealed log are of one position says the header, which names the log.
"""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.headers import FIRST_POSITION, check_goes_on, checked_proposal
from scenefold.scene.log.decisions import check_log, decided
from scenefold.wire import (
    AcceptSceneProposal,
    ProposeSceneLog,
    RejectSceneProposal,
    SceneLogAnswer,
    SceneLogPublic,
)

_COMMIT_FLAG = 2


def decide(packet: ProposeSceneLog, known: KnownScene | None, key: SigningKey, *, has_log: bool) -> KnownScene:
    """The scene with the header that is proposed, decided with this node's key; `known` if exactly this was decided before.

    Refused with the reason why it is not the next. `known`: the newest header here; `has_log`: its sealed log is here, too. Takes some
    milliseconds for a long log.
    """
    public = packet.public
    if packet.genesis != public.genesis:
        raise Refused(RejectReason.ILL_FORMED, "the proposal is for another genesis than its header's")
    if public.decision is not None:
        raise Refused(RejectReason.ILL_FORMED, "what is proposed is not decided yet")
    if known is not None and public == known.public.proposed():
        return known
    if known is not None:
        check_goes_on(known.public, public.position)
    if known is not None and known.public.participants:
        raise Refused(RejectReason.NOT_AUTHORISED, "the scene's participants decide its log, and not its origin alone")
    _check_extends(public, known, has_log)
    if public.origin_key != key.public.raw:
        raise Refused(RejectReason.NOT_AUTHORISED, "the scene's log is decided under another key than this node's")
    try:
        check_log(public, packet.private)
    except DamagedData as problem:
        raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem
    return replace(checked_proposal(public, known), public=decided(public, key))


def _check_extends(public: SceneLogPublic, known: KnownScene | None, has_log: bool) -> None:
    if known is None:
        if public.position != FIRST_POSITION:
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, "a scene begins with its first header")
        return
    newest = known.public.position
    if public.position == newest:
        raise Refused(RejectReason.POSITION_TAKEN, f"position {newest} is decided otherwise")
    if public.position < newest:
        raise Refused(RejectReason.POSITION_BEHIND, f"the scene's log is at position {newest} already")
    if public.position != newest + 1:
        raise Refused(RejectReason.ILL_FORMED, f"position {public.position} does not extend the log, which ends at {newest}")
    if not has_log:
        # It may have come further before the log was lost, and no position is decided twice.
        raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, "this node has lost the scene's log")


def said_of_ended(packet: ProposeSceneLog, known: SceneLogPublic, me: NodeId) -> AcceptSceneProposal | RejectSceneProposal:
    """The answer to any proposal for a scene that was ended, by whoever knows that: nothing follows, whoever has decided it."""
    public = packet.public
    if packet.genesis == known.genesis and public == known.proposed():
        return accepted(known)
    if packet.genesis != known.genesis or public.position == known.position:
        return rejection(RejectReason.POSITION_TAKEN, me)
    return rejection(RejectReason.POSITION_BEHIND if public.position < known.position else RejectReason.MODE_FORBIDS, me)


def accepted(public: SceneLogPublic) -> AcceptSceneProposal:
    """119: it was decided, as this header shows."""
    return AcceptSceneProposal(public.position, public.log_hash, public.decision)


def rejection(reason: RejectReason, node: NodeId) -> RejectSceneProposal:
    """120, by this node or about it."""
    return RejectSceneProposal(reason, node)


def answer_of(public: SceneLogPublic, nonce: int, private: bytes | None) -> SceneLogAnswer:
    """What a 6 says of a position that was decided."""
    return SceneLogAnswer(nonce, _COMMIT_FLAG, public.position, public, private)
