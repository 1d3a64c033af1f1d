"""A voter's answer to who asks for an owner lease, as one of several (specs/26-modes.md, Owner leases; Lives, with a majority). Pure.

A grant says: I have nothing accepted behind what I have decided, nobody who decides has changed since what the asker knows, and this is the
newest life of this incarnation that I know of. The first two make a lease end soon enough after a removal; the third tells a copy of a disk
from the node.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from types import MappingProxyType
from typing import Protocol, TypeAlias

from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.numbered_lives import NOBODYS, Life, takes
from scenefold.peer.cluster_log.voter_rules import Council
from scenefold.wire import Member

KEPT_S = 1.0
"""So long a question waits for what is accepted to be decided: a log in which much is decided starves nobody."""


class KnownLog(Protocol):
    """The cluster's log as a node knows it."""

    @property
    def position(self) -> int: ...

    @property
    def councils(self) -> tuple[Council, ...]:
        """As they stand in its VoterList."""

    def bars(self, member: Member) -> RejectReason | None:
        """12: no member under this incarnation; 18: that was removed; None: it is one."""


@dataclass(frozen=True, slots=True)
class Held:
    """What a voter keeps durably for leases. `lives`: of each incarnation the one that it granted last, or was told of."""

    lives: Mapping[bytes, Life] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    ready_at: int = 0
    """The newest council, by the position at which it began, as of which the lives of those before are among these."""


@dataclass(frozen=True, slots=True)
class Question:
    """By the asker; its signature was verified."""

    member: Member
    have: int
    life: Life
    nonce: int


class Verdict(Enum):
    GRANT = auto()
    NOTE = auto()
    """The life is made durable first, and then it is judged anew."""
    WAIT = auto()
    """For KEPT_S, until what is accepted is decided; then judged anew."""
    NOT_NOW = auto()
    """Neither granted nor refused: the log or the voter is not where it would have to be."""


Answer: TypeAlias = Verdict | RejectReason


def answer(question: Question, held: Held, log: KnownLog, me: Member, *, is_awake: bool, has_accepted: bool) -> Answer:
    """`is_awake`: this voter has asked the others since it started (awakening.py); `has_accepted`: it has voted behind what it has decided.

    A refusal counts wherever the log stands: who knows of a later life need not know what was decided since.
    """
    barred = log.bars(question.member)
    if barred is not None:
        return barred
    if question.life.mark == NOBODYS:
        return RejectReason.ILL_FORMED
    known = held.lives.get(question.member.incarnation)
    if not takes(known, question.life):
        return RejectReason.WRONG_INCARNATION
    if not is_awake or not is_ready(held, log, me) or not _is_at(question.have, log):
        return Verdict.NOT_NOW
    if has_accepted:
        return Verdict.WAIT
    return Verdict.GRANT if known == question.life else Verdict.NOTE


def noted(held: Held, question: Question) -> Held:
    """With the life that is asked under, to be made durable."""
    return Held({**held.lives, question.member.incarnation: question.life}, held.ready_at)


def is_ready(held: Held, log: KnownLog, me: Member) -> bool:
    """Whether this node is a voter, and knows what those before granted."""
    return bool(log.councils) and me in log.councils[-1].voters and held.ready_at == log.councils[-1].position


def _is_at(have: int, log: KnownLog) -> bool:
    """Whether the asker knows who decides now, and this voter what the asker knows."""
    return log.councils[-1].position <= have <= log.position
