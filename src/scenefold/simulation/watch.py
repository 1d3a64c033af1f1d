"""The observer of a run: it sees every commit, acknowledgement and removal at the instant it happens, and judges it.

It knows more than any node can: all disks, all leases, who is really up. So a fault is found where it is made, and not only
where a client stumbles over it much later. What it sees goes into the story as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

from scenefold.base.location import Arc, Location
from scenefold.simulation import laws
from scenefold.simulation.answers import Answer, Owner, problems_of
from scenefold.simulation.custody import Lost, is_held, lost_by_change, lost_to_claimer, versions_of
from scenefold.simulation.disks import (
    Disk,
    arc_of,
    counted,
    counting_of,
    handovers_of,
    has_open_handover,
    holding_of,
    incarnation_of,
    objects_decided,
    place_of,
    receivers_of,
    records_of,
)
from scenefold.simulation.history import Loss, Place, Return, Version
from scenefold.simulation.homecoming import Homecoming
from scenefold.simulation.keeping import Keeping
from scenefold.simulation.lies import Manner
from scenefold.simulation.lineage import Gain, Holder, Lineage, Piece, Way
from scenefold.simulation.moves import Moves
from scenefold.simulation.reach import Reach
from scenefold.simulation.recording import Recorder
from scenefold.simulation.rot import Rot
from scenefold.simulation.story import Story, Violation
from scenefold.wire import Member

VIOLATIONS_MAX = 50


class Watch:
    """One for a run. `disks` by slot, for all machines there are; `running`: nodes that can answer just now."""

    def __init__(
        self, now: Callable[[], float], disks: Mapping[int, Disk], running: Mapping[int, Owner], slot_of: Callable[[int], int]
    ) -> None:
        self.story = Story()
        self.recorder = Recorder(now, self._client_said)
        self.lineage = Lineage()
        self.moves = Moves()
        self.reach = Reach()
        self.counts = Counter[str]()
        self.violations: list[Violation] = []
        self.vanished: set[Place] = set()
        """Where copies were to be, and what may have been told went with its owner and other disks."""
        self.put_back: dict[int, bytes] = {}
        """The incarnation of the backup that each slot's disk was last put back to."""
        self.judged_at: dict[bytes, float] = {}
        """When the voter last had nothing against the removal of an incarnation."""
        self.on_handover: Callable[[int], None] | None = None
        """Called with the slot whose open handovers have just changed on its disk."""
        self._now = now
        self._disks = disks
        self._running = running
        self._slot_of = slot_of
        self._holdings: dict[int, tuple[bytes | None, bytes | None]] = {}
        self.rot = Rot(disks)
        self.keeping = Keeping(disks, now, self._owner_of, self.rot.is_at, self.violated, self.recorder.lies)
        self.homecoming = Homecoming(disks, self._owner_of, self.recorder.lies, self.violated, self.keeping.is_purged)
        self.recorder.told = self.keeping.read
        self.recorder.purging = self.keeping.purging
        self._replaced: set[Holder] = set()

    # ---------------------------------------------------------------------------------------------------- telling

    def tell(self, slot: int | None, what: str, *values: object) -> None:
        self.story.tell(self._now(), slot, what, *values)

    def violated(self, law: str, what: str, location: bytes | None = None, slots: Sequence[int] = ()) -> None:
        self.story.tell(self._now(), None, "VIOLATED {}: {}", law, what)
        if len(self.violations) < VIOLATIONS_MAX:
            self.violations.append(Violation(law, what, self._now(), location, tuple(slots)))

    def _client_said(self, who: str, place: Place, what: str) -> None:
        self.story.tell(self._now(), None, "{} {}", who, what, location=place.location)

    def judged(self, member: Member, may_go: bool) -> None:
        """The voter has looked whether it has anything against a removal; it may take long to write it down."""
        if may_go:
            self.judged_at[member.incarnation] = self._now()
        else:
            self.judged_at.pop(member.incarnation, None)

    # ------------------------------------------------------------------------------------------------------- disks

    def records(self, slot: int, arc: Arc | None = None) -> dict[Place, Version]:
        """What a disk holds (in an arc), without what has rotted there."""
        return self._sound(slot, records_of(self._disks[slot], arc))

    def _sound(self, slot: int, found: dict[Place, Version]) -> dict[Place, Version]:
        for copy in self.rot.on(slot):
            found.pop(copy.place, None)
        return found

    def _records(self, arc: Arc | None = None) -> dict[int, dict[Place, Version]]:
        """What all disks hold (in an arc)."""
        return {slot: self.records(slot, arc) for slot in self._disks}

    def disk_replaced(self, slot: int, before: Mapping[Place, Version], incarnation: bytes | None, why: str) -> None:
        """A disk was wiped or rolled back: what only it held is lost, and its incarnation will never own anything again."""
        taken = {place for place in before if self._owner_of(place.home) == slot}
        if incarnation is not None:
            self.lineage.gone(Holder(slot, incarnation))
            self._replaced.add(Holder(slot, incarnation))
        self._holdings[slot] = holding_of(self._disks[slot])
        if (backup := incarnation_of(self._disks[slot])) is not None:
            self.put_back[slot] = backup
        counting = {other: self._sound(other, counted(disk, taken)) for other, disk in self._disks.items()}
        single = {place: version for place, version in before.items() if not self.keeping.has(place)}
        gone = self.keeping.gone(slot, incarnation, before)
        self._vanish(gone)
        losses = [*lost_by_change(single, counting, self._records()), *gone]
        self._lost(losses, f"n{slot} {why}")
        self.homecoming.replaced(slot, before, counting)
        self.homecoming.owes(losses, counting)
        self._may_count((place, version) for place, version in sorted(self.records(slot).items()) if before.get(place) != version)
        self._look_at_rot()

    def damaged(self, slot: int, key: bytes, before: Mapping[Place, Version]) -> None:
        """A stored record has rotted: this disk's copy cannot be read any more. `before`: what the disk held."""
        place = place_of(key)
        self.rot.add(slot, key)
        self.homecoming.rotted(place)
        if self.keeping.has(place):
            self._lost(self.keeping.rotted(slot, place, before.get(place)), f"damaged on n{slot}")
            self._look_at_rot()
            return
        disks = self._records()
        owner, rotten = self._owner_of(place.home), before.get(place)
        if owner in (None, slot) or has_open_handover(self._disks[slot]) or not is_held(disks[owner], place, rotten):
            left = versions_of(disks, place)
            best = None if rotten is None else max([rotten, *left], key=lambda version: version.order)
            self._lost([Lost(place, left, best)], f"damaged on n{slot}")
        self._look_at_rot()

    def _may_count(self, versions: Iterable[tuple[Place, Version]]) -> None:
        for place, version in versions:
            self.recorder.histories.add(place, Return(self.recorder.histories.moment(), version))

    def _owner_of(self, location: Location) -> int | None:
        """The slot whose disk durably owns a place, or did last."""
        holder = self.lineage.holder_of(location).holder
        return None if holder is None or holder.slot not in self._disks else holder.slot

    def is_lied_about_by(self, name: str, place: Place) -> bool:
        """Whether the node of this name is one whose word of a copy is worth nothing."""
        return self.keeping.is_liar(self._slot_of(int(name.partition(":")[2])), place)

    def lied_about_copy(self, slot: int, place: Place) -> None:
        """What a node says of its copy of a record is worth nothing from now on."""
        self._lost(self.keeping.lied(slot, place), f"n{slot} lies about its copy")

    def _look_at_rot(self) -> None:
        """Which places cannot be read, because their owner's own copy is rotten."""
        rotten = {copy.place for copy in self.rot.copies() if self._owner_of(copy.place.home) == copy.slot}
        if rotten != self.recorder.damaged:
            self.recorder.now_damaged(rotten)

    def _vanish(self, losses: Iterable[Lost]) -> None:
        """A disk is gone. Where the owner's is there, what it has not was never acknowledged by it, however many others had it."""
        for lost in losses:
            owner = self.lineage.holder_of(lost.place.home).holder
            if owner is None or self.keeping.is_gone(owner):
                self.vanished.add(lost.place)

    def _lost(self, losses: Iterable[Lost], why: str) -> None:
        for place, left, best, or_nothing in losses:
            self.recorder.histories.add(place, Loss(self.recorder.histories.moment(), left, why, self._now(), best, or_nothing))
            names = ", ".join(version.digest.hex()[:6] for version in left) or "nothing"
            self.story.tell(self._now(), None, "may be lost, {}; disks still hold {}", why, names, location=place.location)
            self.counts["records at stake"] += 1

    # ----------------------------------------------------------------------------------------------------- holdings

    def committed(self, slot: int) -> None:
        """Something has just become durable on a node's disk."""
        disk = self._disks[slot]
        holding = holding_of(disk)
        before = self._holdings.get(slot, (None, None))
        if holding != before:
            self._holding_changed(slot, disk, before, holding)
        self.homecoming.committed(slot)
        self._lost(self.keeping.committed(slot), f"gone with a copy that leaves n{slot}")
        self._may_count(self.keeping.arrived(slot))
        self._look_at_rot()

    def removed(self, slot: int, incarnation: bytes) -> None:
        """The log removes a node: of whatever it holds copies of, it is not asked any more."""
        self.lineage.gone(Holder(slot, incarnation))
        if incarnation == incarnation_of(self._disks[slot]):
            losses = self.keeping.gone(slot, incarnation, self.records(slot))
            self._vanish(losses)
            self._lost(losses, f"n{slot} is removed")
            self.homecoming.owes(losses, {other: counted(disk) for other, disk in self._disks.items()} if losses else {})

    def _holding_changed(
        self, slot: int, disk: Disk, before: tuple[bytes | None, bytes | None], holding: tuple[bytes | None, bytes | None]
    ) -> None:
        self._holdings[slot] = holding
        incarnation = incarnation_of(disk)
        if incarnation is None:
            return
        if holding[0] != before[0]:
            self._arc_changed(Holder(slot, incarnation), arc_of(disk))
        if holding[1] != before[1]:
            self.counts["steps of handovers"] += 1
            if self.on_handover is not None:
                self.on_handover(slot)

    def _arc_changed(self, holder: Holder, arc: Arc | None) -> None:
        self.tell(holder.slot, "owns {} durably", "nothing" if arc is None else f"{arc.first.hex()[:8]}… to {arc.last.hex()[:8]}…")
        before = self.lineage.pieces
        gains, wrong = self.lineage.changed(holder, arc, self._now(), lambda piece: self._towards(self._disks[holder.slot], piece))
        for gain in wrong:
            self._took_wrongly(gain)
        for piece in self.lineage.pieces:
            if piece.holder == holder and piece.released and piece not in before:
                self._check_released(holder, piece)
        for gain in gains:
            if gain not in wrong:
                self._gained(gain)
        self.count_objects()

    def count_objects(self) -> None:
        """Each node-managed object has one record with the node that decides about it."""
        found = Counter(
            place for slot, disk in self._disks.items() for place in objects_decided(disk) if self._owner_of(place.home) == slot
        )
        for place, count in sorted(found.items()):
            if count > 1:
                words = f"{count} records of {place.location.hex()[:8]}… in space {place.space}"
                self.violated(laws.ONE_RECORD, words, location=place.location)

    def _towards(self, disk: Disk, piece: Arc) -> Holder | None:
        """Whom a piece goes to that a node has let go of, as its own note says."""
        for arc, member in receivers_of(disk):
            if arc.intersection(piece) is not None:
                return Holder(self._slot_of(member.node), member.incarnation)
        return None

    def _took_wrongly(self, gain: Gain) -> None:
        before = gain.before
        assert before.holder is not None
        word = f"was let go of in favour of n{before.towards.slot}" if before.towards else f"n{before.holder.slot} still owns"
        slots = (gain.holder.slot, before.holder.slot)
        self.violated(laws.ONE_OWNER, f"n{gain.holder.slot} claims from {gain.arc.first.hex()[:8]}… on what {word}", slots=slots)

    def _check_released(self, holder: Holder, piece: Piece) -> None:
        """The receiver must hold every record of a piece before its owner durably lets go of it.

        A receiver whose disk was replaced after it had kept them claims nothing any more: the owner takes the piece back.
        """
        if piece.towards is None or piece.towards.slot not in self._disks or piece.towards in self._replaced:
            return
        disks = {slot: self.records(slot, piece.arc) for slot in (holder.slot, piece.towards.slot)}
        under_way = next(
            (known.id for known in handovers_of(self._disks[holder.slot]) if known.gives and known.piece.intersection(piece.arc)), b""
        )
        self._blame(f"n{holder.slot} lets go of", disks, piece.towards.slot, holder.slot, under_way)

    def _blame(self, what: str, disks: dict[int, dict[Place, Version]], claimer: int, other: int, handover: bytes) -> None:
        # A copy that rotted after it was kept is not the giver's fault; its loss stands in its history already.
        places = {place for disk in disks.values() for place in disk} - {copy.place for copy in self.rot.on(claimer)}
        for lost in lost_to_claimer(disks, claimer, places):
            newest = lost.left[-1].digest
            words = f"{what} {lost.place.location.hex()[:8]}… though n{claimer} does not hold its newest version {newest.hex()[:6]}"
            if self.recorder.lies.is_lost(handover, lost.place, newest):
                self.recorder.lies.report(lost.place, Manner.LOST, words)
                self._lost([Lost(lost.place, versions_of(self._records(), lost.place), lost.newest)], "lied about in a handover")
                self.homecoming.lied_about(lost.place)
                continue
            self.violated(laws.CARRIED, words, location=lost.place.location, slots=(claimer, other))

    def _gained(self, gain: Gain) -> None:
        slot = gain.holder.slot
        self.counts[gain.way.value] += 1
        if gain.way is Way.ADOPTION:
            disks = self._records(gain.arc)
            places = {place for disk in disks.values() for place in disk if not self.keeping.has(place)}
            losses = lost_to_claimer(disks, slot, places)
            self._lost(losses, f"n{slot} adopts its place")
            counting = {other: counting_of(self._disks[other], found, places) for other, found in disks.items()}
            self.homecoming.owes(losses, counting)
        if gain.way is Way.HANDOVER and gain.before.holder is not None:
            self.keeping.passed.passes(gain.arc, gain.before.holder.slot)
            for hurry in self.moves.handed_over(sorted(self.records(slot, gain.arc)), self._now()):
                words = f"{hurry.place.location.hex()[:8]}… moves to n{slot} {hurry.after_s:.2f} s after it moved before"
                self.violated(laws.SETTLED, words, location=hurry.place.location, slots=(slot,))

    # --------------------------------------------------------------------------------------------- acknowledgements

    def acknowledges(self, slot: int, place: Place, version: Version, location: Location) -> None:
        """A node is about to answer that a record is durable at a location."""
        is_replaced = Holder(slot, incarnation_of(self._disks[slot]) or b"") in self._replaced
        answer = Answer(slot, place, version, location, is_replaced=is_replaced, has_rotted=self.rot.is_at(slot, place))
        for law, words, slots in problems_of(answer, self._disks[slot], lambda: self.records(slot).get(place), self._running):
            self.violated(law, words, location=location, slots=slots)
        self.keeping.acknowledged(slot, place, version)
