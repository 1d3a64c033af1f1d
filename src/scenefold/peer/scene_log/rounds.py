"""How many questions about scenes anybody may have this node put to the others (specs/03-wire.md, Limits). Pure.

Nobody meters what members ask each other, so a small packet that sets off a question to every node would be a lever.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.world.buckets import Buckets

ASKER_QUESTIONS_BURST = 256
"""Of one peer: two rounds through a cluster of a hundred nodes, a hundred through one of three."""
ASKER_QUESTIONS_PER_S = 16.0
QUESTIONS_BURST = 1_024
"""Of all together."""
QUESTIONS_PER_S = 64.0
"""Were all nodes made to ask at once, each would be asked this often, however many there are."""
BEYOND_ORIGIN = 3
"""So many others are asked for what the node that decides the scene does not know: it may have lost its disk."""
ASKED_OF_KNOWN = 1 + BEYOND_ORIGIN
"""Most rounds for news of a scene that is known go no further, so they begin with as many."""


class Rounds:
    """Those that are begun for others. What this node wants to know for itself is not counted."""

    def __init__(self) -> None:
        self._of_asker = Buckets(ASKER_QUESTIONS_BURST, ASKER_QUESTIONS_PER_S)
        self._of_all = Buckets(QUESTIONS_BURST, QUESTIONS_PER_S)

    def begin(self, asker: str, members: int, now: float, *, is_known: bool = False) -> bool:
        """Whether so many members may be asked for this peer now; the first of them, for news of a scene that is known.

        In the largest clusters a round takes all that one peer may at once.
        """
        return self._take(asker, min(members, ASKED_OF_KNOWN if is_known else ASKER_QUESTIONS_BURST), now)

    def go_on(self, askers: Sequence[str], members: int, now: float) -> bool:
        """Whether the others may be asked, too, for one of these peers who wait for news of a scene that is known."""
        rest = max(0, min(members, ASKER_QUESTIONS_BURST) - ASKED_OF_KNOWN)
        if "" in askers:
            return True
        # If there are none left of all together, one of them has taken his own in vain, but not each.
        return any(self._of_asker.take(asker, now, rest) for asker in askers) and self._of_all.take("", now, rest)

    def _take(self, asker: str, count: int, now: float) -> bool:
        # The peer's own first: who has none left takes nothing from the others.
        return not asker or (self._of_asker.take(asker, now, count) and self._of_all.take("", now, count))
