"""A segment of an owner's arc: who may answer for it, and how that changes (specs/20-copies.md, Configurations). Pure.

    idle  -place->  filling  (all new holders compared, and debts allow it)  -activate->  told to all members  ->  idle

An owner may count a configuration out only when nobody can read by it any more, whatever messages are still on their way.
So of each member it keeps the number below which that one certainly has no entry any more, and of nobody it believes more.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Set
from dataclasses import dataclass, replace

from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.peer.copies.entries import Entry
from scenefold.wire import Configuration, Member

GONE = (1 << 64) - 1
"""In place of a number: the log has removed the member, and its leases are over."""


@dataclass(frozen=True, slots=True)
class Change:
    """The next configuration, as soon as its holders have everything: until then those who are new are filled under `number`."""

    number: int
    holders: tuple[Member, ...]
    needed: int


@dataclass(frozen=True, slots=True)
class Segment:
    """An arc of one layout whose places are treated alike. Transitions answer the segment after it, the same one if nothing changes."""

    layout: Layout
    arc: Arc
    configurations: tuple[Configuration, ...] = ()
    """All by which somebody may still be answered, the newest last."""
    change: Change | None = None
    confirmed: frozenset[tuple[Member, int]] = frozenset()
    """Who may have an entry here, and below which number he certainly has none any more."""
    sound: frozenset[Member] = frozenset()
    """Who has compared with this owner since it was made a holder by it: it lacks nothing but what is owed to it."""
    leaving: int = 0
    """Who is no holder any more has to confirm this number."""

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def newest(self) -> Configuration | None:
        return self.configurations[-1] if self.configurations else None

    def active(self, me: Member) -> Configuration | None:
        """The newest configuration, if this owner has made it since it took the piece: its holders may have heard of one in between."""
        newest = self.newest
        if newest is None or newest.members[0] != me:
            return None
        bounds = dict(self.confirmed)
        holders = [member for member in newest.members[1:] if bounds.get(member, 0) != GONE]
        if any(bounds.get(member, 0) > newest.number for member in holders):
            return None
        # Whoever makes one has compared its holders; of a piece that comes in nobody is.
        return newest if newest.number >= self.leaving or self.sound.issuperset(holders) else None

    def bound_of(self, member: Member) -> int:
        """The number below which a node certainly has no entry any more."""
        return dict(self.confirmed).get(member, 0)

    def is_closed(self, configuration: Configuration, me: Member, is_over: Callable[[Member], bool] | None = None) -> bool:
        """Whether too few are left who could be read by it. `is_over`: who could not for another reason."""
        confirmed = dict(self.confirmed)
        left = [member for member in configuration.members if member != me and confirmed.get(member, 0) <= configuration.number]
        return len(left if is_over is None else [member for member in left if not is_over(member)]) < configuration.quorum

    def is_settled(self, have: Set[Member], needed: int, me: Member) -> bool:
        """Whether what these nodes have durably, the owner among them, may be acknowledged (Writes, rules 1 and 2)."""
        return len(have & {me, *self.placed(me)}) >= needed and all(
            len(have & set(configuration.members)) >= configuration.needed
            for configuration in self.configurations
            if not self.is_closed(configuration, me)
        )

    def holders(self, me: Member) -> list[Member]:
        """To whom every write is sent: whoever is a holder, or is made one."""
        return [member for member in self._known(me) if self.wanted(member, me) is not None]

    def placed(self, me: Member) -> list[Member]:
        """Who holds copies as placement wants it now. Whoever was inherited, or is to go, may stand where the owner wants no copies."""
        active, change = self.active(me), self.change
        chosen = change.holders if change is not None else () if active is None else active.members
        return [member for member in self.holders(me) if member in chosen]

    def counted_on(self, me: Member) -> set[Member]:
        """Who may be counted among those that have a record: whoever is a holder, or was one and may not know yet that it is none."""
        confirmed = dict(self.confirmed)
        members = {
            member
            for found in self.configurations
            if not self.is_closed(found, me)
            for member in found.members
            if confirmed.get(member, 0) <= found.number
        }
        return (members | set(self.holders(me))) - {me}

    def wanted(self, member: Member, me: Member) -> Entry | None:
        """What a node is to keep here; None: nothing."""
        active, change = self.active(me), self.change
        if self.bound_of(member) == GONE or member == me:
            return None
        if active is not None and member in active.members:
            return Entry(self.layout, self.arc, active.number, active.members, active.needed, whole=True)
        if change is not None and (member in change.holders or (active is None and member in self._known(me))):
            # Before an owner's first configuration all whom it has inherited go on under it, so that they are over for what was.
            members = (me, *change.holders)
            return Entry(self.layout, self.arc, change.number, members, min(change.needed, len(members)), whole=False)
        return None

    def untold(self, me: Member) -> list[Member]:
        """Who has not confirmed yet what it is to keep here."""
        return [member for member in self._known(me) if self.bound_of(member) < self._asked_of(member, me)]

    def is_idle(self, me: Member) -> bool:
        return self.change is None and self.active(me) is not None and not self.untold(me)

    def _asked_of(self, member: Member, me: Member) -> int:
        if self.bound_of(member) == GONE:
            return 0
        entry = self.wanted(member, me)
        # What was inherited is let alone until it is known what shall be.
        waits = entry is None and self.active(me) is None and self.change is None
        return 0 if waits else self.leaving if entry is None else entry.number

    def _known(self, me: Member) -> list[Member]:
        named = {member for member, _ in self.confirmed} | {member for found in self.configurations for member in found.members}
        if self.change is not None:
            named |= set(self.change.holders)
        return sorted(named - {me}, key=lambda member: (member.node, member.incarnation))

    # ------------------------------------------------------------------------------------------------------ changes

    def place(self, me: Member, holders: tuple[Member, ...], needed: int, number: int) -> Segment:
        """Placement gives these holders now. `number` is above all that was met or said here."""
        active, change = self.active(me), self.change
        size = 1 + len(holders)
        fits = active is not None and set(active.members[1:]) == set(holders) and active.needed == min(needed, size)
        if fits and change is None:
            return self
        if not fits and change is not None and (set(change.holders), change.needed) == (set(holders), needed):
            return self
        after = replace(self, change=None if fits else Change(number, holders, needed))
        return after._left(self, me, number)._tidy(me)

    def renumber(self, me: Member, number: int) -> Segment:
        """Say it again under a higher number, since somebody has met one that is not below what he was told."""
        active, change = self.active(me), self.change
        if change is not None:
            return replace(self, change=replace(change, number=number), leaving=number)
        if active is not None:
            return replace(self, change=Change(number, active.members[1:], active.needed), leaving=number)
        return self

    def confirm(self, me: Member, member: Member, number: int) -> Segment:
        """A node has durably no entry below this number. Of who is not known here nobody asks."""
        if number <= self.bound_of(member) or member not in self._known(me):
            return self
        return self._bounded(member, number)._tidy(me)

    def remove(self, me: Member, member: Member, number: int) -> Segment:
        """The log has removed a node, and T_wait has passed since this owner learnt that.

        If it was the last holder of a configuration that the owner had made before the piece was another's, that one is active again, and
        of those who went on under the next one, inherited ones among them, some are to hold nothing: they hear of it under `number`.
        """
        if member not in self._known(me) or self.bound_of(member) == GONE:
            return self
        after = replace(self._bounded(member, GONE), sound=self.sound - {member})
        holders = set(after.holders(me))
        left = set(self.holders(me)) - holders - {member}
        if left:
            after = replace(after, confirmed=after._all_known(me), sound=after.sound & holders, leaving=number)
        return after._tidy(me)

    def compare(self, me: Member, member: Member, number: int) -> Segment:
        """A node has compared all of the segment with this owner under the entry with this number, and lacks only what is owed to it."""
        entry = self.wanted(member, me)
        if member in self.sound or entry is None or entry.number != number or self.bound_of(member) < number:
            return self
        return replace(self, sound=self.sound | {member})

    def can_activate(self, debts: Iterable[Collection[Member]]) -> bool:
        """`debts`: of each record of the segment that is owed to somebody, to whom; the same ones need not be said twice."""
        change = self.change
        if change is None or not self.sound.issuperset(change.holders):
            return False
        size = 1 + len(change.holders)
        return all(size - len(set(change.holders) & set(debtors)) >= min(change.needed, size) for debtors in debts)

    def activate(self, me: Member, number: int, debts: Iterable[Collection[Member]]) -> Segment:
        """Make the change's holders those that answer; the same segment if it is too early. Only once that is durable are they told."""
        change = self.change
        if change is None or not self.can_activate(debts):
            return self
        members = (me, *change.holders)
        made = Configuration(number, members, min(change.needed, len(members)))
        after = replace(self, configurations=(*self.configurations, made), change=None)
        return after._left(self, me, number)._tidy(me)

    def given(self, me: Member, number: int) -> Segment:
        """As it passes to another owner. This one takes nothing below `number` there any more."""
        return replace(self, change=None, confirmed=self._all_known(me) | {(me, number)}, sound=frozenset(), leaving=0)

    def taken(self, me: Member, number: int) -> Segment:
        """As it is for its new owner, from this number on. Of those who may have entries here all have to hear of it, also who is none of its holders."""
        confirmed = frozenset((member, bound) for member, bound in self.confirmed if member != me)
        return replace(self, change=None, confirmed=confirmed, sound=frozenset(), leaving=number)

    # --------------------------------------------------------------------------------------------------- helpers

    def _all_known(self, me: Member) -> frozenset[tuple[Member, int]]:
        return frozenset((member, self.bound_of(member)) for member in self._known(me))

    def _bounded(self, member: Member, number: int) -> Segment:
        kept = {(other, bound) for other, bound in self.confirmed if other != member}
        return replace(self, confirmed=frozenset(kept | {(member, number)}))

    def _left(self, before: Segment, me: Member, number: int) -> Segment:
        """Who was a holder before and is none now has to hear of it, and begins anew if it comes back."""
        known = replace(
            self, confirmed=before._all_known(me) | {(member, 0) for member in self._known(me) if member not in before._known(me)}
        )
        holders = set(known.holders(me))
        left = [member for member in before.holders(me) if member not in holders]
        return replace(known, sound=known.sound & holders, leaving=number if left else known.leaving)

    def _tidy(self, me: Member) -> Segment:
        """Without closed configurations but for the newest, and without who has nothing to do with it any more."""
        kept = tuple(found for found in self.configurations if found is self.newest or not self.is_closed(found, me))
        named = {member for found in kept for member in found.members}
        # That one of these is gone is remembered as long as it is to become a holder: else it would be counted out again and again.
        named |= set() if self.change is None else set(self.change.holders)
        after = replace(self, configurations=kept)
        done = {member for member in after._known(me) if member not in named and not after._concerns(member, me)}
        return replace(after, confirmed=frozenset((member, bound) for member, bound in after.confirmed if member not in done))

    def _concerns(self, member: Member, me: Member) -> bool:
        bound = self.bound_of(member)
        waits = self.active(me) is None and self.change is None
        return bound != GONE and (waits or self.wanted(member, me) is not None or bound < self.leaving)
