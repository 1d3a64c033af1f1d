"""A scene's header and sealed log as a value that participants decide (specs/16-scene-log.md, Participants). Pure.

    data  =  digest of who decides it 32 | digest of who decides the next position 32 | digest of the public header 32
    body  =  public header, sealed log

What is decided is the data, so nodes with nothing but the header can check who decided it, and one can show to them who decided what
came before without showing that itself.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.scene.log.roster import Entries
from scenefold.wire import (
    LogValue,
    Member,
    ParticipantEntry,
    SceneBody,
    SceneLogPublic,
    digest_of_header,
    digest_of_participants,
)

ORIGINS_INCARNATION = bytes(16)
"""Of a scene's origin as the one who decides alone: it does so in any of its lives, by its key."""
_OPENED_MAX = 4
"""Bodies that were opened last, of up to 4 MB each: whoever decides on a value looks into it again at each step."""


def deciders_after(public: SceneLogPublic) -> Entries:
    """Who decides the position after this header's."""
    return public.participants or (origin_alone(public),)


def deciding(public: SceneLogPublic) -> frozenset[NodeId]:
    """The nodes of these."""
    return frozenset(entry.member.node for entry in deciders_after(public))


def origin_alone(public: SceneLogPublic) -> ParticipantEntry:
    """The node that decides as long as there are no participants."""
    return ParticipantEntry(Member(NodeId(public.origin), ORIGINS_INCARNATION), public.origin_key)


def data_of(deciders: Entries, after: Entries, header: bytes) -> bytes:
    """What is voted for. `header`: its digest."""
    return digest_of_participants(deciders) + digest_of_participants(after) + header


def value_of(public: SceneLogPublic, private: bytes, known: SceneLogPublic) -> LogValue:
    """The value that brings this header, with its sealed log; `known` is the header before. Refused (14) if they are too large for one."""
    public = public.proposed()
    data = data_of(deciders_after(known), deciders_after(public), digest_of_header(public))
    try:
        return LogValue(data, SceneBody(public, private).encode())
    except LocalFault as problem:
        what = "the scene's log is longer than what its participants decide at once"
        raise Refused(RejectReason.LIMIT_EXCEEDED, what, where=f"scene {public.scene:08x}, {problem.what}") from problem


def opened_value(value: LogValue) -> SceneBody:
    """What a scene's value brings; MalformedPacket if it is none. Whether it is what the data names is not looked at."""
    return _opened(value.body)


@lru_cache(_OPENED_MAX)
def _opened(body: bytes) -> SceneBody:
    return SceneBody.decode(body)


def without_log(value: LogValue) -> LogValue:
    """The same value without the sealed log, which newer ones hold, too; MalformedPacket if it is none of a scene."""
    return LogValue(value.data, replace(opened_value(value), private=b"").encode())
