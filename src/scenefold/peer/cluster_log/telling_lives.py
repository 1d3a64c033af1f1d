"""How lives go from those who voted to those who vote from then on (specs/26-modes.md, Voters come and go). Pure.

Two majorities of different voters need not meet. So a voter grants nothing until it has heard from a majority of those before, each of which
had decided by then that it is none of them any more, or is one anew, and so grants nothing as one of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from scenefold.peer.cluster_log import numbered_lives
from scenefold.peer.cluster_log.lease_grants import Held, KnownLog, is_ready
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.peer.cluster_log.voter_rules import Council
from scenefold.wire import Member


@dataclass(frozen=True, slots=True)
class Gathering:
    """In memory. `council_at`: the change that it is about; `heard`: those of before whose lives are all here."""

    council_at: int = 0
    heard: frozenset[Member] = frozenset()


def gather(gathering: Gathering, held: Held, log: KnownLog, me: Member) -> tuple[Gathering, Held]:
    """What is to be heard now, and what is held by that, which is to be made durable if it has changed. To be called at the start and whenever
    the log goes on."""
    if not log.councils or me not in log.councils[-1].voters or is_ready(held, log, me):
        return Gathering(), held
    *earlier, newest = log.councils
    if not earlier:
        # Until then this node granted alone, and what it holds is all that there is.
        return Gathering(), replace(held, ready_at=newest.position)
    if gathering.council_at != newest.position:
        gathering = Gathering(newest.position)
    if me in earlier[-1].voters and held.ready_at >= earlier[-1].position:
        gathering = replace(gathering, heard=gathering.heard | {me})
    return _counted(gathering, held, earlier[-1])


def to_ask(gathering: Gathering, log: KnownLog) -> tuple[Member, ...]:
    """Of whom lives are still to be heard."""
    before = _before(gathering.council_at, log)
    if before is None:
        return ()
    return tuple(one.member for one in before.voters.everyone if one.member not in gathering.heard)


def may_tell(council_at: int, held: Held, log: KnownLog, me: Member) -> bool:
    """Whether this node, asked by a voter of the council that began there, tells its lives: it knows of that council, so that it grants no
    more as one of those before; and as one of these it was ready."""
    before = _before(council_at, log)
    return before is not None and me in before.voters and held.ready_at >= before.position


def told(
    gathering: Gathering, held: Held, teller: Member, council_at: int, lives: Mapping[bytes, Life], log: KnownLog, *, is_all: bool
) -> tuple[Gathering, Held]:
    """After a page of lives that somebody of before tells; what is held then is to be made durable first. `is_all`: the last page."""
    before = _before(gathering.council_at, log)
    if before is None or council_at != gathering.council_at or teller not in before.voters:
        return gathering, held
    held = replace(held, lives=numbered_lives.merged(held.lives, lives))
    if is_all:
        gathering = replace(gathering, heard=gathering.heard | {teller})
    return _counted(gathering, held, before)


def may_vote(*, changes_voters: bool, held: Held, log: KnownLog, me: Member) -> bool:
    """Who is not ready does not vote for another change: so those who can tell are the majority that voted."""
    return not changes_voters or is_ready(held, log, me)


def _counted(gathering: Gathering, held: Held, before: Council) -> tuple[Gathering, Held]:
    if len(gathering.heard) < before.voters.majority:
        return gathering, held
    return Gathering(), replace(held, ready_at=gathering.council_at)


def _before(council_at: int, log: KnownLog) -> Council | None:
    """Who voted before the change at this position; None if there was none, or no voters before."""
    for earlier, later in pairwise(log.councils):
        if later.position == council_at:
            return earlier
    return None
