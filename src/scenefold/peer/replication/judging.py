"""What is settled, as holders answer and as it changes who they are (specs/20-copies.md, Writes).

What is known about copies is one value, and each of them is judged by anew: who holds a record today may not be who was to get it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import trio

from scenefold.base.cover import without
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.peer.copies.segment import Segment
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Doubt, Name, Pending, name_of
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.full_holders import FullHolders
from scenefold.peer.replication.lane import Lane
from scenefold.peer.replication.paying import Due, Paying
from scenefold.peer.replication.settling_rule import Rule, Rules
from scenefold.peer.replication.turning import Turning
from scenefold.store import Spot
from scenefold.store.debts import Debt
from scenefold.wire import Member


class Judging:
    """Used from the Trio thread only. `run` it, or nothing is sent."""

    def __init__(self, parts: Parts, roster: Roster, full: FullHolders) -> None:
        """`full`: told of a holder that has no room for what it is owed."""
        self._parts = parts
        self._full = full
        self._roster = roster
        self._unsettled = parts.unsettled
        self._lanes: dict[NodeId, Lane] = {}
        self._nursery: trio.Nursery | None = None
        self._rules = Rules(parts.keeper.copies)
        self._doubted: set[Layout] = set()
        self.turning = Turning(parts)

    async def run(self) -> None:
        """Send, pay, and judge again whatever changes, until cancelled."""
        async with trio.open_nursery() as nursery:
            self._nursery = nursery
            try:
                for lane in self._lanes.values():
                    self._start(lane)
                while True:
                    copies, news = self._parts.keeper.copies, self._parts.knowing.news
                    await self._judge_all()
                    await self.turning.changed_after(copies, news)
            finally:
                # Whoever still answers while this life ends sends nothing any more.
                self._nursery = None

    # -------------------------------------------------------------------------------------------------- questions

    def layout_of(self, scene: SceneId, space: SpaceId) -> Layout | None:
        """() for a space with one copy; None if the scene is unknown here."""
        known = self._parts.scenes.here(scene)
        return None if known is None else known.layouts.get(space, ())

    def rule_at(self, layout: Layout, spot: Spot) -> Rule | None:
        """By what a record there is judged; None if it is not known who holds it."""
        segment = self._parts.keeper.copies.configurations.at(layout, spot.home)
        return None if segment is None else self.rule_of(segment)

    def rule_of(self, segment: Segment) -> Rule:
        """`segment`: one of the present ones."""
        copies = self._parts.keeper.copies
        if self._rules.copies is not copies:
            self._rules = Rules(copies, self._rules)
        return self._rules.of(segment)

    def needed(self, wanted: int) -> int:
        """How many have to have a record of a space that asks for so many."""
        return min(wanted, max(1, len(self._parts.cluster_log.registry.order)))

    def in_hand(self, name: Name) -> bool:
        """Whether there is a version of a record in memory that may still be sent."""
        return any(lane.has_of(name) for lane in self._lanes.values())

    def could_settle(self, rule: Rule, wanted: int) -> bool:
        """Whether those who seem to be there are enough."""
        present = {rule.me, *(target for target in rule.targets if self.is_alive(target.node))}
        return rule.is_settled(present, self.needed(wanted))

    def is_settled(self, pending: Pending, rule: Rule) -> bool:
        needed, have = self.needed(pending.needed), _have(pending, rule)
        if pending.left and not pending.is_write:
            # What all say alike, if only that it is damaged, may be told; it is not acknowledged by that (`counts`).
            have = have | pending.left
        asked = needed if pending.is_write or not rule.is_placed else min(needed, len(rule.placed))
        return rule.is_settled(have, asked) and self._is_free(pending, have)

    def _is_free(self, pending: Pending, have: Collection[Member]) -> bool:
        place, home = pending.spot.place, pending.home
        return self.turning.is_free(place.scene, place.space, Arc(home, home), have)

    def counts(self, pending: Pending) -> bool:
        """Whether what is settled may be acknowledged, too."""
        if pending.is_write:
            return True
        rule = self.rule_at(pending.layout, pending.spot)
        return rule is not None and rule.is_settled(_have(pending, rule), self.needed(pending.needed))

    # ------------------------------------------------------------------------------------------------------ doing

    def send(self, pending: Pending) -> None:
        """Of what is stored: to all who are not known to have it, unless that is under way. It may be settled as it is."""
        assert pending.is_stored
        rule = self.rule_at(pending.layout, pending.spot)
        if rule is None:
            return
        if rule is pending.judged:
            # By the same rule it was sent to all, and is judged with each answer; but what bound it may have gone.
            if self.is_settled(pending, rule):
                self._settle(pending)
            return
        pending.judged = rule
        have = _have(pending, rule)
        for target in rule.targets:
            if target not in have:
                self._lane(target.node).send(pending)
        for node in pending.debtors.difference(rule.debtors):
            # It holds nothing there any more: whoever looks through its debts forgets this one.
            self.owes(node)
        if self.is_settled(pending, rule):
            self._settle(pending)

    def owes(self, node: NodeId) -> None:
        """It is owed something that is on the disk."""
        self._lane(node).fall_behind()

    def doubt(self, arc: Arc) -> None:
        """All that has copies there is unsettled, until each place satisfies both rules by who is sound."""
        self._doubted = self._layouts()
        for layout in sorted(self._doubted):
            self._unsettled.doubt(Doubt(layout, arc, rules=2))

    def doubt_turned(self) -> None:
        """What was doubted before a space came to a layout is doubted by that as well. Called before it is looked what is."""
        layouts = self._layouts()
        for layout in sorted(layouts - self._doubted):
            for doubt in self._unsettled.doubts:
                self._unsettled.doubt(Doubt(layout, doubt.arc, rules=2))
        self._doubted = layouts

    def _layouts(self) -> set[Layout]:
        """All that there are; () if there is a space that has one copy since it turned."""
        scenes = self._parts.scenes.everyone()
        return {layout for known in scenes for space, layout in known.layouts.items() if layout or space in known.turns}

    def doubt_unsafe(self) -> None:
        """Likewise, after a start: where no configuration was made since the place is this owner's, what lies here may lie nowhere else.

        Elsewhere only as long as rule 2 may not hold for what is there.
        """
        known: dict[Layout, list[Segment]] = {layout: [] for layout in self._layouts() if layout}
        for segment in self._parts.keeper.copies.configurations.segments:
            known.setdefault(segment.layout, []).append(segment)
        for layout, segments in sorted(known.items()):
            for part in _apart(self._parts.keeper.holding.arc, [segment.arc for segment in segments if self._is_made(segment)]):
                self._unsettled.doubt(Doubt(layout, part, rules=2))
            for segment in segments:
                rule = self.rule_of(segment)
                if not rule.is_safe({rule.me, *rule.sound}):
                    self._unsettled.doubt(Doubt(layout, segment.arc, rules=1))
        # What is owed to those who held it before may have been forgotten.
        for layout, arc in self.turning.bound():
            self._unsettled.doubt(Doubt(layout, arc, rules=1))
        self._doubted = self._layouts()

    def _is_made(self, segment: Segment) -> bool:
        """Whether enough have all that lay there when the place became this owner's."""
        active = segment.active(self._parts.keeper.copies.configurations.me)
        if active is None:
            return False
        # One of before it was another's counts as active again when its holders are compared, or all gone.
        return active.number >= segment.leaving or 1 + len(segment.sound.intersection(active.members)) >= active.needed

    async def _judge_all(self) -> None:
        """What is written, or what changes, while this goes on is judged by what is known then: that it has changed begins this anew."""
        for page in self._unsettled.pages():
            for pending in page:
                if not pending.is_settled and pending.is_stored:
                    self._judge(pending)
            await trio.lowlevel.checkpoint()
        if self._unsettled.doubts:
            self.doubt_turned()
            for segment in self._parts.keeper.copies.configurations.segments:
                self._judge_doubts(segment)
            for doubt in self._unsettled.doubts:
                if not doubt.layout and not self.turning.is_bound(doubt.layout, doubt.arc):
                    self._unsettled.clear(doubt.layout, doubt.arc, doubt.rules)

    def _judge(self, pending: Pending) -> None:
        place = pending.spot.place
        known = self._parts.scenes.here(place.scene)
        layout = pending.layout if known is None else known.layouts.get(place.space, pending.layout)
        if layout:
            pending.layout = layout
            self.send(pending)
        elif self._is_free(pending, pending.have):
            self._settle(pending)

    def _judge_doubts(self, segment: Segment) -> None:
        rule = self.rule_of(segment)
        have = {rule.me, *rule.sound}
        if self.turning.is_bound(segment.layout, segment.arc):
            return
        if rule.is_safe(have):
            self._unsettled.clear(segment.layout, segment.arc, rules=1)
        asked = [found.needed for found in (segment.change, segment.active(rule.me)) if found is not None]
        if asked and rule.is_settled(have, self.needed(max(asked))):
            self._unsettled.clear(segment.layout, segment.arc, rules=2)

    def _settle(self, pending: Pending) -> None:
        # What may only be told brings no older write to count: whoever waits for that is answered by how many have it.
        is_enough = self.counts(pending)
        for one in self._unsettled.settle(pending):
            one.is_write &= is_enough
            for node in one.debtors:
                if node in self._lanes:
                    self._lanes[node].settled(one)

    def _lane(self, node: NodeId) -> Lane:
        lane = self._lanes.get(node)
        if lane is None:
            lane = self._lanes[node] = Lane(self._parts, self, node)
            self._start(lane)
        return lane

    def _start(self, lane: Lane) -> None:
        if self._nursery is not None:
            self._nursery.start_soon(self._parts.arrival.then, lane.run)
            self._nursery.start_soon(self._parts.arrival.then, Paying(self._parts, self, lane, self._full).run)

    # ------------------------------------------------------------------------------------- what lanes and payers ask

    def member_at(self, node: NodeId) -> Member | None:
        known = self._parts.cluster_log.registry.current(node)
        return None if known is None else known.member

    def is_alive(self, node: NodeId) -> bool:
        return self._roster.is_believed_alive(node)

    def is_target(self, pending: Pending, member: Member) -> bool:
        rule = self.rule_at(pending.layout, pending.spot)
        return rule is None or member in rule.targets

    def is_replaced(self, pending: Pending) -> bool:
        if not pending.is_settled and self._unsettled.of(name_of(pending.spot)) == [pending]:
            self._settle(pending)
        return pending.is_settled

    async def taken(self, member: Member, pendings: Sequence[Pending]) -> None:
        for pending in pendings:
            self._has(member, pending)
        await self._parts.store.paid([(pending.spot, pending.version, member.node) for pending in pendings])

    def is_unsettled(self, debt: Debt) -> bool:
        return any(pending.version == debt.version for pending in self._unsettled.of(name_of(debt.spot)))

    def has_got(self, member: Member, debt: Debt, *, is_husk: bool = False) -> None:
        for pending in self._unsettled.of(name_of(debt.spot)):
            if pending.version == debt.version and pending.is_stored:
                self._has(member, pending, is_husk=is_husk)

    def _has(self, member: Member, pending: Pending, *, is_husk: bool = False) -> None:
        (pending.left if is_husk else pending.have).add(member)
        if not pending.is_settled:
            rule = self.rule_at(pending.layout, pending.spot)
            if rule is not None and self.is_settled(pending, rule):
                self._settle(pending)

    def due(self, debt: Debt, lane: Lane) -> Due:
        spot = debt.spot
        if not self._parts.keeper.holding.owns(spot.home):
            # Should it come back, all of it is compared.
            return Due.FORGET
        if any(pending.version == debt.version and lane.has(pending) for pending in self._unsettled.of(name_of(spot))):
            return Due.SENT
        layout = self.layout_of(spot.place.scene, spot.place.space)
        if layout == ():
            return Due.FORGET
        rule = None if layout is None else self.rule_at(layout, spot)
        if rule is None or not rule.is_placed:
            return Due.LATER
        return Due.PAY if lane.node in rule.debtors else Due.FORGET


def _apart(arc: Arc | None, taken: Sequence[Arc]) -> list[Arc]:
    """An arc without others, which are in order."""
    left = [] if arc is None else [arc]
    for other in taken:
        left += without(left.pop(), other) if left else []
    return left


def _have(pending: Pending, rule: Rule) -> set[Member]:
    """Who has it: whoever said so, and who is sound without ever having been owed it."""
    unowed = [member for member in rule.sound if member.node not in pending.debtors]
    return pending.have.union(unowed) if unowed else pending.have
