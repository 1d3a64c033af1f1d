"""Copies on the true disks: enough of them before anything is told, and none gone that is needed (specs/17-simulation.md, Copies).

A version is *told* once a node has acknowledged it or a client has read it: then it must lie on as many disks as its space asks for.
From then on a copy leaves a disk only if the place's owner has that version or a newer one, and enough disks do. Disks that stand in the
owner's rack never count. So a told version is lost only with that many disks, and never with one rack alone: a disk that is gone (lost, put
back, or its node's incarnation removed) is a *witness* of all that lay on it.
Versions that never lay on enough disks to be told are excused by nothing, and need not be: nobody has heard of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

from scenefold.base.location import Location
from scenefold.simulation import laws
from scenefold.simulation.blacklists import Blacklists
from scenefold.simulation.copying import Rule, node_of_slot, rack_of
from scenefold.simulation.custody import Lost
from scenefold.simulation.disks import Disk, copies_of, found_at, incarnation_of, place_of, version_in
from scenefold.simulation.history import Place, Version
from scenefold.simulation.lies import Lies, Manner
from scenefold.simulation.lineage import Holder
from scenefold.simulation.naming import is_newer, name_of, names_of, order_of
from scenefold.simulation.passed import Passed
from scenefold.store.layout import RECORDS, SUSPECTS

RECENT_S = 60.0
"""So long nodes may count on a disk that is gone: until its node is removed, and that is known and waited for."""

Violated = Callable[[str, str, bytes, tuple[int, ...]], None]
IsRotten = Callable[[int, Place], bool]


class Witness(NamedTuple):
    """What lay on a disk that is gone, or has rotted there, and since when it is gone."""

    version: Version
    at_s: float


class Keeping:
    """Of a run that keeps copies. Without `rules` it has nothing to judge."""

    def __init__(
        self,
        disks: Mapping[int, Disk],
        now: Callable[[], float],
        owner_of: Callable[[Location], int | None],
        is_rotten: IsRotten,
        violated: Violated,
        lies: Lies,
    ) -> None:
        self.rules: dict[tuple[int, int], Rule] = {}
        """By scene and space; all others have one copy."""
        self.racks = 0
        self.members: frozenset[Holder] = frozenset()
        """Who is registered, as the voter last said."""
        self._fewest = 0
        self._known: deque[tuple[float, frozenset[Holder]]] = deque()
        """Whom the log had, by the second since which: the last one before RECENT_S, and all since."""
        self._disks = disks
        self._now = now
        self._owner_of = owner_of
        self._is_rotten = is_rotten
        self._violated = violated
        self._lies = lies
        self._blacklists = Blacklists(disks, now)
        self._liars: dict[Place, set[int]] = {}
        """Whose word for their copies is worth nothing, by slot: others count on them, and they may as well have lost them."""
        self._told: dict[Place, Version] = {}
        self._witnesses: dict[Place, dict[int, Witness]] = {}
        """By slot: a machine that loses one disk after the other is one witness."""
        self.passed = Passed(now)
        self._gone: set[Holder] = set()
        self._purged: dict[Place, set[Version]] = {}
        self._lost_once: dict[Place, Version] = {}
        """The highest version of each place that may have been lost."""
        self.by_rot: set[Place] = set()
        """Where so few disks were gone at the last loss that it was none without the copies that have rotted on others."""

    def has(self, place: Place) -> bool:
        """Whether there are to be copies of what lies there."""
        return (place.scene, place.space) in self.rules

    def registered(self, members: frozenset[Holder]) -> None:
        """The log says so. Where fewer nodes are left than a space asks for, all that there are is enough."""
        self.members = members
        self._fewest = min(self._fewest or len(members), len(members))
        if not self._known or self._known[-1][1] != members:
            self._known.append((self._now(), members))

    def needed(self, place: Place) -> int:
        """As any node may know it: some have not heard yet that the log has more nodes by now."""
        return min([self.rules[place.scene, place.space].needed, *map(len, self._lately())]) if self._known else 1

    def _lately(self) -> list[frozenset[Holder]]:
        while len(self._known) > 1 and self._known[1][0] < self._now() - RECENT_S:
            self._known.popleft()
        return [members for _, members in self._known]

    def _possible(self, owner: int | None) -> int:
        """How many nodes may have what a node owns, as it may know it: what nobody was told of before may be told once all of these have it."""
        if owner is None:
            return min(map(len, self._lately()), default=1)
        return min((1 + sum(self._may_have(one.slot, owner) for one in members) for members in self._lately()), default=1)

    def _may_have(self, slot: int, owner: int) -> bool:
        """Whether a node counts for the owner of a place for certain: its blacklist may have said so otherwise lately."""
        if slot == owner or (self.racks and rack_of(slot, self.racks) == rack_of(owner, self.racks)):
            return False
        return not self._blacklists.may_forbid(owner, node_of_slot(slot, self.racks), RECENT_S)

    def purging(self, place: Place, version: Version) -> None:
        """A key holder is about to have this deletion purged: of it no copy needs to stay any more."""
        self._purged.setdefault(place, set()).add(version)

    def is_purged(self, place: Place, version: Version) -> bool:
        return version in self._purged.get(place, ())

    def lied(self, slot: int, place: Place) -> list[Lost]:
        """A node has said something else of its copy than what lies on its disk. What may be lost by that."""
        if not self.has(place):
            return []
        self._liars.setdefault(place, set()).add(slot)
        return self._lost(place)

    def holds(self, slot: int, place: Place) -> bool:
        """Whether what lies there lies on this disk by right, and is no stray."""
        if self._owner_of(place.home) == slot:
            return True
        copies = copies_of(self._disks[slot])
        return copies is not None and any(place.home in entry.arc for entry in copies.custody.entries)

    def is_liar(self, slot: int, place: Place) -> bool:
        return slot in self._liars.get(place, ())

    def is_lied_about(self, place: Place) -> bool:
        return place in self._liars

    # ------------------------------------------------------------------------------------------------------ telling

    def acknowledged(self, slot: int, place: Place, version: Version) -> None:
        """A node is about to answer that this is stored: none of the disks that count may be one that it forbids."""
        if not self.has(place):
            return
        self._tell(place, version)
        if self._was_lost(place, version):
            # It has rotted between the commit and the answer.
            return
        held = self._held(place, version)
        allowed = self._allowed(slot, held)
        if len(allowed) < self.needed(place):
            beside = "" if allowed == held else f", and n{slot} forbids {names_of(held - allowed)}"
            words = (
                f"n{slot} acknowledges {name_of(place, version)} with {names_of(allowed)} only{beside}; {self.needed(place)} must have it"
            )
            self._violated(laws.COPIED, words, place.location, (slot, *sorted(held)))

    def read(self, who: str, place: Place, version: Version) -> None:
        """A client is told by an owner, or by enough holders, that this is there. What was told before may have lost disks since, or all."""
        if not self.has(place) or self._was_lost(place, version) or not self._tell(place, version):
            return
        # Whoever answered may have passed the place on since, to one that may have others.
        owners = (self._owner_of(place.home), *self.passed.owners_lately(place.home))
        held, needed = self._held(place, version, ever=True), min(self.needed(place), *map(self._possible, owners))
        if len(held) < needed:
            words = f"{who} reads {name_of(place, version)}, which lies on {names_of(held)} only; {needed} must have it"
            self._violated(laws.COPIED, words, place.location, tuple(sorted(held)))

    def _was_lost(self, place: Place, version: Version) -> bool:
        """This version, or a newer one, as far as it may have counted before."""
        lost = self._lost_once.get(place)
        return lost is not None and version.order <= lost.order

    def _tell(self, place: Place, version: Version) -> bool:
        """Whether this was not told before."""
        told = self._told.get(place)
        if told is not None and told.order >= version.order:
            return False
        self._told[place] = version
        return True

    def _held(self, place: Place, version: Version, *, ever: bool = False) -> set[int]:
        """The disks that have this or something newer, those that had it a while ago, or ever, and are gone, and those of liars."""
        found = {slot for slot, disk in self._disks.items() if is_newer(found_at(disk, place), version)} | self._liars.get(place, set())
        since = self._now() - RECENT_S
        witnesses = self._witnesses.get(place, {}).items()
        return found | {
            slot
            for slot, witness in witnesses
            if witness.version.order >= version.order and (ever or witness.at_s > since or self._is_rotten(slot, place))
        }

    def _allowed(self, owner: int | None, held: set[int]) -> set[int]:
        """Of the disks that have something those that count for the owner of its place."""
        if owner is None or not self.racks:
            return held
        return {slot for slot in held if slot == owner or rack_of(slot, self.racks) != rack_of(owner, self.racks)}

    def _counted(self, owner: int | None, held: set[int], needed: int) -> int:
        """How many of the disks that have something count for an owner. Where it allows too few for any write, nothing may take their place: all do."""
        return len(held if self._possible(owner) < needed else self._allowed(owner, held))

    # ------------------------------------------------------------------------------------------------------ leaving

    def committed(self, slot: int) -> list[Lost]:
        """Something has become durable on a disk: of what was told, nothing may have left it that is needed. What is lost by that."""
        self._blacklists.committed(slot)
        if not self.rules:
            return []
        losses = []
        for key, before in self._disks[slot].replaced(RECORDS):
            if before is None or (told := self._told.get(place := place_of(key))) is None or told in self._purged.get(place, ()):
                continue
            if is_newer(version_in(before), told) and not is_newer(found_at(self._disks[slot], place), told):
                self._leaves(slot, place, told)
                losses += self._lost(place)
        return losses

    def arrived(self, slot: int) -> list[tuple[Place, Version]]:
        """What has become durable on a disk, older than what was lost there: it was on its way meanwhile, and may count again."""
        found = []
        for key, before in self._disks[slot].replaced(RECORDS) if self._lost_once else ():
            place = place_of(key)
            lost, version = self._lost_once.get(place), found_at(self._disks[slot], place)
            if (
                lost is not None
                and version is not None
                and version.order < lost.order
                and (before is None or version_in(before) != version)
            ):
                found.append((place, version))
        return found

    def _leaves(self, slot: int, place: Place, version: Version) -> None:
        if any(place_of(key) == place for key in self._disks[slot].peek(SUSPECTS)):
            # It is set aside, and gone for others as its node's former life is.
            return
        held, owner = self._held(place, version), self._owner_of(place.home)
        allowed = self._allowed(owner, held)
        # Who said that it may go may have passed the place on since, to one that forbids others.
        former = (len(self._allowed(one, held)) for one in self.passed.owners_lately(place.home))
        best = max(self._counted(owner, held, self.needed(place)), *former, 0)
        if best < self.needed(place) or owner not in (None, *held):
            beside = "" if owner in (None, *held) else f", and not on n{owner}, which owns the place"
            beside += "" if allowed == held else f", and on {names_of(held - allowed)}, which n{owner} forbids"
            words = (
                f"{name_of(place, version)} leaves n{slot}, and lies on {names_of(allowed)} only{beside}; {self.needed(place)} must have it"
            )
            if owner is not None and self.is_liar(owner, place):
                self._lies.report(place, Manner.HELD, words)
                return
            self._violated(laws.KEPT, words, place.location, (slot, *sorted(held)))

    # ------------------------------------------------------------------------------------------------------- losses

    def gone(self, slot: int, incarnation: bytes | None, before: Mapping[Place, Version]) -> list[Lost]:
        """A disk is gone, or its node's incarnation is removed: what of it cannot be asked for."""
        if not self.rules or incarnation is None or (holder := Holder(slot, incarnation)) in self._gone:
            return []
        self._gone.add(holder)
        return self._witnessed(slot, {place: version for place, version in before.items() if self.has(place)})

    def is_gone(self, holder: Holder) -> bool:
        """Whether that disk is."""
        return holder in self._gone

    def rotted(self, slot: int, place: Place, version: Version | None) -> list[Lost]:
        """One copy cannot be read any more."""
        if not self.has(place) or version is None:
            return []
        return self._witnessed(slot, {place: version})

    def _witnessed(self, slot: int, versions: Mapping[Place, Version]) -> list[Lost]:
        for place, version in versions.items():
            found = self._witnesses.setdefault(place, {})
            before = found.get(slot)
            highest = version if before is None else max(before.version, version, key=order_of)
            found[slot] = Witness(highest, self._now())
        return [lost for place in sorted(versions) for lost in self._lost(place)]

    def _lost(self, place: Place) -> list[Lost]:
        """The highest version that was on as many disks as must be gone for that, if no member has it or a newer one.

        Who recovers a place asks all members; who heals what has rotted, others only in the end. So then a stray need not come back by that.
        """
        highest = self._highest_gone(place)
        if highest is None:
            return []
        there = {slot: version for slot in self._disks if (version := self._sound(slot, place)) is not None}
        has_rotted = any(self._is_rotten(slot, place) for slot in self._witnesses.get(place, {}))
        alive = [
            version
            for slot, version in there.items()
            if self._counts(slot) and not self.is_liar(slot, place) and (not has_rotted or self.holds(slot, place))
        ]
        best = max(alive, default=None, key=order_of)
        if is_newer(best, highest):
            return []
        # What is written from here on needs witnesses of its own; of what is left these are some as well.
        self._told.pop(place, None)
        found = self._witnesses.pop(place, {})
        if self.is_lied_about(place):
            self._lies.report(place, Manner.HELD, f"{name_of(place, highest)} may be lost by that")
        if best is not None:
            self._witnesses[place] = {slot: Witness(min(one.version, best, key=order_of), one.at_s) for slot, one in found.items()}
        # A copy that has rotted cannot be read, but what is left of it tells its version, or is what a writer expects.
        spoilt = {slot for slot in found if slot not in there and self._is_rotten(slot, place)}
        rotten = {found[slot].version for slot in spoilt}
        gone = {slot for slot, one in found.items() if one.version.order >= highest.order} | self._liars.get(place, set())
        if len(gone - {slot for slot in spoilt if self._counts(slot)}) < self._needed_ever(place):
            self.by_rot.add(place)
        else:
            self.by_rot.discard(place)
        left = {version for version in {*there.values(), *rotten} if best is None or version.order >= best.order}
        self._lost_once[place] = max(highest, self._lost_once.get(place, highest), key=order_of)
        return [Lost(place, tuple(sorted(left, key=order_of)), highest, best is None)]

    def _needed_ever(self, place: Place) -> int:
        return min(self.rules[place.scene, place.space].needed, self._fewest or 1)

    def _highest_gone(self, place: Place) -> Version | None:
        """The highest version that may have been told by what its witnesses had: on enough disks, which did not all stand in one rack."""
        needed = self._needed_ever(place)
        witnesses, liars, told = self._witnesses.get(place, {}), self._liars.get(place, set()), self._told.get(place)
        versions = {witness.version for witness in witnesses.values()} | ({told} if told is not None and liars else set())
        for version in sorted(versions, key=order_of, reverse=True):
            slots = liars | {slot for slot, witness in witnesses.items() if witness.version.order >= version.order}
            standing = {rack_of(slot, self.racks) if self.racks else slot for slot in slots}
            if len(slots) >= needed and len(standing) >= min(needed, 2):
                return version
        return None

    def _sound(self, slot: int, place: Place) -> Version | None:
        return None if self._is_rotten(slot, place) else found_at(self._disks[slot], place)

    def _counts(self, slot: int) -> bool:
        """Whether a disk's node is asked what lies there."""
        holder = Holder(slot, incarnation_of(self._disks[slot]) or b"")
        return holder in self.members and holder not in self._gone
