"""Histories of what clients ask and are answered, taken where it leaves and enters the client (specs/17-simulation.md, Histories).

The client's own code runs unchanged on links that look on: each record in each packet becomes an attempt with its interval.
What an answer proves is the store's word (stored; refused for its version). Whatever else comes back, or nothing, leaves open
whether the write happened, except where the node says that it did not even look: another's place, a full disk.
"""

from __future__ import annotations

import hashlib
from collections import Counter, deque
from collections.abc import Callable, Sequence

from scenefold.base.errors import DamagedData
from scenefold.base.location import LOCATION_BYTES
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, EXPECTS_NOTHING, PLACED_BY_NODE, RecordHeader, object_of
from scenefold.crypto.record_header import version_key
from scenefold.peer.copies.versions import rank_of
from scenefold.simulation.heard_copies import HeardCopies
from scenefold.simulation.history import NEVER_ENDED, Digest, Histories, Listing, Outcome, Place, Purge, Read, Version, Write
from scenefold.simulation.lies import Lies, Manner, Way
from scenefold.wire import (
    DAMAGED_RECORD,
    CopiesFound,
    GetCopies,
    GetMany,
    HandItem,
    PurgeOrder,
    PutItem,
    RecordBytes,
    ReturnRange,
)

_WITHOUT_EFFECT = frozenset({RejectReason.NOT_MY_LOCATION, RejectReason.STORAGE_FULL, RejectReason.DAMAGED, RejectReason.TOO_FEW_COPIES})
_ANSWERS = frozenset({0, RejectReason.STALE_VERSION, RejectReason.DAMAGED})
"""Those that a liar gives to writes, in place of true ones."""
REFUSED_MAX = 64
Tell = Callable[[str, Place, str], None]
"""Who, where, what: for the story."""


def named(item: PutItem | HandItem) -> tuple[Place, Version]:
    """How histories call a record, and its version. Where the nodes choose the place, it is called by its object id."""
    header = RecordHeader.decode(item.header)
    name = object_of(header) if header.placement == PLACED_BY_NODE else item.location
    return Place(item.scene, item.space, name), Version(version_key(header), header.digest)


def expected_by(item: PutItem) -> Digest | None:
    """What a write expects at its place, as histories have it."""
    expects = RecordHeader.decode(item.header).expects
    return None if expects == EXPECTS_ANYTHING else b"" if expects == EXPECTS_NOTHING else expects


