"""Packets 7 to 9: how those who decide a log agree on its next value (specs/25-consensus.md, Packets; thesis C.3).

Facts take the place of the thesis's lists of names: a name proves nothing, and a MAC would prove it to those alone who have the key.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.limits import DECIDERS_MAX
from scenefold.wire.ballots import PROPOSAL_ID, ProposalId
from scenefold.wire.common import BOOL, DIGEST, U32, Carrier, NodeId, Packet, row
from scenefold.wire.containers import Many
from scenefold.wire.facts import FACTS, REFUSAL, Fact, Refusal
from scenefold.wire.kinds import Maybe
from scenefold.wire.log_values import LOG_VALUE, LogValue


@dataclass(frozen=True, slots=True)
class ProposeValue(Packet):
    """`highest`: the value of the highest ballot that a promise among the facts names. `value`: what is asked for, or voted for."""

    TYPE: ClassVar[int] = 7
    genesis: bytes
    proposal: ProposalId
    route: tuple[NodeId, ...]
    facts: tuple[Fact, ...]
    highest: LogValue | None
    value: LogValue | None
    takeover: bool


@dataclass(frozen=True, slots=True)
class AcceptValue(Packet):
    TYPE: ClassVar[int] = 8
    genesis: bytes
    proposal: ProposalId
    digest: bytes
    facts: tuple[Fact, ...]
    highest: LogValue | None


@dataclass(frozen=True, slots=True)
class RejectValue(Packet):
    TYPE: ClassVar[int] = 9
    genesis: bytes
    proposal: ProposalId
    digest: bytes
    refusal: Refusal
    facts: tuple[Fact, ...]


ROWS = (
    row(
        ProposeValue,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("route", Many(U32, DECIDERS_MAX)),
        ("facts", FACTS),
        ("highest", Maybe(LOG_VALUE)),
        ("value", Maybe(LOG_VALUE)),
        ("takeover", BOOL),
    ),
    row(
        AcceptValue,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("digest", DIGEST),
        ("facts", FACTS),
        ("highest", Maybe(LOG_VALUE)),
    ),
    row(
        RejectValue,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("digest", DIGEST),
        ("refusal", REFUSAL),
        ("facts", FACTS),
    ),
)
