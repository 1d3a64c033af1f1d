"""What a writer may say of something that an earlier try may have done (specs/18-data.md, Writes).

A try whose answer was lost, or was 16, may have been carried out. Whatever refusal comes later, it was that of a later try, and
speaks of things as they are by then, or does not look at them at all. So as long as there is doubt, no refusal is told as one: it
becomes Unreachable, which says that nobody knows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason


class Doubt:
    """What of one call may have happened although no answer says so, by number."""

    def __init__(self, what: str, where: Callable[[int], str], remedy: str) -> None:
        """`what`: is asked for, as in "a write"; `where`: which one a number means. Both for the error."""
        self._what = what
        self._where = where
        self._remedy = remedy
        self._open: dict[int, None] = {}

    def __contains__(self, number: int) -> bool:
        return number in self._open

    def note(self, numbers: Iterable[int]) -> None:
        """These may have happened."""
        self._open.update(dict.fromkeys(numbers))

    def settle(self, number: int) -> None:
        """An answer says that it happened; or whoever wanted it looks himself."""
        self._open.pop(number, None)

    @contextmanager
    def trying(self, numbers: Iterable[int]) -> Iterator[None]:
        """Around one try, with its answer: how it ends says what it leaves open. Who has lost its lease meanwhile says 16."""
        try:
            yield
        except Refused as refusal:
            if refusal.reason == RejectReason.NOT_READY:
                self.note(numbers)
            raise
        except (Unreachable, PeerFault):
            self.note(numbers)
            raise

    @contextmanager
    def no_refusal(self) -> Iterator[None]:
        """A refusal that comes while something is in doubt leaves here as Unreachable."""
        try:
            yield
        except Refused as refusal:
            if not self._open:
                raise
            what = f"the answer to {self._what} was lost, and it may have happened; a later try: {refusal.what}"
            raise Unreachable(what, where=self._where(next(iter(self._open))), remedy=self._remedy) from refusal
