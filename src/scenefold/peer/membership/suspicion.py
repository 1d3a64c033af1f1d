"""From "it is silent" to "it is to be removed", peer by peer (specs/11-peers.md, Suspicion). Pure.

A peer is suspected for a cause: its chance of being alive fell below 1/20, a request to it failed, or the voter has
not been asked for its owner lease. Suspicion alone changes nothing; it is probed, directly first, then through other nodes.
Who is heard by anybody is cleared. Who is heard by nobody is *silent*, is asked again ever more slowly, and once it has
given no proof of life for long enough, its removal is proposed. Any news of it end the matter at every step.

    alive ──cause──▶ suspected ──its turn──▶ probing ──nobody hears it──▶ silent ──long enough──▶ proposed
      ▲                  ▲                    │    ▲                        │  ▲                     │
      │                  └──nobody to ask─────┤    └────────its turn────────┘  └──────refused────────┘
      └──(a while)── cleared ◀──it is heard───┘                    from everywhere: news ──▶ alive

Nothing here knows a clock or dice: the time, and a number for how long to hold back, are given.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto

from scenefold.base.ids import NodeId, address_of
from scenefold.peer.membership.removal import silence_needed_s
from scenefold.wire import Member

PROBES_MAX = 8
"""Peers that are being probed at a time: half of a thousand may be cut off at once, and the network is no better for it."""
AGAIN_S = (2.0, 4.0, 8.0, 15.0)
"""Pauses between the rounds of probing of a silent peer; the last one from then on."""
CLEARED_S = 15.0
"""Who was heard is not suspected again for so long, though the cause may last: one-way cuts do."""
REFUSED_AGAIN_S = 15.0
"""Until a removal is proposed again that the voter did not want, or that did not reach it."""
PROPOSE_LATER_S = 5.0
"""The voter hears best and proposes first; the others come in only if it has not, and count from their own first round
of probing: what they have heard by gossip may be a long time ago."""
PROPOSE_SPREAD_S = 0.1
"""For each member: the others hold back by chance besides, so that not all propose at once."""
SILENT_ROUNDS_MIN = 3
"""One round can be lost to bad luck, when the only one who could tell has just been restarted."""
FRESH_S = 40.0
"""A proposal rests on a round of probing that is not older."""


class Cause(Enum):
    """Why a peer is suspected."""

    UNLIKELY = "its chance of being alive fell below 1/20"
    REQUEST_FAILED = "a request to it failed"
    LEASE_LAPSED = "its owner lease lapsed"


class State(Enum):
    SUSPECTED = auto()
    PROBING = auto()
    SILENT = auto()
    PROPOSED = auto()
    CLEARED = auto()


class Event(Enum):
    TURN = auto()
    NOBODY_HEARS = auto()
    NOBODY_TO_ASK = auto()
    HEARD = auto()
    LONG_ENOUGH = auto()
    REFUSED = auto()


TRANSITIONS = {
    (State.SUSPECTED, Event.TURN): State.PROBING,
    (State.SILENT, Event.TURN): State.PROBING,
    (State.PROBING, Event.HEARD): State.CLEARED,
    (State.PROBING, Event.NOBODY_TO_ASK): State.SUSPECTED,
    (State.PROBING, Event.NOBODY_HEARS): State.SILENT,
    (State.SILENT, Event.LONG_ENOUGH): State.PROPOSED,
    (State.PROPOSED, Event.REFUSED): State.SILENT,
}
"""What happens otherwise changes nothing. Alive is who is not in the table; news take a peer out of it in every state."""


@dataclass(slots=True, eq=False)
class Suspect:
    """One suspected incarnation. `signs`: of life, counted when it was suspected; more of them are news."""

    member: Member
    cause: Cause
    since: float
    signs: int
    state: State = State.SUSPECTED
    next_at: float = 0.0
    """When it is probed again, proposed again, or when its being cleared ends."""
    rounds: int = 0
    silent_rounds: int = 0
    """Those in which nobody heard it."""
    silent_at: float | None = None
    """End of the last round of probing in which nobody heard it."""
    propose_from: float = 0.0
    """Not before that: who proposes holds back, and lets the voter rest after a refusal."""
    helpers: tuple[NodeId, ...] = ()
    """Who was asked to probe it in the last round."""
    asked: set[NodeId] = field(default_factory=set)
    """Who was asked in any round: others have their turn first, so that in a small cluster everybody is asked."""

    @property
    def node(self) -> NodeId:
        return self.member.node

    def reason(self, me: NodeId, silence_s: float, now: datetime.datetime) -> str:
        """For people who read the log, which has no clock: why it is to be removed, and when, by our clock."""
        asked = ", ".join(map(address_of, (me, *self.helpers)))
        silence = f"not heard for {silence_s:.0f} s until {now:%Y-%m-%d %H:%M} UTC"
        return f"{silence} ({self.cause.value}); no answer in {self.rounds} rounds of probing, the last by {asked}"


class Suspicion:
    """The suspects of one node. `remove_after_s`: silence without any proof of life that a removal takes."""

    def __init__(self, remove_after_s: float) -> None:
        self._remove_after_s = remove_after_s
        self._suspects: dict[NodeId, Suspect] = {}

    def state(self, node: NodeId) -> State | None:
        """None: alive, as far as is known."""
        suspect = self._suspects.get(node)
        return None if suspect is None else suspect.state

    @property
    def suspects(self) -> list[Suspect]:
        """Those who are not cleared, in the order in which they were suspected."""
        return [suspect for suspect in self._suspects.values() if suspect.state is not State.CLEARED]

    def suspect(self, member: Member, cause: Cause, signs: int, now: float) -> bool:
        """There is a cause to suspect an incarnation; True if it was not suspected, nor cleared a short while ago."""
        known = self._suspects.get(member.node)
        if known is not None and known.member == member:
            return False
        self._suspects[member.node] = Suspect(member, cause, now, signs, next_at=now)
        return True

    def review(self, signs_of: Callable[[Member], int | None], now: float) -> None:
        """Forget those of whom there are news (more signs of life), who are members no more (None), or were cleared long ago."""
        for suspect in list(self._suspects.values()):
            signs = signs_of(suspect.member)
            if suspect.state is State.CLEARED:
                is_over = signs is None or now >= suspect.next_at
            else:
                is_over = signs is None or signs > suspect.signs
            if is_over:
                del self._suspects[suspect.node]

    def turn(self, now: float) -> list[Suspect]:
        """Whose turn it is to be probed, the longest waiting first, as many as may be at a time. They are PROBING now."""
        probing = sum(suspect.state is State.PROBING for suspect in self._suspects.values())
        waiting = [s for s in self._suspects.values() if (s.state, Event.TURN) in TRANSITIONS and now >= s.next_at]
        waiting.sort(key=lambda suspect: (suspect.next_at, suspect.node))
        return [suspect for suspect in waiting[: max(0, PROBES_MAX - probing)] if self._step(suspect, Event.TURN)]

    def heard(self, suspect: Suspect, now: float) -> None:
        """It answered, to us or to a node that we asked."""
        if self._step(suspect, Event.HEARD):
            suspect.next_at = now + CLEARED_S

    def nobody_to_ask(self, suspect: Suspect, now: float) -> None:
        """It did not answer us, and nobody answered whom we asked to probe it: that may be our own fault."""
        if self._step(suspect, Event.NOBODY_TO_ASK):
            self._end_round(suspect, now)

    def nobody_hears(self, suspect: Suspect, helpers: tuple[NodeId, ...], hold_back_s: float, now: float) -> None:
        """It answered neither us nor those `helpers` who could be asked, if there are any.

        `hold_back_s`: at the first such round, how long we leave it to others to propose the removal.
        """
        if self._step(suspect, Event.NOBODY_HEARS):
            if suspect.silent_at is None:
                suspect.propose_from = now + hold_back_s
            self._end_round(suspect, now)
            suspect.silent_rounds += 1
            suspect.silent_at = now
            suspect.helpers = helpers
            suspect.asked |= set(helpers)

    def to_propose(self, proof_at: Callable[[Suspect], float], now: float) -> list[Suspect]:
        """Whose removal is to be proposed now. They are PROPOSED."""
        return [suspect for suspect in list(self._suspects.values()) if self._is_to_go(suspect, proof_at, now)]

    def refused(self, suspect: Suspect, now: float) -> None:
        """The removal was refused, or could not be proposed."""
        if self._step(suspect, Event.REFUSED):
            suspect.next_at = now
            suspect.propose_from = now + REFUSED_AGAIN_S

    def _is_to_go(self, suspect: Suspect, proof_at: Callable[[Suspect], float], now: float) -> bool:
        if suspect.state is not State.SILENT or now < suspect.propose_from:
            return False
        if suspect.silent_rounds < SILENT_ROUNDS_MIN or suspect.silent_at is None or now - suspect.silent_at > FRESH_S:
            return False
        needed_s = silence_needed_s(suspect.member, self._remove_after_s)
        return now - proof_at(suspect) >= needed_s and self._step(suspect, Event.LONG_ENOUGH)

    def _end_round(self, suspect: Suspect, now: float) -> None:
        suspect.rounds += 1
        suspect.next_at = now + AGAIN_S[min(suspect.rounds, len(AGAIN_S)) - 1]

    def _step(self, suspect: Suspect, event: Event) -> bool:
        """Make a transition, if this suspect still is one, and there is one."""
        following = TRANSITIONS.get((suspect.state, event))
        if following is None or self._suspects.get(suspect.node) is not suspect:
            return False
        suspect.state = following
        return True
