"""Packets 5 and 6, who knows what of a log (thesis C.3), and 118 to 120: please have this decided.

The private part of a log is sealed for its members elsewhere and travels as opaque bytes, as do proposed records. How those who decide
a log agree among themselves: `consensus_packets`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from scenefold.base.reasons import RejectReason
from scenefold.wire.common import (
    BOOL,
    DIGEST,
    LOG,
    REASON,
    SCENE,
    U32,
    U64,
    Carrier,
    NodeId,
    Packet,
    SceneId,
    row,
)
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Bin, Choice, Maybe, Uint
from scenefold.wire.log_values import DECIDED_LOG, DecidedLog
from scenefold.wire.members import MEMBER, Member
from scenefold.wire.scene_headers import DECISION_OR_NONE, SCENE_LOG_PUBLIC, Decision, SceneLogPublic

GENESIS_OR_ANY = Bin(lengths=(0, 32))
PROOF = Bin(lengths=(0, 32, 64, 384))


class Want(IntEnum):
    """What a RequestSceneLog asks for."""

    HEADER = 1
    LOG = 2
    LEASE = 3
    DECIDED = 4
    """What is decided above `have`, with what shows it."""
    LIVES = 5
    """Of the cluster's log: the lives that a voter of before the change at `have` holds."""
    CONSENT = 6
    """Of an observer of a scene: whether its mode may change behind `have`."""


@dataclass(frozen=True, slots=True)
class SceneLogAnswer:
    """Body of a RespondSceneLog. `flags`: bit 0 GRANT, bit 1 COMMIT."""

    nonce: int
    flags: int
    position: int
    public: SceneLogPublic
    private: bytes | None


SCENE_LOG_ANSWER = Struct(
    SceneLogAnswer,
    ("nonce", U64),
    ("flags", Uint(8, most=3)),
    ("position", U64),
    ("public", SCENE_LOG_PUBLIC),
    ("private", Maybe(LOG)),
)


@dataclass(frozen=True, slots=True)
class RequestSceneLog(Packet):
    """`genesis` empty: whatever scene has this id here. `lives`: with LEASE, the two that the asker's disk holds."""

    TYPE: ClassVar[int] = 5
    BULK_ANSWER: ClassVar[bool] = True
    scene: SceneId
    genesis: bytes
    have: int
    nonce: int
    want: Want
    member: Member | None = None
    proof: bytes = b""
    lives: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class RespondSceneLog(Packet):
    """`answer` None: the scene is unknown here. `decided`: with DECIDED, and where a decision is told without being asked for; `answer`
    is None then, and says nothing."""

    TYPE: ClassVar[int] = 6
    answer: SceneLogAnswer | None
    decided: DecidedLog | None = None


@dataclass(frozen=True, slots=True)
class ProposeSceneLog(Packet):
    """Please have this decided: a scene's header with its sealed log; in the cluster's own log its first header, and the record.

    `forced`: a change of the mode, of which nobody need consent.
    """

    TYPE: ClassVar[int] = 118
    genesis: bytes
    public: SceneLogPublic
    private: bytes
    forced: bool = False


@dataclass(frozen=True, slots=True)
class AcceptSceneProposal(Packet):
    """`decision`: of the proposed header; None in the cluster's own log, whose headers are signed by who decides them."""

    TYPE: ClassVar[int] = 119
    position: int
    record_hash: bytes
    decision: Decision | None = None


@dataclass(frozen=True, slots=True)
class RejectSceneProposal(Packet):
    """`node`: who says so, or decides instead; with PEER_MISSED who does not answer, and `silent_ms` how long ago there was a sign of life of it, 0 if
    that is not known."""

    TYPE: ClassVar[int] = 120
    reason: RejectReason
    node: NodeId
    silent_ms: int = 0


ROWS = (
    row(
        RequestSceneLog,
        Carrier.TCP_HIGH,
        ("scene", SCENE),
        ("genesis", GENESIS_OR_ANY),
        ("have", U64),
        ("nonce", U64),
        ("want", Choice(Want)),
        ("member", Maybe(MEMBER)),
        ("proof", PROOF),
        ("lives", Many(U64, counts=(0, 2))),
    ),
    row(RespondSceneLog, Carrier.TCP_HIGH, ("answer", Maybe(SCENE_LOG_ANSWER)), ("decided", Maybe(DECIDED_LOG))),
    row(ProposeSceneLog, Carrier.TCP_HIGH, ("genesis", DIGEST), ("public", SCENE_LOG_PUBLIC), ("private", LOG), ("forced", BOOL)),
    row(AcceptSceneProposal, Carrier.TCP_HIGH, ("position", U64), ("record_hash", DIGEST), ("decision", DECISION_OR_NONE)),
    row(RejectSceneProposal, Carrier.TCP_HIGH, ("reason", REASON), ("node", U32), ("silent_ms", U32)),
)
STRUCTS = (SCENE_LOG_ANSWER,)
