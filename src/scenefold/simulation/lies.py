"""Every lie that a simulated node tells: about what, when, and in which words (specs/17-simulation.md, Lies). Pure.

While a record has one copy, nobody can tell that its owner withholds it, or gives an older version. So that breaks no law, and
is reported. The excuse is as narrow as the lie: one answer of this node to this asker, about this place, in these very words,
between question and answer; or this version, in this handover. Nothing excuses that altered or made-up bytes are believed.
"""

from __future__ import annotations

import hashlib
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from scenefold.simulation.history import Digest, Place
from scenefold.wire import RecordBytes

LIES_KEPT = 256
"""Of each place, the last ones: an answer is under way for seconds."""


STRAY = b"a stray"
"""Stands for the handover where a record is brought home."""
TABLE = Place(0, 0, b"")
"""Stands for the place in a lie about who is where."""


def of_header(scene: int) -> Place:
    """Stands for the place in a lie about a scene's header."""
    return Place(scene, 0, b"")


class Manner(Enum):
    """What a lie is; the value is its name in reports."""

    NONSENSE = "nonsense"
    """Altered, made up, or about something else. Whoever hears it must notice."""
    WITHHELD = "withheld"
    """A record is said to be not there, or damaged, or is left out of a list."""
    OLDER = "rolled back"
    """An older version is given."""
    DROPPED = "acknowledged and dropped"
    MISJUDGED = "misjudged"
    """A write is judged by something else than what it expects: refused though it was stored, or stored against it."""
    HELD = "told with the help of a holder"
    """So many holders have spoken that it counts, and not without one that has lied about its copy."""
    LOST = "lost in a handover"
    """A version is not given, not taken, or given as an older one, while a piece of the line changes hands."""


class Way(NamedTuple):
    """Who answers, and whom: names as in certificates."""

    by: str
    to: str

    def brings(self, lie: Way) -> bool:
        """Whether what was said by one may come this way: from the liar itself, or from who has asked it for somebody."""
        return self == lie or self.by == lie.to


def whole(record: RecordBytes) -> Digest:
    """The digest of all bytes of an answer: nonsense may show the header of a true record."""
    return hashlib.sha256(b"".join((record.signature, record.header, record.ciphertext))).digest()


@dataclass(frozen=True, slots=True)
class Lie:
    """Told by a slot about a place. `digest`: of the version that an answer shows, None for nothing; of the write that is judged; of
    nonsense, of all its bytes."""

    moment: int
    slot: int
    place: Place
    manner: Manner
    digest: Digest | None
    way: Way


class Lies:
    """All lies of a run. `moment` numbers what happens; `tell` is for the story: who, where, what."""

    def __init__(self, moment: Callable[[], int], tell: Callable[[str, Place, str], None]) -> None:
        self.told = Counter[str]()
        """How many, by manner."""
        self.reported = Counter[str]()
        """How many had an effect that nobody could prevent, by manner."""
        self.intruded: set[tuple[int, int, int]] = set()
        """Nodes that may have taken custody, from whom that had no right to give it, and under which number: nobody is there to end that."""
        self._moment = moment
        self._tell = tell
        self._by_place: dict[Place, deque[Lie]] = {}
        self._lost: dict[tuple[bytes, Place, Digest], int] = {}

    def tells(self, slot: int, way: Way, place: Place, manner: Manner, digest: Digest | None) -> None:
        """A node lies in an answer, just now. Nonsense that shows no record has b"" for a digest."""
        self.told[manner.value] += 1
        self._by_place.setdefault(place, deque(maxlen=LIES_KEPT)).append(Lie(self._moment(), slot, place, manner, digest, way))
        self._tell(f"n{slot}", place, f"lies: {manner.value} {_name(digest)}")

    def loses(self, slot: int, handover: bytes, place: Place, digest: Digest) -> None:
        """A node lies about a version in a handover."""
        self.told[Manner.LOST.value] += 1
        self._lost[handover, place, digest] = slot
        self._tell(f"n{slot}", place, f"lies in a handover about {_name(digest)}")

    def of_read(self, place: Place, digest: Digest | None, way: Way, since: int) -> Manner | None:
        """What was said of a place since some moment in just these words; None if that was no lie. It excuses one answer."""
        return self._used(place, digest, way, since, (Manner.WITHHELD, Manner.OLDER))

    def of_write(self, place: Place, digest: Digest, way: Way, since: int) -> Manner | None:
        """Likewise of a write."""
        return self._used(place, digest, way, since, (Manner.DROPPED, Manner.MISJUDGED))

    def is_this_nonsense(self, place: Place, record: RecordBytes, way: Way, since: int) -> bool:
        """Likewise, whether just these bytes were shown."""
        return self._used(place, whole(record), way, since, (Manner.NONSENSE,)) is not None

    def is_nonsense(self, place: Place, way: Way, since: int) -> bool:
        """Whether anything about a place was nonsense that has come this way since then."""
        told = (lie for lie in self._by_place.get(place, ()) if lie.moment > since and lie.manner is Manner.NONSENSE)
        return any(way.brings(lie.way) for lie in told)

    def is_lost(self, handover: bytes, place: Place, digest: Digest) -> bool:
        """Whether this version was lied about in this handover."""
        return (handover, place, digest) in self._lost

    def report(self, place: Place, manner: Manner, what: str) -> None:
        """A lie had an effect that the judge excuses: it is counted and told, never silent."""
        self.reported[manner.value] += 1
        self._tell("", place, f"REPORTED {manner.value}: {what}")

    def _used(self, place: Place, digest: Digest | None, way: Way, since: int, manners: tuple[Manner, ...]) -> Manner | None:
        told = self._by_place.get(place, deque[Lie]())
        for lie in told:
            if lie.moment > since and lie.digest == digest and lie.manner in manners and way.brings(lie.way):
                told.remove(lie)
                return lie.manner
        return None


def _name(digest: Digest | None) -> str:
    return "nothing" if digest is None else digest.hex()[:6]
