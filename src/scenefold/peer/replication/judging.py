"""What is settled, as holders answer and as it changes who they are (specs/20-copies.md, Writes).

What is known about copies is one value, and each of them is judged by anew: who holds a record today may not be who was to get it.
"""

from __future__ import annotations

from collections.abc import Sequence

import trio

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.peer.copies.segment import Segment
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Doubt, Name, Pending, name_of
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.lane import Lane
from scenefold.peer.replication.paying import Due, Paying
from scenefold.peer.replication.settling_rule import Rule, Rules
from scenefold.store import Spot
from scenefold.store.debts import Debt
from scenefold.wire import Member


class Judging:
    """Used from the Trio thread only. `run` it, or nothing is sent."""

    def __init__(self, parts: Parts, roster: Roster) -> None:
        self._parts = parts
        self._roster = roster
        self._unsettled = parts.unsettled
        self._lanes: dict[NodeId, Lane] = {}
        self._nursery: trio.Nursery | None = None
        self._rules = Rules(parts.keeper.copies)

    async def run(self) -> None:
        """Send, pay, and judge again whatever changes, until cancelled."""
        async with trio.open_nursery() as nursery:
            self._nursery = nursery
            try:
                for lane in self._lanes.values():
                    self._start(lane)
                while True:
                    seen = self._parts.keeper.copies
                    self._judge_all()
                    await self._parts.keeper.copies_changed_after(seen)
            finally:
                # Whoever still answers while this life ends sends nothing any more.
                self._nursery = None

    # -------------------------------------------------------------------------------------------------- questions

    def layout_of(self, scene: SceneId, space: SpaceId) -> Layout | None:
        """() for a space with one copy; None if the scene is unknown here."""
        known = next((known for known in self._parts.scenes.everyone() if known.public.scene == scene), None)
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

    def in_hand(self) -> set[Name]:
        """Of what records there are versions in memory that may still be sent."""
        return {name_of(spot) for lane in self._lanes.values() for spot in lane.in_hand}

    def could_settle(self, rule: Rule, wanted: int) -> bool:
        """Whether those who seem to be there are enough."""
        present = {rule.me, *(target for target in rule.targets if self.is_alive(target.node))}
        return rule.is_settled(present, self.needed(wanted))

    def is_settled(self, pending: Pending, rule: Rule) -> bool:
        needed = self.needed(pending.needed)
        return rule.is_settled(_have(pending, rule), needed if pending.is_write or not rule.is_placed else min(needed, len(rule.placed)))

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
        if rule is None or rule is pending.judged:
            # By the same rule it was sent to all, and is judged with each answer.
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
        for layout in sorted({layout for known in self._parts.scenes.everyone() for layout in known.layouts.values() if layout}):
            self._unsettled.doubt(Doubt(layout, arc, rules=2))

    def doubt_unsafe(self) -> None:
        """Likewise, after a start, where rule 2 may not hold for what is there."""
        for segment in self._parts.keeper.copies.configurations.segments:
            rule = self.rule_of(segment)
            if not rule.is_safe({rule.me, *rule.sound}):
                self._unsettled.doubt(Doubt(segment.layout, segment.arc, rules=1))

    def _judge_all(self) -> None:
        layouts = {known.public.scene: known.layouts for known in self._parts.scenes.everyone()} if len(self._unsettled) else {}
        for pending in self._unsettled:
            if pending.is_settled or not pending.is_stored:
                continue
            layout = layouts.get(pending.spot.place.scene, {}).get(pending.spot.place.space, pending.layout)
            if layout:
                pending.layout = layout
                self.send(pending)
            else:
                self._settle(pending)
        if self._unsettled.doubts:
            for segment in self._parts.keeper.copies.configurations.segments:
                self._judge_doubts(segment)

    def _judge_doubts(self, segment: Segment) -> None:
        rule = self.rule_of(segment)
        have = {rule.me, *rule.sound}
        if rule.is_safe(have):
            self._unsettled.clear(segment.layout, segment.arc, rules=1)
        asked = [found.needed for found in (segment.change, segment.active(rule.me)) if found is not None]
        if asked and rule.is_settled(have, self.needed(max(asked))):
            self._unsettled.clear(segment.layout, segment.arc, rules=2)

    def _settle(self, pending: Pending) -> None:
        for one in self._unsettled.settle(pending):
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
            self._nursery.start_soon(lane.run)
            self._nursery.start_soon(Paying(self._parts, self, lane).run)

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

    def has_got(self, member: Member, debt: Debt) -> None:
        for pending in self._unsettled.of(name_of(debt.spot)):
            if pending.version == debt.version and pending.is_stored:
                self._has(member, pending)

    def _has(self, member: Member, pending: Pending) -> None:
        pending.have.add(member)
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


def _have(pending: Pending, rule: Rule) -> set[Member]:
    """Who has it: whoever said so, and who is sound without ever having been owed it."""
    unowed = [member for member in rule.sound if member.node not in pending.debtors]
    return pending.have.union(unowed) if unowed else pending.have
