"""Packets 5 and 6, who knows what of a log (thesis C.3), and 118 to 120: please have this decided.

The private part of a log is sealed for its members elsewhere and travels as opaque bytes, as do proposed records. How those who decide
a log agree among themselves: `consensus_packets`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from scenefold.base.limits import PARTICIPANTS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire.ballots import BALLOT, PROPOSAL_ID, Ballot, ProposalId
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
from scenefold.wire.members import MEMBER, MEMBERS, Member
from scenefold.wire.scene_headers import DECISION_OR_NONE, SCENE_LOG_PUBLIC, Decision, SceneLogPublic

MAC = Bin(lengths=(0, 32))
GENESIS_OR_ANY = Bin(lengths=(0, 32))
PROOF = Bin(lengths=(0, 32, 64, 384))


class Want(IntEnum):
    """What a RequestSceneLog asks for."""

    HEADER = 1
    LOG = 2
    LEASE = 3
    DECIDED = 4
    """What is decided above `have`, with what shows it."""


@dataclass(frozen=True, slots=True)
class Highest:
    """The accepted record of the highest ballot that was met on the way."""

    ballot: Ballot
    record: bytes


HIGHEST = Struct(Highest, ("ballot", BALLOT), ("record", LOG))


@dataclass(frozen=True, slots=True)
class SceneLogAnswer:
    """Body of a RespondSceneLog. `flags`: bit 0 GRANT, bit 1 COMMIT."""

    nonce: int
    flags: int
    position: int
    ballot: Ballot
    nodes: tuple[Member, ...]
    public: SceneLogPublic
    private: bytes | None
    mac_epoch: int
    mac: bytes


SCENE_LOG_ANSWER = Struct(
    SceneLogAnswer,
    ("nonce", U64),
    ("flags", Uint(8, most=3)),
    ("position", U64),
    ("ballot", BALLOT),
    ("nodes", MEMBERS),
    ("public", SCENE_LOG_PUBLIC),
    ("private", Maybe(LOG)),
    ("mac_epoch", U32),
    ("mac", MAC),
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
    TYPE: ClassVar[int] = 118
    genesis: bytes
    proposal: ProposalId
    route: tuple[NodeId, ...]
    nodes: tuple[Member, ...]
    highest: Highest | None
    takeover: bool
    public: SceneLogPublic
    private: bytes
    mac_epoch: int
    mac: bytes


@dataclass(frozen=True, slots=True)
class AcceptSceneProposal(Packet):
    """`decision`: of the proposed header; None in the cluster's own log, whose headers are signed by who decides them."""

    TYPE: ClassVar[int] = 119
    genesis: bytes
    proposal: ProposalId
    record_hash: bytes
    nodes: tuple[Member, ...]
    highest: Highest | None
    mac_epoch: int
    mac: bytes
    decision: Decision | None = None


@dataclass(frozen=True, slots=True)
class RejectSceneProposal(Packet):
    TYPE: ClassVar[int] = 120
    genesis: bytes
    proposal: ProposalId
    reason: RejectReason
    nodes: tuple[Member, ...]
    hint: Ballot
    node: NodeId
    mac_epoch: int
    mac: bytes


ROWS = (
    row(
        RequestSceneLog,
        Carrier.UDP_HIGH,
        ("scene", SCENE),
        ("genesis", GENESIS_OR_ANY),
        ("have", U64),
        ("nonce", U64),
        ("want", Choice(Want)),
        ("member", Maybe(MEMBER)),
        ("proof", PROOF),
        ("lives", Many(U64, counts=(0, 2))),
    ),
    row(RespondSceneLog, Carrier.BOTH_HIGH, ("answer", Maybe(SCENE_LOG_ANSWER)), ("decided", Maybe(DECIDED_LOG))),
    row(
        ProposeSceneLog,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("route", Many(U32, PARTICIPANTS_MAX)),
        ("nodes", MEMBERS),
        ("highest", Maybe(HIGHEST)),
        ("takeover", BOOL),
        ("public", SCENE_LOG_PUBLIC),
        ("private", LOG),
        ("mac_epoch", U32),
        ("mac", MAC),
    ),
    row(
        AcceptSceneProposal,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("record_hash", DIGEST),
        ("nodes", MEMBERS),
        ("highest", Maybe(HIGHEST)),
        ("mac_epoch", U32),
        ("mac", MAC),
        ("decision", DECISION_OR_NONE),
    ),
    row(
        RejectSceneProposal,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("reason", REASON),
        ("nodes", MEMBERS),
        ("hint", BALLOT),
        ("node", U32),
        ("mac_epoch", U32),
        ("mac", MAC),
    ),
)
STRUCTS = (HIGHEST, SCENE_LOG_ANSWER)
