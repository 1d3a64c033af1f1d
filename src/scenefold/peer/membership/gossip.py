"""Statuses from node to node over UDP, packets 1 and 2 (thesis B.2.2, C.1; specs/11-peers.md, Gossip).

Once a second, with probability 1/N, a node sends its own signed status to every other member, and as much of its table
as fits one datagram. Whoever is not heard yet is asked (RequestState), a few at a time, so that a table of a small
cluster is complete within a round trip; a large one is fetched whole (tables.py). Who seems dead is asked likewise
(`probe`).

What is believed of what is heard: hearing.py. An answer goes to the certified address of who asked, so a repeated
question gains little; so that a small one repeated is no flood of large ones, who asks again and again is answered only
so often.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from functools import partial

import trio

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.location import Arc, tiles
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.datagrams import SealedDatagrams
from scenefold.peer.membership.answering import Answering
from scenefold.peer.membership.hearing import Hearing
from scenefold.peer.membership.knocking import KNOCK_S_MAX, KNOCKS_MAX, Knocks
from scenefold.peer.membership.pages import Pages
from scenefold.peer.membership.proofs import PROBE_PAUSES_S, Proofs
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.signs import Signs
from scenefold.peer.membership.status import TELL_S, OwnStatus, arc_of_status, is_news
from scenefold.peer.membership.throws import ROUND_S
from scenefold.peer.waiters import Waiters
from scenefold.wire import (
    MalformedPacket,
    Packet,
    PingBroadcast,
    RequestProof,
    RequestPublicKey,
    RequestState,
    ReturnProof,
    Status,
    encode_packet,
)
from scenefold.world import Priority, QuietLog, World
from scenefold.world.facts import ClusterFacts
from scenefold.world.surviving import surviving

KNOCK_SPREAD_S = 0.002
"""For each member: a newcomer is asked by everybody, but not by all of them in the same moment."""

_log = logging.getLogger("scenefold.peer.membership.gossip")


class Gossip:
    """Hears and speaks on the high-priority UDP port of one node. Keeps the roster at the members of the cluster's log."""

    def __init__(
        self,
        world: World,
        own: OwnStatus,
        roster: Roster,
        cluster_log: ClusterLog,
        facts: ClusterFacts,
        seeds: Iterable[str] = (),
    ) -> None:
        self._world = world
        self._own = own
        self._roster = roster
        self._cluster_log = cluster_log
        self._me = address_of(own.me)
        self._seeds = {seed: node_id_of(seed) for seed in seeds if seed != self._me}
        self._waiters = Waiters()
        self._quiet = QuietLog(_log)
        self._members_changed = trio.Event()
        self._hearing = Hearing(world, own, roster, cluster_log, facts)
        self._datagrams = SealedDatagrams(
            world, own.me, facts.cluster_id, Priority.HIGH, own.secrets.sealing, self._hearing.sealing_key_of, _log
        )
        self.proofs = Proofs(world.clock, own, self._tell, self._hearing.key_of)
        self._pages = Pages(own, roster)
        self.answering = Answering(world.clock, own, self._pages, self.proofs, self._send)
        self._met_at: dict[NodeId, float] = {}
        self._knocks = Knocks(facts.voter, world.entropy.uniform)
        roster.tell_position = cluster_log.heard_of

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Gossip until cancelled. Started once the port is open; LocalFault if it cannot be had."""
        await self._datagrams.open()
        self._roster.set_members(self._cluster_log.registry, self._world.clock.now())
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._follow_log)
                nursery.start_soon(self._listen)
                nursery.start_soon(self._speak)
                nursery.start_soon(self._knock)
                task_status.started()
        finally:
            with trio.CancelScope(shield=True):
                await self._datagrams.aclose()

    # ------------------------------------------------------------------------------------------------- who waits

    async def everybody_heard(self) -> None:
        """Return once the log names members, every founder among them, and a status of each is known."""
        await self._waiters.until(
            lambda: self._cluster_log.registry.position > 0 and not self._roster.unheard_count + self._roster.vacant_count
        )

    def is_line_tiled(self) -> bool:
        """Whether what the members say of their arcs, and the seats that founders still may take, tile the line. O(N log N)."""
        registry = self._cluster_log.registry
        arcs = [registry.founding_arc(node) for node in registry.order if registry.vacant_seat(node) is not None]
        return tiles(filter(None, [self._own.arc, *arcs, *map(arc_of_status, self._roster.statuses())]))

    async def somebody_heard(self) -> None:
        """Return once any other node of the cluster has spoken; at once if the log names none."""
        await self._waiters.until(lambda: bool(self._met_at) or (self._cluster_log.registry.position > 0 and self._roster.count == 1))

    async def a_seed_heard(self) -> None:
        """Return once a seed has spoken; at once if there is none but this node."""
        await self._waiters.until(lambda: len(self._silent_seeds()) < max(1, len(self._seeds)))

    async def many_unheard(self, few: int) -> None:
        """Return once somebody has spoken, and statuses of more than `few` members are lacking."""
        await self._waiters.until(lambda: bool(self._met_at) and self._roster.unheard_count > few)

    @property
    def seeds(self) -> Sequence[str]:
        """The seeds other than this node."""
        return tuple(self._seeds)

    def met(self) -> list[NodeId]:
        """The nodes that have spoken to us since the start, members or not, in id order."""
        return sorted(self._met_at)

    def met_at(self, node: NodeId) -> float | None:
        """Local time of the last datagram of a node that counted, as member or not; None if there was none."""
        return self._met_at.get(node)

    async def probe(self, member: NodeId) -> bool:
        """Ask a node whether it is there, up to three times within about 2 s; True if it says something itself."""
        proofs, asked_at = self._roster.proofs(member), self._world.clock.now()

        def has_answered() -> bool:
            # A founder without an incarnation has no status that could count: that it speaks at all is the answer.
            if self._roster.incarnation(member) is None:
                return self._met_at.get(member, -math.inf) >= asked_at
            return self._roster.proofs(member) > proofs

        for pause_s in PROBE_PAUSES_S:
            await self._ask(member)
            with trio.move_on_after(pause_s):
                await self._waiters.until(has_answered)
            if has_answered():
                return True
        return False

    async def take_table(self, statuses: Sequence[Status], source: NodeId) -> int:
        """Take a whole table that a member has sent; the number of signs of life in it."""
        taken = await self._hearing.take_table(statuses, source)
        self._waiters.tell()
        return taken

    @property
    def dropped(self) -> int:
        """Datagrams that did not count, statuses that did not verify or claimed what is ours, since the start."""
        return self._hearing.dropped + self._datagrams.dropped.total()

    @property
    def signs(self) -> Signs:
        """Signs that somebody means harm."""
        return self._hearing.signs

    # --------------------------------------------------------------------------------------------------- speaking

    async def _follow_log(self) -> None:
        registry = self._cluster_log.registry
        while True:
            self._take_members(registry)
            changed, self._members_changed = self._members_changed, trio.Event()
            changed.set()
            self._waiters.tell()
            registry = await self._cluster_log.changed_after(registry.position)

    def _take_members(self, registry: Registry) -> None:
        """Who comes after us into a large cluster tells everybody of itself, and is asked only if that was lost."""
        roster, now = self._roster, self._world.clock.now()
        had_log, had = roster.position > 0, set(roster.unheard())
        roster.set_members(registry, now)
        self._hearing.log_grew()
        is_large = had_log and roster.count > KNOCKS_MAX
        come = [node for node in roster.unheard() if node not in had] if is_large else []
        self._knocks.spare(come, now + roster.count * TELL_S + 2 * ROUND_S, roster.unheard())

    async def _speak(self) -> None:
        """Throw the dice, once a second; and say at once, within bounds, that the own arc, blacklist or fill has changed."""
        said: tuple[Arc | None, int, bool] = None, 0, False
        said_used = 0
        tell_from: float | None = None
        while True:
            await self._world.clock.sleep(ROUND_S)
            if not self._cluster_log.registry.is_current(self._own.member):
                continue
            now = self._world.clock.now()
            if tell_from is None:
                # All nodes of a cluster may have started at once: in a large one, the first telling comes at a moment of chance.
                tell_from = now - ROUND_S + self._world.entropy.uniform() * self._roster.count * TELL_S
            if self._world.entropy.uniform() * self._roster.count < 1:
                self._roster.count_broadcast(())
                data = self._pages.page(0)
            elif now >= tell_from and (
                (self._own.arc, self._own.blacklist.version, self._own.recovers) != said
                or self._hearing.is_contested
                or is_news(said_used, self._own.fill[0])
            ):
                # Under another request id than 0, since it is no throw of the dice.
                data = encode_packet(PingBroadcast((self._own.signed(),), request_id=1))
                tell_from = now + self._roster.count * TELL_S
            else:
                continue
            said = self._own.arc, self._own.blacklist.version, self._own.recovers
            said_used, self._hearing.is_contested = self._own.fill[0], False
            members = list(self._roster.peers)
            await self._datagrams.prepare(members)
            for member in members:
                await self._datagrams.send(data, member)

    async def _knock(self) -> None:
        """Ask who has not been heard, seeds included: they know others, even where the log names no member yet."""
        while True:
            members_changed = self._members_changed
            due, pause_s = self._knocks.due(self._roster.unheard(), self._silent_seeds(), self._world.clock.now())
            for address in due:
                await self._ask(node_id_of(address))
            with trio.move_on_after(pause_s):
                await self._waiters.until(partial(self._is_to_look_again, members_changed))
            if members_changed.is_set():
                spread_s = min(KNOCK_S_MAX, self._roster.count * KNOCK_SPREAD_S)
                await self._world.clock.sleep(self._world.entropy.uniform() * spread_s)

    def _is_to_look_again(self, members_changed: trio.Event) -> bool:
        """Others are to be asked: the members have changed, or a table has left only those few that can all be asked."""
        return members_changed.is_set() or self._knocks.is_over_soon(self._roster.unheard_count)

    def _silent_seeds(self) -> list[str]:
        return [seed for seed, node in self._seeds.items() if node not in self._met_at]

    async def _ask(self, node: NodeId) -> None:
        await self._tell(RequestState(request_id=1, mini_status=self._own.mini()), node)

    # ---------------------------------------------------------------------------------------------------- hearing

    async def _listen(self) -> None:
        while True:
            sender, data = await self._datagrams.receive()
            try:
                packet = self._hearing.packet_of(data)
            except MalformedPacket as problem:
                self._hearing.drop(address_of(sender), "malformed", f"a datagram is dropped: {problem}")
                continue
            now = self._met_at[sender] = self._world.clock.now()
            with surviving(self._quiet, now, address_of(sender)):
                await self._hear(packet, sender)
            self._waiters.tell()

    async def _hear(self, packet: Packet, sender: NodeId) -> None:
        if isinstance(packet, PingBroadcast):
            self._hearing.hear(packet, sender)
        elif isinstance(packet, RequestState):
            await self._answer(packet, sender)
        elif isinstance(packet, RequestPublicKey):
            await self.answering.tell_key(packet, sender)
        elif isinstance(packet, RequestProof):
            self._hear_mini(packet, sender)
            await self.answering.prove(packet, sender)
        elif isinstance(packet, ReturnProof):
            self._hear_mini(packet, sender)
            self.proofs.heard(packet, sender)
        else:
            self._hearing.drop(address_of(sender), "unexpected", f"a {type(packet).__name__} has no business here")

    async def _answer(self, packet: RequestState, sender: NodeId) -> None:
        self._hear_mini(packet, sender)
        if await self.answering.tell_table(packet, sender) and self._roster.is_unheard(sender):
            # It lives, but has said nothing of itself yet. It has heard us by then, so this ends here.
            await self._ask(sender)

    def _hear_mini(self, packet: Packet, sender: NodeId) -> None:
        if packet.mini_status is not None and packet.mini_status.node == sender:
            self._roster.hear_mini(packet.mini_status, self._world.clock.now())

    async def _send(self, data: bytes, target: NodeId) -> None:
        await self._datagrams.send(data, target)

    async def _tell(self, packet: Packet, target: NodeId) -> None:
        await self._send(encode_packet(packet), target)
