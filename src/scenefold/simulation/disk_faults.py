"""What disks do to nodes: bits that turn over, no room, empty disks, backups put back (specs/17-simulation.md, Faults).

A disk loses what was acknowledged, so the observer is told exactly what lay there before, and after.
"""

from __future__ import annotations

from collections.abc import Callable

import trio

from scenefold.peer.cluster_log.lives import Lives
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.disks import arc_of, granted_life, has_open_handover, incarnation_of, keys_outside, lives_of
from scenefold.simulation.faults import Fault, Kind
from scenefold.simulation.overlaps import Overlaps
from scenefold.simulation.rotting import TableRot
from scenefold.store.layout import RECORDS
from scenefold.world.sim import dice

RESERVE_LEFT_BYTES = 128 << 20
"""Half of a store's reserve: new records are refused, what may use the reserve goes on."""
NO_BYTE, NO_BYTE_AND_ROT = 0.5, 0.75
"""A full disk of a greater amount has no byte free; of one greater still, when a stray lies there, which rots."""
STRAY_LOOK_S = 0.2
"""Between two looks for one: it stays for a second at least before it is brought home."""

RECORDED_LOOK_S, RECORDED_LOOKS_MAX = 0.5, 40
"""For a node that was restarted to be granted a lease: it may be cut off, or the voter down."""

UNTOLD_S = 8.0
"""So long every second node that starts from a backup cannot reach the voter, which would tell it so at once."""

HANDOVER_STEPS_MAX = 5
"""A backup that is made at a step of a handover is made at one of so many that the node takes from then on."""


