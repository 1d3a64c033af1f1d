"""Which proposal for which position (specs/25-consensus.md, Terms)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from scenefold.wire.common import U32, U64, NodeId
from scenefold.wire.containers import Struct
from scenefold.wire.kinds import Choice


class Phase(IntEnum):
    PREPARE = 1
    ACCEPT = 2


@dataclass(frozen=True, slots=True, order=True)
class Ballot:
    """Ordered by counter, then node; (0, 0) is none."""

    counter: int
    node: NodeId


@dataclass(frozen=True, slots=True)
class ProposalId:
    position: int
    ballot: Ballot
    phase: Phase


BALLOT = Struct(Ballot, ("counter", U32), ("node", U32))
PROPOSAL_ID = Struct(ProposalId, ("position", U64), ("ballot", BALLOT), ("phase", Choice(Phase)))
STRUCTS = (BALLOT, PROPOSAL_ID)
