"""Faults that only copies survive: nodes and racks that are lost at once, rot on several disks, cuts while copies are mended.

The voter, which alone has the cluster's log and decides for the scene, is never among those that are lost; of several one at a time, as long as the
others can decide, and it comes back. Three founders at least stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import trio

from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.disks import copies_of, place_of
from scenefold.simulation.faults import Fault, Kind
from scenefold.simulation.link_faults import LinkFaults
from scenefold.simulation.senate import is_voter
from scenefold.store.layout import RECORDS, space_of
from scenefold.world.sim import dice

FOR_EVER = 0.6
"""A loss of a greater amount is for ever; of a smaller one nodes come back with empty disks."""
POWER = 0.3
"""A rack of a smaller amount comes back with its disks: it had no power."""
STAY_MIN = 3
SAME = 0.4
"""Share of records that rot on several of the disks."""
LOOK_S = 0.25


class CopiesFaults:
    """Those of a storm. `begins` is told of a fault once it takes effect; `is_over` says whether the storm is."""

    def __init__(
        self, cluster: Cluster, begins: Callable[[Fault], None], is_over: Callable[[], bool], links: LinkFaults, nursery: trio.Nursery
    ) -> None:
        self._cluster = cluster
        self._watch = cluster.watch
        self._begins = begins
        self._is_over = is_over
        self._links = links
        self._nursery = nursery
        self._dice = dice(cluster.net.seed, "faults of copies")

    async def befall(self, fault: Fault) -> None:
        """Make it happen now."""
        match fault.kind:
            case Kind.ROT_ON_SEVERAL:
                self._rot(fault)
            case Kind.CUT_IN_REPAIR:
                await self._cut(fault)
            case _:
                self._lose(fault)

    def _lose(self, fault: Fault) -> None:
        """All of them die at one moment, and then their disks are gone."""
        keeps_disks = fault.kind is Kind.LOST_RACK and fault.amount < POWER
        nodes = [self._cluster.nodes[slot] for slot in fault.slots]
        if not keeps_disks:
            voters = [node for node in nodes if is_voter(self._cluster, node)]
            spared = [node for node in voters if node is not voters[0] or not self._cluster.may_lose(node)]
            nodes = [node for node in nodes if node not in spared]
        nodes = [node for node in nodes if self._cluster.crash(node.slot, silent=True)]
        if not nodes:
            return
        self._begins(fault)
        stay = sum(not node.is_lost for node in self._cluster.founding) - len(nodes)
        is_for_ever = fault.amount > FOR_EVER and stay >= STAY_MIN and not any(is_voter(self._cluster, node) for node in nodes)
        for node in nodes:
            if not keeps_disks:
                self._cluster.wipe(node, "is lost")
            if is_for_ever:
                node.is_lost = True
                self._watch.tell(node.slot, "will never come back")
            else:
                self._nursery.start_soon(self._cluster.restart, node.slot, fault.end_s - fault.begin_s)

    def _rot(self, fault: Fault) -> None:
        """Bits turn over on several disks, most of them in records that have copies, and often in all copies of one but the last."""
        has_begun = False
        for _ in range(int(fault.amount)):
            same = self._key_on_several(fault) if self._dice.random() < SAME else None
            for slot in fault.slots:
                node = self._cluster.nodes[slot]
                kept = [key for key in node.disk.peek(RECORDS) if space_of(key) in self._watch.keeping.rules]
                victim = self._dice.choice(kept) if kept and self._dice.random() < 0.8 else None
                if same is not None:
                    others = [other for other in self._cluster.nodes.values() if other is not node and self._keeps_sound(other, same)]
                    if not (others and self._has_sound(node, same)):
                        continue
                    victim = same
                has_begun = self._rot_one(node, victim, fault, has_begun=has_begun) or has_begun

    def _key_on_several(self, fault: Fault) -> bytes | None:
        """Of a record of which two copies at least lie on disks that are hit."""
        disks = [self._cluster.nodes[slot].disk.peek(RECORDS) for slot in fault.slots]
        found = Counter(key for disk in disks for key in disk if space_of(key) in self._watch.keeping.rules)
        keys = sorted(key for key, count in found.items() if count > 1)
        return self._dice.choice(keys) if keys else None

    def _has_sound(self, node: Node, key: bytes) -> bool:
        return key in node.disk.peek(RECORDS) and not self._watch.rot.has(node.slot, key)

    def _keeps_sound(self, node: Node, key: bytes) -> bool:
        return self._has_sound(node, key) and self._watch.keeping.holds(node.slot, place_of(key))

    def _rot_one(self, node: Node, victim: bytes | None, fault: Fault, *, has_begun: bool) -> bool:
        before = self._watch.records(node.slot)
        key = node.disk.corrupt(RECORDS, self._dice, victim)
        if key is None:
            return False
        if not has_begun:
            self._begins(fault)
        self._watch.damaged(node.slot, key, before)
        return True

    async def _cut(self, fault: Fault) -> None:
        """A partition that lies in wait until copies are being mended somewhere."""
        while not any(_is_mending(node) for node in list(self._cluster.running.values())):  # noqa: ASYNC110 - disks tell nobody
            await trio.sleep(LOOK_S)
        now = self._cluster.net.now
        if not self._is_over():
            await self._links.befall(replace(fault, begin_s=now, end_s=now + fault.end_s - fault.begin_s))


def _is_mending(node: Node) -> bool:
    """Whether somebody is made a holder, or a dead owner's piece recovered."""
    copies = copies_of(node.disk)
    if copies is None:
        return False
    return bool(copies.unrecovered) or any(segment.change is not None for segment in copies.configurations.segments)