class DiskFaults:
    """Those of a storm. `begins` and `ends` are told of a fault once it takes effect; `is_over` says whether the storm is."""

    def __init__(
        self, cluster: Cluster, begins: Callable[[Fault], None], ends: Callable[[Fault], None], is_over: Callable[[], bool]
    ) -> None:
        self._cluster = cluster
        self._watch = cluster.watch
        self._begins = begins
        self._ends = ends
        self._is_over = is_over
        self._dice = dice(cluster.net.seed, "storm")
        self._table_rot = TableRot(cluster)
        self._fills: Overlaps[int] = Overlaps()
        self._at_step: dict[int, trio.Event] = {}

    async def befall(self, fault: Fault) -> None:
        """Make it happen now."""
        match fault.kind:
            case Kind.CORRUPTION:
                await self._corrupt(fault)
            case Kind.DISK_FULL:
                await self._fill(fault)
            case Kind.WIPED_DISK:
                await self._wipe(fault)
            case _:
                await self._restore(fault)

    def handover_moves(self, slot: int) -> None:
        """A step of a handover has become durable there, just now."""
        self._at_step.pop(slot, trio.Event()).set()

    async def _step_of_handover(self, slot: int, count: int, end_s: float) -> None:
        """Return at the n-th from now on, if it comes in time."""
        with trio.move_on_at(end_s):
            for _ in range(count):
                await self._at_step.setdefault(slot, trio.Event()).wait()

    async def _fill(self, fault: Fault) -> None:
        """Others fill a disk; half of those that are filled to the last byte are so once a stray lies there, which rots."""
        node, reach = self._cluster.nodes[fault.slots[0]], self._watch.reach
        stray = None
        if fault.amount > NO_BYTE_AND_ROT:
            stray = await self._stray_of(node)
        if self._is_over():
            return
        self._begins(fault)
        self._fills.begin(node.slot, fault)
        self._fill_as_told(node)
        reach.hampered(node.slot, self._cluster.net.now)
        if stray is not None:
            before = self._watch.records(node.slot)
            node.disk.corrupt(RECORDS, self._dice, stray)
            self._watch.damaged(node.slot, stray, before)
        await trio.sleep(fault.end_s - fault.begin_s)
        if not self._is_over():
            self._fills.end(node.slot, fault)
            self._fill_as_told(node)
            reach.relieved(node.slot, self._cluster.net.now)
            self._ends(fault)

    def _fill_as_told(self, node: Node) -> None:
        amount = self._fills.worst(node.slot)
        node.disk.fill(None if amount is None else 0 if amount > NO_BYTE else RESERVE_LEFT_BYTES)

    async def _stray_of(self, node: Node) -> bytes:
        """The key of a record that is none of its node's, nor on its way, once one lies where that runs."""
        while True:
            # Where it does not run it cannot begin on a full disk either.
            is_calm = node.slot in self._cluster.running and not has_open_handover(node.disk)
            if is_calm and (strays := keys_outside(node.disk, arc_of(node.disk))):
                return strays[0]
            await trio.sleep(STRAY_LOOK_S)

    async def _corrupt(self, fault: Fault) -> None:
        """Bits of records turn over, and rarely one of what the store keeps beside them."""
        node, has_begun = self._cluster.nodes[fault.slots[0]], False
        for _ in range(int(fault.amount)):
            before = self._watch.records(node.slot)
            key = node.disk.corrupt(RECORDS, self._dice)
            if key is None:
                break
            if not has_begun:
                self._begins(fault)
            has_begun = True
            self._watch.damaged(node.slot, key, before)
        if self._table_rot.strike(node):
            if not has_begun:
                self._begins(fault)
            await self._table_rot.until_noticed(node)

    async def _wipe(self, fault: Fault) -> None:
        """The machine dies, and comes back with an empty disk."""
        node = self._cluster.nodes[fault.slots[0]]
        if not self._cluster.may_lose(node) or not self._cluster.crash(node.slot):
            return
        self._begins(fault)
        self._cluster.wipe(node, "loses its disk")
        await self._cluster.restart(node.slot, fault.end_s - fault.begin_s)

    async def _restore(self, fault: Fault) -> None:
        """A backup is made, half of them at a step of a handover, and the node works on; later its disk is the backup again.

        Restored is only what the voter can tell from the node itself. A start in between makes it so at once, and every second
        node is started again right after the backup; the passing of a minute does, too.
        """
        node = self._cluster.nodes[fault.slots[0]]
        if fault.begin_s % 0.5 < 0.25:
            count = 1 + int(fault.begin_s * 1000) % HANDOVER_STEPS_MAX
            await self._step_of_handover(node.slot, count, (fault.begin_s + fault.end_s) / 2)
        if node.has_left or incarnation_of(node.disk) is None:
            return
        backup, incarnation, lives = node.disk.snapshot(), incarnation_of(node.disk), lives_of(node.disk)
        if fault.begin_s % 1 < 0.5 and self._cluster.crash(node.slot):
            await self._cluster.restart(node.slot, 0.2)
        await trio.sleep_until(fault.end_s)
        if not (self._is_over() or self._has_lived_on(node, incarnation, lives)) and self._cluster.crash(node.slot):
            await self._cluster.restart(node.slot, 0.2)
            for _ in range(RECORDED_LOOKS_MAX):
                if self._has_lived_on(node, incarnation, lives):
                    break
                await trio.sleep(RECORDED_LOOK_S)
        if self._is_over() or node.has_left or not self._has_lived_on(node, incarnation, lives):
            return
        was_up = self._cluster.crash(node.slot)
        self._begins(fault)
        before = self._watch.records(node.slot)
        node.disk.restore(backup)
        self._watch.disk_replaced(node.slot, before, incarnation, "is put back to a backup")
        if was_up and fault.end_s % 0.5 < 0.25:
            await self._start_untold(node)
        elif was_up:
            await self._cluster.restart(node.slot, 0.5)

    async def _start_untold(self, node: Node) -> None:
        net, reach, voter = self._cluster.net, self._watch.reach, self._cluster.voter
        net.cut(voter.address, node.address)
        reach.cut(voter.slot, node.slot, net.now)
        await self._cluster.restart(node.slot, 0.5)
        await trio.sleep(UNTOLD_S)
        if not self._is_over():
            net.mend(voter.address, node.address)
        reach.mended(voter.slot, node.slot, net.now)

    def _has_lived_on(self, node: Node, incarnation: bytes | None, lives: Lives) -> bool:
        """Whether the node was granted a life that is not among these, and is still of this incarnation."""
        granted = granted_life(self._cluster.voter.disk, node.node_id)
        return incarnation_of(node.disk) == incarnation and granted is not None and granted[0] == incarnation and granted[1] not in lives
