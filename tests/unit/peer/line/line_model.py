"""A small world that drives real holdings, rules and surveys: nodes that crash, messages that are lost, doubled and late.

Only what a node keeps durably survives its crash: its holding and its records (a version for each of sixteen cells).
Each operation is one atomic step of one node, so every interleaving of steps is a run of this model. `check` states the
invariants of specs/12-line.md; line_calm ends all faults and asks for a tiled line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, arcs_between
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Handover, Holding, Step, handover_id
from scenefold.peer.line.holding_note import encode_holding
from scenefold.peer.line.rules import Bound, bound_for, neighbour_on, side_of_giver
from scenefold.peer.line.survey import Unsettled, surveys
from scenefold.wire import Member
from unit.peer.line.line_nodes import (
    CELLS,
    Message,
    Node,
    Search,
    View,
    arc_of_cells,
    cells_of,
    even_right_bounds_of_cells,
    place_of,
)

MESSAGES_MAX = 48


class Model:
    """Operations answer True if they did something; whoever chooses them need not know what is possible."""

    def __init__(self, founders: int = 3) -> None:
        ids = [NodeId(number * 10) for number in range(1, founders + 1)]
        members = {node: Member(node, bytes([1]) * 16) for node in ids}
        self.views = [View(1, tuple(ids), members)]
        self.nodes: dict[Member, Node] = {}
        for node, arc in zip(ids, arcs_between(even_right_bounds_of_cells(founders)), strict=True):
            self.nodes[members[node]] = Node(members[node], 1, encode_holding(Holding().found(arc)), leased=True)
        self.messages: list[Message] = []
        self.version = 0
        self.serial = 0
        self.acknowledged: dict[int, int] = {}
        self.counts: dict[str, int] = {}

    # ------------------------------------------------------------------------------------------------ the log

    @property
    def head(self) -> View:
        return self.views[-1]

    def view(self, node: Node) -> View:
        return self.views[node.position - 1]

    def alive(self) -> list[Node]:
        return list(self.nodes.values())

    def registered(self) -> list[Node]:
        return [self.nodes[self.head.members[node]] for node in self.head.order]

    def join(self, node: NodeId, left_of: int) -> bool:
        head = self.head
        if node in head.order or len(head.order) >= 6:
            return False
        incarnations = sum(member.node == node for member in self.nodes)
        member = Member(node, bytes([1 + incarnations]) * 16)
        before = [old for old in self.nodes.values() if old.member.node == node]
        rank = left_of % len(head.order)
        order = (*head.order[:rank], node, *head.order[rank:])
        self.views.append(replace(head, position=head.position + 1, order=order, members={**head.members, node: member}))
        newcomer = Node(member, head.position + 1, encode_holding(Holding()))
        if before:
            # The disk comes along, without the arc: all of it is strays.
            newcomer.records = before[-1].records
            before[-1].records = {}
            before[-1].keep(Holding())
            before[-1].crash()
        self.nodes[member] = newcomer
        return True

    def remove(self, index: int) -> bool:
        head = self.head
        if len(head.order) < 2:
            return False
        return self._remove(head.members[head.order[1 + index % (len(head.order) - 1)]])

    def remove_receiver(self, index: int) -> bool:
        """Of a piece that is on its way."""
        steps = [found for node in self.registered() for _, found in node.holding.handovers if found.step is Step.RELEASED]
        peers = [found.peer for found in steps if self.head.is_current(found.peer) and found.peer.node != self.head.order[0]]
        return bool(peers) and self._remove(peers[index % len(peers)])

    def _remove(self, member: Member) -> bool:
        head, node = self.head, member.node
        order = tuple(other for other in head.order if other != node)
        members = {other: known for other, known in head.members.items() if other != node}
        self.views.append(View(head.position + 1, order, members, (*head.removals, member)))
        self._lose_with(self.nodes[member])
        return True

    def _lose_with(self, removed: Node) -> None:
        """One copy: what it owned may be lost, and what it had released. What others have released to it they keep."""
        lost = set(cells_of(removed.holding.arc))
        for _, handover in removed.holding.handovers:
            taken = self.nodes[handover.peer].holding.find(handover.id)
            if handover.step is Step.RELEASED and (taken is None or taken[1].step is not Step.TAKEN):
                lost |= set(cells_of(handover.piece))
        for giver in self.registered():
            for _, handover in giver.holding.handovers:
                if handover.step is Step.RELEASED and handover.peer == removed.member:
                    self._fall_back(giver, handover)
                    lost -= set(cells_of(handover.piece))
        for cell in lost:
            self.acknowledged.pop(cell, None)

    def _fall_back(self, giver: Node, handover: Handover) -> None:
        """What the receiver has written there itself may be lost with it; the giver's versions may not."""
        for cell in set(cells_of(handover.piece)) & set(self.acknowledged):
            kept = min(self.acknowledged[cell], giver.records.get(cell, 0))
            self.acknowledged[cell] = kept
            if not kept:
                del self.acknowledged[cell]

    def learn(self, node: Node, position: int) -> bool:
        reached = min(position, self.head.position)
        if reached <= node.position:
            return False
        node.position = reached
        if node.search is not None and not node.search.done:
            node.search = None
        return True

    def grant(self, node: Node) -> bool:
        node.leased = node.leased or (node.position == self.head.position and self.head.is_current(node.member))
        return node.leased

    def end_leases(self) -> bool:
        """T_wait goes by: whoever is removed has no lease any more."""
        for member in self.head.removals:
            self.nodes[member].leased = False
        return True

    def adoptable(self, node: Node, gap: Arc, revision: int) -> Arc | None:
        """What of a gap may be adopted as far as leases go: all of it, or what was seen before the last ones were removed."""
        removals = self.view(node).removals
        seen = None if node.holding.arc is None else node.sightings.see(gap, revision, len(removals))
        if not self._any_leased(removals):
            return gap
        if seen is None or self._any_leased(removals[: int(seen.moment)]):
            return None
        self.counts["adopted as seen"] = self.counts.get("adopted as seen", 0) + 1
        return seen.gap

    def _any_leased(self, members: Sequence[Member]) -> bool:
        return any(self.nodes[member].leased for member in members)

    # ---------------------------------------------------------------------------------------------- durable steps

    def change(self, node: Node, transition: Callable[[Holding], Holding]) -> bool:
        """One durable change, as the node's keeper makes it: what the log has ended goes first."""
        before = node.holding
        try:
            after = transition(before.drop_removed(self.view(node).removals.__contains__))
        except Refused:
            return False
        node.keep(after)
        return after != before

    def write(self, node: Node, cell: int) -> bool:
        holding = node.holding
        frozen = any(place_of(cell) in handover.piece for _, handover in holding.handovers if handover.id in node.frozen)
        if not (node.leased and holding.owns(place_of(cell))) or frozen:
            return False
        for other in self.nodes.values():
            assert other is node or not (other.leased and other.holding.owns(place_of(cell))), f"two nodes acknowledge cell {cell}"
        self.version += 1
        node.records[cell] = self.version
        if self.head.is_current(node.member):
            self.acknowledged[cell] = self.version
        return True

    def offer(self, node: Node, side: Side, count: int) -> bool:
        holding = node.holding
        cells = cells_of(holding.arc)
        if not node.leased or not cells:
            return False
        count = 1 + count % len(cells)
        piece = arc_of_cells(cells[-count], cells[-1]) if side is Side.RIGHT else arc_of_cells(cells[0], cells[count - 1])
        try:
            peer = neighbour_on(self.view(node), node.member.node, side)
        except Refused:
            return False
        self.serial += 1
        return self.change(
            node,
            lambda now: now.offer(handover_id(now.revision + 1, self.serial.to_bytes(8, "big")), side, peer, piece),
        )

    def withdraw(self, node: Node, side: Side) -> bool:
        handover = node.holding.on(side)
        if handover is None or handover.step is not Step.OFFERED:
            return False
        self.send(node, handover.peer, "drop", handover.id)
        return self.change(node, lambda now: now.withdraw(handover.id))

    def freeze(self, node: Node, side: Side) -> bool:
        handover = node.holding.on(side)
        if handover is None or handover.step is not Step.OFFERED:
            return False
        node.frozen ^= {handover.id}
        return True

    def release(self, node: Node, side: Side) -> bool:
        handover = node.holding.on(side)
        if handover is None or handover.step is not Step.OFFERED or handover.id not in node.frozen or not node.leased:
            return False
        answered = node.answered.get(handover.id)
        if answered is None or any((cell, node.records[cell]) not in answered for cell in cells_of(handover.piece) if cell in node.records):
            return False
        return self.change(node, lambda now: now.release(handover.id))

    def pass_on(self, node: Node, side: Side, count: int) -> bool:
        """Give an end of the arc, at once up to the release."""
        if node.holding.on(side) is not None or not self.offer(node, side, count):
            return False
        peer = node.holding.on(side)
        assert peer is not None
        self.grant(self.nodes[peer.peer])
        self.prod(node, side)
        self.deliver(-1, keep=False)
        self.deliver(-1, keep=False)
        for cell in range(CELLS):
            if self.copy(node, side, cell):
                self.deliver(-1, keep=False)
                self.deliver(-1, keep=False)
        self.freeze(node, side)
        return self.release(node, side)

    def take_back(self, node: Node, side: Side) -> bool:
        handover = node.holding.on(side)
        if handover is None or not node.leased or self.nodes[handover.peer].leased:
            return False
        done = self.change(node, lambda now: now.take_back(handover.id, self.view(node).removals.__contains__))
        self.counts["taken back"] = self.counts.get("taken back", 0) + done
        return done

    def delete(self, node: Node, side: Side) -> bool:
        handover = node.holding.on(side)
        if handover is None or handover.step is not Step.GIVEN:
            return False
        holding = node.holding
        gone = [cell for cell in cells_of(handover.piece) if cell in node.records and not holding.owns(place_of(cell))]
        for cell in gone[:2]:
            del node.records[cell]
        return bool(gone)

    # ----------------------------------------------------------------------------------------------------- sending

    def send(self, source: Node, target: Member, kind: str, body: Any) -> None:
        if target in self.nodes:
            self.messages.append(Message(target, source.member, kind, body))
            del self.messages[:-MESSAGES_MAX]

    def prod(self, node: Node, side: Side) -> bool:
        """Say (again) what the durable step asks for."""
        handover = node.holding.on(side)
        match handover:
            case Handover(step=Step.OFFERED):
                self.send(node, handover.peer, "offer", (handover, node.position))
            case Handover(step=Step.RELEASED):
                self.send(node, handover.peer, "claim", handover)
            case Handover(step=Step.GIVEN):
                if any(cell in node.records for cell in cells_of(handover.piece)):
                    return False
                self.send(node, handover.peer, "drop", handover.id)
            case Handover():
                self.send(node, handover.peer, "drop?", handover.id)
            case None:
                return False
        return True

    def copy(self, node: Node, side: Side, cell: int) -> bool:
        handover = node.holding.on(side)
        if handover is None or handover.step is not Step.OFFERED or cell not in node.records or place_of(cell) not in handover.piece:
            return False
        self.send(node, handover.peer, "copy", (handover.id, cell, node.records[cell]))
        return True

    def hand(self, node: Node, index: int) -> bool:
        strays = node.strays()
        owners = [other for other in self.nodes.values() if strays and other.holding.owns(place_of(strays[index % len(strays)]))]
        if not owners:
            return False
        cell = strays[index % len(strays)]
        self.send(node, owners[index % len(owners)].member, "hand", (cell, node.records[cell]))
        return True

    def seek(self, node: Node, which: int) -> bool:
        """Begin a survey, or ask the next node again, or adopt what it found."""
        search = node.search
        view = self.view(node)
        if not (node.leased and view.is_current(node.member)):
            return False
        if search is None:
            self.change(node, lambda now: now)
            found = surveys(node.holding, view, node.member.node)
            if not found:
                return False
            node.search = Search(found[which % len(found)], node.position, node.holding.revision)
            self._advance(node, node.search, None)
            return True
        if not search.done:
            assert search.asked is not None
            self.send(node, view.members[search.asked], "bound?", (search.serial, search.position))
            return True
        node.search = None
        gap = search.gap
        part = None if gap is None or search.position != node.position else self.adoptable(node, gap, search.revision)
        return part is not None and self.change(node, lambda now: now.adopt(part, revision=search.revision))

    def _advance(self, node: Node, search: Search, bound: Bound | None) -> None:
        try:
            search.asked = next(search.survey) if bound is None else search.survey.send(bound)
            self.serial += 1
            search.serial = self.serial
        except StopIteration as end:
            search.gap, search.done, search.asked = end.value, True, None
        except Unsettled:
            node.search = None

    # --------------------------------------------------------------------------------------------------- receiving

    def deliver(self, index: int, *, keep: bool) -> bool:
        if not self.messages:
            return False
        index %= len(self.messages)
        message = self.messages[index]
        if not keep:
            del self.messages[index]
        node = self.nodes[message.target]
        getattr(self, "_on_" + message.kind.replace("?", "_asked"))(node, message)
        self.counts[message.kind] = self.counts.get(message.kind, 0) + 1
        return True

    def _on_offer(self, node: Node, message: Message) -> None:
        handover, position = message.body
        self.learn(node, position)
        if not node.leased:
            return

        def note(now: Holding) -> Holding:
            side = side_of_giver(self.view(node), node.member, message.source, message.target)
            return now.note(handover.id, side, message.source, handover.piece)

        self.change(node, note)
        found = node.holding.find(handover.id)
        if found is not None and found[1].step is Step.NOTED:
            self.send(node, message.source, "noted", handover.id)

    def _on_noted(self, node: Node, message: Message) -> None:
        node.answered.setdefault(message.body, set())

    def _on_copy(self, node: Node, message: Message) -> None:
        handover, cell, version = message.body
        found = node.holding.find(handover)
        if found is not None and found[1].step is Step.NOTED and found[1].peer == message.source:
            node.records[cell] = max(node.records.get(cell, 0), version)
            self.send(node, message.source, "copied", message.body)

    def _on_copied(self, node: Node, message: Message) -> None:
        handover, cell, version = message.body
        # An answer counts only in the life of the process that asked.
        if node.holding.find(handover) is not None:
            node.answered.setdefault(handover, set()).add((cell, version))

    def _on_claim(self, node: Node, message: Message) -> None:
        handover: Handover = message.body
        if not node.leased:
            return
        self.change(node, lambda now: now.claim(handover.id, handover.piece))
        found = node.holding.find(handover.id)
        if found is not None and found[1].step is Step.TAKEN:
            self.send(node, message.source, "claimed", handover.id)

    def _on_claimed(self, node: Node, message: Message) -> None:
        found = node.holding.find(message.body)
        confirmed = self.change(node, lambda now: now.confirm(message.body, self.view(node).removals.__contains__))
        peer = None if found is None or not confirmed else found[1].peer
        if found is not None and peer in self.head.removals and peer not in self.view(node).removals:
            # The receiver was its owner, and was removed before this node could know.
            for cell in cells_of(found[1].piece):
                self.acknowledged.pop(cell, None)

    def _on_drop(self, node: Node, message: Message) -> None:
        self.change(node, lambda now: now.drop(message.body))
        if node.holding.find(message.body) is None:
            self.send(node, message.source, "dropped", message.body)

    def _on_dropped(self, node: Node, message: Message) -> None:
        self.change(node, lambda now: now.finish(message.body))

    def _on_drop_asked(self, node: Node, message: Message) -> None:
        if node.holding.find(message.body) is None:
            self.send(node, message.source, "unknown", message.body)

    def _on_unknown(self, node: Node, message: Message) -> None:
        self.change(node, lambda now: now.drop(message.body))

    def _on_bound_asked(self, node: Node, message: Message) -> None:
        serial, position = message.body
        self.learn(node, position)
        self.change(node, lambda now: now)
        if not node.leased:
            return
        try:
            bound = bound_for(node.holding, self.view(node), node.member, message.source, position)
        except Refused as refusal:
            self.send(node, message.source, "behind", (serial, node.position, refusal))
            return
        self.send(node, message.source, "bound", (serial, bound))

    def _on_behind(self, node: Node, message: Message) -> None:
        self.learn(node, message.body[1])

    def _on_bound(self, node: Node, message: Message) -> None:
        serial, bound = message.body
        if node.search is not None and not node.search.done and node.search.serial == serial:
            self._advance(node, node.search, bound)

    def _on_hand(self, node: Node, message: Message) -> None:
        cell, version = message.body
        holding = node.holding
        frozen = any(place_of(cell) in handover.piece for _, handover in holding.handovers if handover.id in node.frozen)
        if node.leased and holding.owns(place_of(cell)) and not frozen:
            node.records[cell] = max(node.records.get(cell, 0), version)
            self.send(node, message.source, "handed", message.body)

    def _on_handed(self, node: Node, message: Message) -> None:
        cell, version = message.body
        if cell in node.strays() and node.records[cell] == version:
            del node.records[cell]

    # ------------------------------------------------------------------------------------------------- invariants

    def check(self) -> None:
        registered = self.registered()
        owners: dict[int, Node] = {}
        last = -1
        for node in registered:
            for cell in cells_of(node.holding.arc):
                assert cell not in owners, f"cell {cell} is in two durable arcs"
                assert cell > last, "arcs do not ascend in the order of the log"
                owners[cell], last = node, cell
        for cell, version in self.acknowledged.items():
            owner = owners.get(cell)
            if owner is not None:
                assert owner.records.get(cell, 0) >= version, f"the owner of cell {cell} lacks its acknowledged version"
                continue
            givers = [(node, found) for node in registered for _, found in node.holding.handovers if found.step is Step.RELEASED]
            under_way = [(node, found) for node, found in givers if place_of(cell) in found.piece]
            assert under_way, f"nobody answers for cell {cell}, and nobody was removed"
            for giver, found in under_way:
                assert giver.records.get(cell, 0) >= version, f"cell {cell} was deleted before it was claimed"
                if self.head.is_current(found.peer):
                    assert self.nodes[found.peer].records.get(cell, 0) >= version, f"cell {cell} was released before it was durable"
