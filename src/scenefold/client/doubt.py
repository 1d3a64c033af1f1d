"""What a writer may say of something that an earlier try may have done (specs/18-data.md, Writes).

A try whose answer was lost or not waited for, or was 16, may have been carried out. Whatever refusal comes later, it was that of a later try, and
speaks of things as they are by then, or does not look at them at all. So as long as there is doubt, no refusal is told as one: it
becomes Unreachable, which says that nobody knows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import trio

from scenefold.base.errors import NotReached, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.reasons import RejectReason


class Doubt:
    """What of one call may have happened although no answer says so, by number."""

    def __init__(
        self,
        what: str,
        where: Callable[[int], str],
        remedy: str | Callable[[int], str],
        *,
        is_open_after: Callable[[RejectReason], bool] | None = None,
    ) -> None:
        """`what`: is asked for, as in "a write"; `where`: which one a number means; `remedy`: how to find out. All for the error.

        `is_open_after`: whether a try that ended with a Fault for this reason may have been carried out. By default 16 alone:
        who has lost its lease meanwhile says so.
        """
        self._what = what
        self._where = where
        self._remedy = remedy
        self._is_open_after = is_open_after or (lambda reason: reason == RejectReason.NOT_READY)
        self._open: dict[int, str] = {}
        """Each with how it came into doubt, if its answer was not lost."""

    def __contains__(self, number: int) -> bool:
        return number in self._open

    @property
    def latest(self) -> int | None:
        """The highest number that is in doubt."""
        return max(self._open, default=None)

    def note(self, numbers: Iterable[int], since: str = "") -> None:
        """These may have happened, `since` something is as it is; by default: since an answer was lost."""
        for number in numbers:
            self._open.setdefault(number, since)

    def settle(self, number: int) -> None:
        """An answer says that it happened; or whoever wanted it looks himself."""
        self._open.pop(number, None)

    def settle_all(self) -> None:
        """Of each of them it is known by now what became of it."""
        self._open.clear()

    @contextmanager
    def trying(self, numbers: Iterable[int]) -> Iterator[None]:
        """Around one try, with its answer: how it ends says what it leaves open."""
        try:
            yield
        except NotReached:
            # Nothing was sent.
            raise
        except Refused as refusal:
            if self._is_open_after(refusal.reason):
                self.note(numbers)
            raise
        except (Unreachable, PeerFault, trio.Cancelled):
            self.note(numbers)
            raise

    @contextmanager
    def no_refusal(self, *, nor_silence: bool = False) -> Iterator[None]:
        """What else goes wrong while something is in doubt leaves here as Unreachable, in words; `nor_silence`: Unreachable, too."""
        try:
            yield
        except ScenefoldError as error:
            if not self._open or (isinstance(error, Unreachable) and not nor_silence):
                raise
            number, since = next(iter(self._open.items()))
            lost = f"the answer to {self._what} was lost, and it may have happened"
            what = f"{f'{self._what} may have happened: {since}' if since else lost}; a later try: {error.what}"
            remedy = self._remedy if isinstance(self._remedy, str) else self._remedy(number)
            raise self._unknown(number, what, where=self._where(number), remedy=remedy) from error

    def _unknown(self, number: int, what: str, *, where: str, remedy: str) -> Unreachable:
        """What is raised in place of a refusal."""
        return Unreachable(what, where=where, remedy=remedy)