class Recorder:
    """The histories of all clients of a run."""

    def __init__(self, now: Callable[[], float], tell: Tell) -> None:
        self.histories = Histories()
        self.lies = Lies(self.histories.moment, tell)
        self.listings = 0
        self.late = 0
        """Records that were refused because the scene's mode, or its log, had gone on."""
        self.strange: list[tuple[Place, str]] = []
        """Answers that no history can have: a record that nobody wrote, read without a lease."""
        self.damaged: set[Place] = set()
        """Records that have rotted on their owner's disk: they are listed and cannot be read, so lists say nothing of them."""
        self._damaged_until: dict[Place, int] = {}
        self.nonsense_heard = Counter[str]()
        """How many answers with nonsense each client was given."""
        self.refused: deque[PutItem] = deque(maxlen=REFUSED_MAX)
        """What clients were refused although it expected something: the last ones, for whoever wants to offer them again."""
        self.places: dict[tuple[int, int], set[bytes]] = {}
        self.told: Callable[[str, Place, Version], None] = lambda _who, _place, _version: None
        """Called with what a client has read, and who it is."""
        self.shown: Callable[[str, Place, Version | None, int], None] = lambda _who, _place, _version, _floor: None
        """Called with what an owner has answered a client (None: nothing is there) that is no lie, and the write floor that it went by."""
        self.purging: Callable[[Place, Version], None] = lambda _place, _version: None
        """Called with each deletion that a client is about to have purged."""
        self.copies: HeardCopies | None = None
        """Of a run that keeps copies."""
        self._offered: dict[Place, dict[bytes, Version]] = {}
        self._now = now
        self._tell = tell

    @property
    def acknowledged(self) -> int:
        """Operations that were answered: writes that are durable, reads that were served, lists."""
        return self.histories.writes_done + self.histories.reads_done + self.listings

    def now_damaged(self, places: set[Place]) -> None:
        """These are rotten now, and no others."""
        for place in sorted(self.damaged - places):
            self._damaged_until[place] = self.histories.moment()
            self._tell("", place, "can be read again")
        self.damaged = places

    def offered(self, item: PutItem) -> tuple[Place, Version]:
        """A record leaves a client."""
        place, version = named(item)
        self._offered.setdefault(place, {})[version.digest] = version
        if self.copies is not None:
            self.copies.offered(item.header, version)
        self.places.setdefault((item.scene, item.space), set()).add(place.location)
        return place, version

    def written(self, way: Way, begin: int, items: Sequence[PutItem], outcomes: Sequence[int] | None) -> None:
        """The outcomes of a packet's records, None if there are none."""
        who = name_of(way.to)
        end = self.histories.moment()
        for index, item in enumerate(items):
            place, version = self.offered(item)
            reason = None if outcomes is None else outcomes[index]
            outcome = {0: Outcome.DONE, RejectReason.STALE_VERSION: Outcome.REFUSED}.get(reason, Outcome.MAYBE)  # type: ignore[arg-type]
            self.late += reason == RejectReason.MODE_FORBIDS
            name = version.digest.hex()[:6]
            expect = expected_by(item)
            lie = self.lies.of_write(place, version.digest, way, begin)
            if lie is not None:
                # Whatever was said of it, it may have happened, and against what it expects.
                if reason in _ANSWERS:
                    self.lies.report(place, lie, f"{who} is told that {name} is {outcome.value}")
                outcome, expect = Outcome.MAYBE, None
            if outcome is Outcome.REFUSED and expect is not None and item not in self.refused:
                self.refused.append(item)
            if reason not in _WITHOUT_EFFECT or lie is not None:
                ended = NEVER_ENDED if outcome is Outcome.MAYBE else end
                self.histories.add(place, Write(begin, ended, version, expect, outcome, who, self._now()))
            word = "no answer" if reason is None else "done" if reason == 0 else RejectReason(reason).name
            wanted = "" if expect is None else f" (expects {expect.hex()[:6] or 'nothing'})"
            self._tell(who, place, f"put {name}{wanted}: {word}")

    def purged(self, who: str, begin: int, order: PurgeOrder, reasons: Sequence[int] | None) -> None:
        """What an owner says of deletions that are to go for good; None: nothing."""
        end = self.histories.moment()
        for index, (place, version) in enumerate(purged_by(order)):
            reason = reasons[index] if reasons is not None and index < len(reasons) else None
            is_done = reason == 0
            self.histories.add(place, Purge(begin, end if is_done else NEVER_ENDED, version, is_done, who, self._now()))
            self._tell(who, place, f"purge {version.digest.hex()[:6]}: {'no answer' if reason is None else reason}")

    def read(self, way: Way, begin: int, packet: GetMany, records: Sequence[RecordBytes | None], stale: bool, write_floor: int = 0) -> None:
        """What was answered for the first keys."""
        who = name_of(way.to)
        end = self.histories.moment()
        asked = [Place(packet.scene, key.space, key.object or key.location) for key in packet.keys]
        # Who is asked twice for a place in one packet, and gives the same twice, has said it once.
        answered = list(zip(asked, records, strict=False))
        lies = {said for said in dict.fromkeys(answered) if self._is_lie(way, *said, begin)}
        for place, record in answered:
            if (place, record) in lies:
                continue
            if record == DAMAGED_RECORD:
                self._tell(who, place, "get: damaged")
                if not self._is_rotten(place, begin):
                    self.strange.append((place, f"{who} is told that a sound record is damaged"))
                continue
            if record is not None and not _is_of(place, record):
                self.strange.append((place, f"{who} is given what is no record of this place, and nobody lied"))
                continue
            digest = None if record is None else RecordHeader.decode(record.header).digest
            version = None if digest is None else self._offered.get(place, {}).get(digest)
            if digest is not None and version is None:
                self.strange.append((place, f"{who} reads {digest.hex()[:6]}, which nobody wrote there"))
            if version is not None and not stale:
                self.told(who, place, version)
            if not stale:
                self.histories.add(place, Read(begin, end, digest, who, self._now()))
                self.shown(who, place, version, write_floor)
            self._tell(who, place, f"get: {'nothing' if digest is None else digest.hex()[:6]}{' (stale)' if stale else ''}")

    def read_of_copies(self, way: Way, begin: int, packet: GetCopies, answer: CopiesFound) -> None:
        """A holder has answered: what it and others say together may count now."""
        if self.copies is None:
            return
        who = name_of(way.to)
        for place, version, since, is_lied in self.copies.heard(who, way.by, begin, packet, answer):
            digest = None if version is None else version.digest
            if is_lied:
                self.lies.report(place, Manner.HELD, f"{who} is told {'nothing' if digest is None else digest.hex()[:6]} by holders")
                continue
            if version is not None:
                self.told(who, place, version)
            self.histories.add(place, Read(since, self.histories.moment(), digest, who, self._now()))
            self._tell(who, place, f"told by holders: {'nothing' if digest is None else digest.hex()[:6]}")

    def _is_rotten(self, place: Place, since: int) -> bool:
        """Whether a place was, at any moment since then."""
        return place in self.damaged or self._damaged_until.get(place, 0) > since

    def _is_lie(self, way: Way, place: Place, record: RecordBytes | None, since: int) -> bool:
        """Whether an answer is just what a liar has said. What only an owner can say wrongly is reported."""
        if record is not None and self.lies.is_this_nonsense(place, record, way, since):
            self._tell(name_of(way.to), place, "get: nonsense")
            return True
        is_nothing = record is None or record == DAMAGED_RECORD
        if record is not None and not is_nothing and not _is_of(place, record):
            return False
        digest = None if record is None or is_nothing else RecordHeader.decode(record.header).digest
        lie = self.lies.of_read(place, digest, way, since)
        if lie is not None:
            self.lies.report(place, lie, f"{name_of(way.to)} is given {'nothing' if digest is None else digest.hex()[:6]}")
        return lie is not None

    def listed(self, way: Way, begin: int, reply: ReturnRange) -> None:
        """A range answer: every place that it covers is there, or is not."""
        who = name_of(way.to)
        end = self.histories.moment()
        if reply.stale:
            return
        self.listings += 1
        if reply.objects:
            self._listed_objects(who, begin, end, reply)
            return
        there = set(reply.locations)
        for location in sorted(self.places.get((reply.scene, reply.space), ())):
            if reply.first <= location <= reply.last:
                place = Place(reply.scene, reply.space, location)
                if self._is_rotten(place, begin) or len(location) != LOCATION_BYTES:
                    continue
                if location not in there and self.lies.of_read(place, None, way, begin) is Manner.WITHHELD:
                    self.lies.report(place, Manner.WITHHELD, f"{who} does not see it in a list")
                    continue
                self.histories.add(place, Listing(begin, end, location in there, who, self._now()))

    def _listed_objects(self, who: str, begin: int, end: int, reply: ReturnRange) -> None:
        """Records that may lie anywhere: what is listed is there, and what is not may be elsewhere. None is there twice."""
        for name, count in sorted(Counter(reply.objects).items()):
            place = Place(reply.scene, reply.space, name)
            if count > 1:
                self.strange.append((place, f"{who} is told of {count} records of {name.hex()[:8]}…"))
            if not self._is_rotten(place, begin) and place in self._offered:
                self.histories.add(place, Listing(begin, end, True, who, self._now()))


def purged_by(order: PurgeOrder) -> list[tuple[Place, Version]]:
    return [
        (Place(order.scene, item.space, item.object or item.location), Version(rank_of(item.version), item.version.digest))
        for item in order.items
    ]


def name_of(user: str) -> str:
    """A client's, in stories."""
    return user.partition(":")[2]


def _is_of(place: Place, record: RecordBytes) -> bool:
    """Whether an answer can be taken for a record of this place: whoever answers otherwise has answered nothing, and clients notice."""
    try:
        header = RecordHeader.decode(record.header)
    except DamagedData:
        return False
    name = object_of(header) if header.placement == PLACED_BY_NODE else header.location
    is_here = (header.scene, header.space, name) == (place.scene, place.space, place.location)
    return is_here and hashlib.sha256(record.ciphertext).digest() == header.digest
