"""What one node says that it has of an arc, page by page (specs/20-copies.md, Recovery). Pure.

A registered node may lie. It cannot bring anything forged, since all that comes is verified; it could only name things without end, or
that it does not have. So a walk must get on: records ascend, and each page goes on behind the one before. And what is named must come:
who does not deliver is asked again for a while, then that version counts as not held, and who names too many such is heard no further.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from scenefold.base.errors import PeerFault
from scenefold.base.ids import address_of
from scenefold.base.limits import CUSTODY_KEPT_MAX
from scenefold.base.location import Arc, Location
from scenefold.crypto import RecordPlace, wanted_place
from scenefold.peer.copies.entries import Entry, clipped
from scenefold.peer.copies.telling import entry_of
from scenefold.store import Spot
from scenefold.wire import HeldListed, HeldRecord, Member

ENTRIES_MAX = 2 * CUSTODY_KEPT_MAX
"""Custody entries of one node in one gap. It keeps half as many, and each promise may cut some in two; with endless made-up ones no gap
could be recovered any more."""
NONSENSE_MAX = 8
"""Answers that cannot be, before a node is heard no further: one may come of a restart in the middle."""
PATIENCE_S = 60.0
"""Spent in all on what one node names and does not deliver. What then does not come soon counts as not held."""
GIVEN_UP_MAX = 4_096
"""Versions that one node has named and not delivered: it is heard no further. A disk that has rotted so far has little else to say."""
PAUSE_S_MIN = 0.25
PAUSE_S_MAX = 8.0
TRIES_MAX = 6
"""For the records of one page: some 8 s with the pauses between."""
TRIES_MIN = 2
"""However little patience is left: an answer that was too large to come in time is asked for in smaller parts."""
DENIED_TRIES_MAX = 2
"""For what who named it says that he has not: it has rotted, unless it was replaced just then."""

_Key = tuple[int, int, Location, Location, bytes]


def spot_of_held(held: HeldRecord) -> Spot:
    return Spot(RecordPlace(held.scene, held.space, held.location), held.object)


class Walk:
    """Begins at the first page; `after` is where the next one begins. `entries`: what the node has told of custody so far."""

    def __init__(self, teller: Member, arc: Arc, number: int) -> None:
        """`number`: below it the node has promised to take nothing, so nothing that it has is numbered higher."""
        self._teller = teller
        self._arc = arc
        self._number = number
        self._last: _Key | None = None
        self.after = b""
        self.entries: tuple[Entry, ...] = ()
        self.is_over = False

    def check(self, page: HeldListed) -> Sequence[HeldRecord]:
        """What the page names. PeerFault if no honest node says so, or it does not get on."""
        assert not self.is_over
        keys = [_key_of(record) for record in page.records]
        if any(key[2] not in self._arc for key in keys):
            raise self._nonsense("names records outside of what it was asked for")
        before = [] if self._last is None else [self._last]
        if any(one >= other for one, other in pairwise([*before, *keys])):
            raise self._nonsense("names records that do not ascend")
        if page.next is not None and (page.next <= self.after or not (page.records or page.entries)):
            raise self._nonsense("goes on and gets nowhere")
        self._check_entries(page)
        return page.records

    def move_on(self, page: HeldListed) -> None:
        """All that a checked page names is here, or counts as not held."""
        self.entries = self._with_entries(page)
        if page.records:
            self._last = _key_of(page.records[-1])
        if page.next is None:
            self.is_over = True
        else:
            self.after = page.next

    def _with_entries(self, page: HeldListed) -> tuple[Entry, ...]:
        return (*self.entries, *clipped(map(entry_of, page.entries), self._arc))

    def _check_entries(self, page: HeldListed) -> None:
        entries = self._with_entries(page)
        if len(entries) > ENTRIES_MAX:
            raise self._nonsense(f"names more than {ENTRIES_MAX} custody entries")
        ordered = sorted(entries, key=lambda entry: (entry.layout, entry.arc.first))
        if any(one.layout == other.layout and one.arc.intersection(other.arc) is not None for one, other in pairwise(ordered)):
            raise self._nonsense("names two custody entries of one place")
        for entry in entries:
            if entry.number >= self._number:
                raise self._nonsense("names custody of a number that it promised not to take")
            if entry.whole and self._teller not in entry.members[1:]:
                raise self._nonsense("answers for a configuration that it is no holder of")

    def _nonsense(self, what: str) -> PeerFault:
        return PeerFault(f"{address_of(self._teller.node)} {what}")


class Patience:
    """How far one node is still believed. `given_up`: versions that it named and did not deliver."""

    def __init__(self) -> None:
        self._left_s = PATIENCE_S
        self._tries = 0
        self._nonsense = 0
        self.given_up = 0

    @property
    def is_over(self) -> bool:
        """Whether the node is heard no further, and what it has said so far is all."""
        return self.given_up > GIVEN_UP_MAX or self._nonsense > NONSENSE_MAX

    def delivered(self) -> None:
        """All of a page is here."""
        self._tries = 0

    def note_nonsense(self) -> None:
        self._nonsense += 1

    def failed(self, count: int, took_s: float, *, are_denied: bool = False) -> float | None:
        """So many versions of a page did not come. Seconds until it is asked again; None: they count as not held.

        `took_s`: spent on the node alone. `are_denied`: of all of them the node itself says that it has them not.
        """
        self._tries += 1
        pause_s = min(PAUSE_S_MAX, PAUSE_S_MIN * 2.0 ** (self._tries - 1))
        self._left_s -= took_s + pause_s
        tries_max = DENIED_TRIES_MAX if are_denied else TRIES_MAX
        tries_min = 1 if are_denied else TRIES_MIN
        if self._tries < (tries_max if self._left_s > 0 else tries_min):
            return pause_s
        self._tries = 0
        self.given_up += count
        return None


def _key_of(held: HeldRecord) -> _Key:
    home = wanted_place(held.object) if held.object else held.location
    return held.scene, held.space, home, held.location, held.object
