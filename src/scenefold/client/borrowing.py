"""What a client has borrowed of the leases of a scene's participants: when it asks, until when it may sign, when it gives back. Pure.

Of one scene and one key (specs/26-modes.md, Lent leases). The time is an argument, that of this client's own clock, which runs while the
machine sleeps. Nothing of it is ever written down: who starts has borrowed nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from scenefold.base.ids import NodeId

LENT_S_MAX = 12.0
"""Nobody lends for longer: a participant's own lease, from the moment at which it asked for that."""
RENEW_S = 4.0
"""Between two questions: a third of it, so that one lost answer costs nothing."""
RETRY_S = 0.5
IDLE_S = 3.0
"""What is borrowed is given back so long behind the last write: who writes one record after the other asks once."""
REST_S = 5.0
"""Who is told that it is asked back asks for nothing so long: so long the others are lent nothing either, and a change of mode gets through."""


class Borrowed(NamedTuple):
    """`position`: of the scene's log. `until`: before it edits may be signed. `asked_at`: when this client asked for it."""

    position: int
    until: float
    asked_at: float


@dataclass(frozen=True, slots=True)
class Loan:
    """`lenders`: who may hold for live what it lent, by its answer or because none came."""

    held: Borrowed | None = None
    lenders: frozenset[NodeId] = frozenset()
    writes: int = 0
    """Calls under way that may have signed something."""
    wrote_at: float = -math.inf
    """When the last of them ended."""
    wanted_at: float = -math.inf
    """When one was last asked for because there was none."""
    tried_at: float = -math.inf
    is_asked_back: bool = False
    rests_until: float = -math.inf

    # ----------------------------------------------------------------------------------------------------- signing

    def may_sign(self, floor: int, now: float) -> bool:
        """Whether an edit may be signed at this moment. `floor`: a position that the scene's newest change of mode does not lie above."""
        return self.held is not None and now < self.held.until and self.held.position >= floor

    def may_begin(self, floor: int, now: float) -> bool:
        """Likewise, by who has nothing under way: not by what is asked back."""
        return self.may_sign(floor, now) and not self.is_asked_back

    def begins(self) -> Loan:
        return replace(self, writes=self.writes + 1)

    def ends(self, now: float) -> Loan:
        """All that one of them signed is settled, or given up."""
        assert self.writes > 0
        return replace(self, writes=self.writes - 1, wrote_at=now)

    # ------------------------------------------------------------------------------------------------------ asking

    def may_ask(self, now: float) -> bool:
        return now >= self.rests_until

    def asks(self, lender: NodeId, now: float) -> Loan:
        """A question leaves: from now on this participant may hold something for live, whether its answer comes or not."""
        wanted_at = self.wanted_at if self.held is not None and now < self.held.until else now
        return replace(self, lenders=self.lenders | {lender}, tried_at=now, wanted_at=wanted_at)

    def lent(self, position: int, left_s: float, asked_at: float, now: float, *, is_asked_back: bool) -> Loan:
        """An answer came. It counts from the moment of asking, which may be so long ago that nothing is left of it."""
        new = Borrowed(position, asked_at + min(left_s, LENT_S_MAX), asked_at)
        # Each of two that are held is good; of those that allow the same the longer one.
        held = new if self.held is None or now >= self.held.until else max(self.held, new)
        rests_until = now + REST_S if is_asked_back else self.rests_until
        return replace(self, held=held, is_asked_back=is_asked_back, rests_until=rests_until)

    # ------------------------------------------------------------------------------------------------------ giving

    def given_back(self) -> Loan:
        """To be called before the lenders are told, and while no question is open: from now on nothing is signed."""
        return replace(self, held=None, lenders=frozenset(), is_asked_back=False)

    def renews_at(self, now: float) -> float:
        """When to ask again, as long as it is held."""
        if self.held is None or now >= self.held.until or self.is_asked_back:
            return math.inf
        return max(self.held.asked_at + RENEW_S, self.tried_at + RETRY_S)

    @property
    def returns_at(self) -> float:
        """When to give it back."""
        if self.writes or not self.lenders:
            return math.inf
        return -math.inf if self.is_asked_back else max(self.wrote_at, self.wanted_at) + IDLE_S
