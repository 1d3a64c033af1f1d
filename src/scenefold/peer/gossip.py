"""Statuses from node to node over UDP, packets 1 and 2 (thesis B.2.2, C.1; specs/11-peers.md, Gossip).

Once a second, with probability 1/N, a node sends its own signed status to every other member, and as much of its table
as fits one datagram. Whoever is not heard yet is asked (RequestState), a few at a time, so that a table of a small
cluster is complete within a round trip; a large one is fetched whole (tables.py). Who seems dead is asked likewise
(`probe`).

A datagram counts if it is signed with the key of its sender, and a status in it if it is signed with that of the node
that it describes, and of the incarnation that the cluster's log names. All else is dropped, counted, and logged at
most once a minute. There is no replay window: a status that does not rise has no effect, an incarnation that is not
registered is nobody, and an answer goes to the certified address of who asked, so a repeated datagram gains little; so
that a small one repeated is no flood of large ones, who asks again and again is answered only so often.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import trio

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.base.location import Arc, tiles
from scenefold.crypto import DATAGRAM_OVERHEAD_BYTES, EVERYBODY, PublicKey, parse_datagram, sign_datagram, verify_datagram
from scenefold.peer.claims import claims_what_is_ours, problem_of, problems_of
from scenefold.peer.cluster_log import ClusterLog
from scenefold.peer.knocking import KNOCK_S_MAX, KNOCKS_MAX, Knocks
from scenefold.peer.registry import Registry
from scenefold.peer.roster import Roster
from scenefold.peer.status import OwnStatus, arc_of_status
from scenefold.wire import MalformedPacket, Packet, PingBroadcast, RequestState, Status, decode_packet, encode_packet
from scenefold.world import Datagrams, Priority, QuietLog, World
from scenefold.world.facts import ClusterFacts

ROUND_S = 1.0
"""Time between two throws of the dice (thesis B.2.2)."""
TELL_ARC_S = 0.02
"""For each member, between two statuses that tell all of a changed arc: 50 small datagrams a second at most."""
KNOCK_SPREAD_S = 0.002
"""For each member: a newcomer is asked by everybody, but not by all of them in the same moment."""
ANSWER_S_MIN = 0.05
"""Time between two answers to one node, which asks every KNOCK_S_MIN at most."""
PROBE_PAUSES_S = (0.3, 0.6, 1.1)
"""How long a probed node may take to answer, try by try: the last answers of a slow one still count within 2 s."""
CLAIM_PATIENCE_S = 10.0
"""A claim on what is ours may be old news for so long; after that, something is wrong."""

_log = logging.getLogger("scenefold.peer.gossip")


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
        self._facts = facts
        self._me = address_of(own.me)
        self._seeds = {seed: node_id_of(seed) for seed in seeds if seed != self._me}
        self._datagrams: Datagrams | None = None
        self._waiters: dict[trio.Event, Callable[[], bool]] = {}
        self._members_changed = trio.Event()
        self._quiet = QuietLog(_log)
        self._quiet_claims = QuietLog(_log, logging.INFO)
        self._answered_at: dict[NodeId, float] = {}
        self._met_at: dict[NodeId, float] = {}
        self._claimed_since: dict[NodeId, float] = {}
        self._sizes: dict[NodeId, tuple[int, int]] = {}
        self._knocks = Knocks(facts.voter, world.entropy.uniform)
        self.dropped = 0
        """Datagrams and statuses that did not verify, or claimed what is ours, since the start."""
        roster.tell_position = cluster_log.heard_of

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Gossip until cancelled. Started once the port is open; LocalFault if it cannot be had."""
        datagrams = self._datagrams = await self._world.network.open_datagrams(self._me, Priority.HIGH)
        self._roster.set_members(self._cluster_log.registry, self._world.clock.now())
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._follow_log)
                nursery.start_soon(self._listen, datagrams)
                nursery.start_soon(self._speak)
                nursery.start_soon(self._knock)
                task_status.started()
        finally:
            self._datagrams = None
            with trio.CancelScope(shield=True):
                await datagrams.aclose()

    # ------------------------------------------------------------------------------------------------- who waits

    async def everybody_heard(self) -> None:
        """Return once the log names members, every founder among them, and a status of each is known."""
        await self._until(lambda: self._cluster_log.registry.position > 0 and not self._roster.unheard_count + self._roster.vacant_count)

    def is_line_tiled(self) -> bool:
        """Whether what the members say of their arcs, and the seats that founders still may take, tile the line. O(N log N)."""
        registry = self._cluster_log.registry
        arcs = [registry.founding_arc(node) for node in registry.order if registry.vacant_seat(node) is not None]
        return tiles(filter(None, [self._own.arc, *arcs, *map(arc_of_status, self._roster.statuses())]))

    async def somebody_heard(self) -> None:
        """Return once any other node of the cluster has spoken; at once if the log names none."""
        await self._until(lambda: bool(self._met_at) or (self._cluster_log.registry.position > 0 and self._roster.count == 1))

    async def a_seed_heard(self) -> None:
        """Return once a seed has spoken; at once if there is none but this node."""
        await self._until(lambda: len(self._silent_seeds()) < max(1, len(self._seeds)))

    async def many_unheard(self, few: int) -> None:
        """Return once somebody has spoken, and statuses of more than `few` members are lacking."""
        await self._until(lambda: bool(self._met_at) and self._roster.unheard_count > few)

    @property
    def seeds(self) -> Sequence[str]:
        """The seeds other than this node."""
        return tuple(self._seeds)

    def met(self) -> list[NodeId]:
        """The nodes that have spoken to us since the start, members or not, in id order."""
        return sorted(self._met_at)

    def met_at(self, node: NodeId) -> float | None:
        """Local time of the last datagram that a node signed, as member or not; None if there was none."""
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
            await self._ask(address_of(member))
            with trio.move_on_after(pause_s):
                await self._until(has_answered)
            if has_answered():
                return True
        return False

    async def take_table(self, statuses: Sequence[Status], source: NodeId) -> int:
        """Take a whole table that a member has sent; the number of signs of life in it."""
        # Lamport time 0 stands for a member that was never heard there: nobody has signed that.
        news = [status for status in statuses if status.lamport and self._roster.rises(status)]
        problems = await self._world.workers.run("crypto", problems_of, [(status, self._key_of(status.node)) for status in news])
        taken = [self._take(status, source, problem) for status, problem in zip(news, problems, strict=True)]
        self._tell_waiters()
        return sum(taken)

    # --------------------------------------------------------------------------------------------------- speaking

    async def _follow_log(self) -> None:
        registry = self._cluster_log.registry
        while True:
            self._take_members(registry)
            changed, self._members_changed = self._members_changed, trio.Event()
            changed.set()
            self._tell_waiters()
            registry = await self._cluster_log.changed_after(registry.position)

    def _take_members(self, registry: Registry) -> None:
        """Who comes after us into a large cluster tells everybody of itself, and is asked only if that was lost."""
        roster, now = self._roster, self._world.clock.now()
        had_log, had = roster.position > 0, set(roster.unheard())
        roster.set_members(registry, now)
        is_large = had_log and roster.count > KNOCKS_MAX
        come = [node for node in roster.unheard() if node not in had] if is_large else []
        self._knocks.spare(come, now + roster.count * TELL_ARC_S + 2 * ROUND_S, roster.unheard())

    async def _speak(self) -> None:
        """Throw the dice, once a second; and say at once, within bounds, that the own arc has changed."""
        said: Arc | None = None
        tell_from: float | None = None
        while True:
            await self._world.clock.sleep(ROUND_S)
            if not self._cluster_log.registry.is_current(self._own.member):
                continue
            now = self._world.clock.now()
            if tell_from is None:
                # All nodes of a cluster may have started at once: in a large one, the first telling comes at a moment of chance.
                tell_from = now - ROUND_S + self._world.entropy.uniform() * self._roster.count * TELL_ARC_S
            if self._world.entropy.uniform() * self._roster.count < 1:
                self._roster.count_broadcast(())
                data = self._page(0)
            elif self._own.arc != said and now >= tell_from:
                # Under another request id than 0, since it is no throw of the dice.
                data = self._sealed(PingBroadcast((self._own.signed(),), request_id=1))
                tell_from = now + self._roster.count * TELL_ARC_S
            else:
                continue
            said = self._own.arc
            for member in list(self._roster.peers):
                await self._send(data, address_of(member))

    async def _knock(self) -> None:
        """Ask who has not been heard, seeds included: they know others, even where the log names no member yet."""
        while True:
            members_changed = self._members_changed
            due, pause_s = self._knocks.due(self._roster.unheard(), self._silent_seeds(), self._world.clock.now())
            for address in due:
                await self._ask(address)
            with trio.move_on_after(pause_s):
                await self._until(partial(self._is_to_look_again, members_changed))
            if members_changed.is_set():
                spread_s = min(KNOCK_S_MAX, self._roster.count * KNOCK_SPREAD_S)
                await self._world.clock.sleep(self._world.entropy.uniform() * spread_s)

    def _is_to_look_again(self, members_changed: trio.Event) -> bool:
        """Others are to be asked: the members have changed, or a table has left only those few that can all be asked."""
        return members_changed.is_set() or self._knocks.is_over_soon(self._roster.unheard_count)

    def _silent_seeds(self) -> list[str]:
        return [seed for seed, node in self._seeds.items() if node not in self._met_at]

    async def _ask(self, address: str) -> None:
        await self._send(self._sealed(RequestState(request_id=1, mini_status=self._own.mini())), address)

    async def _send(self, data: bytes, address: str) -> None:
        assert self._datagrams is not None, "gossip runs first"
        await self._datagrams.send(data, address)

    def _page(self, request_id: int, target: NodeId = EVERYBODY) -> bytes:
        own = self._own.signed()
        others = self._roster.page(_PAGE_BYTES - _size_of(own), self._known_size_of)
        return self._sealed(PingBroadcast((own, *others), request_id=request_id), target)

    def _known_size_of(self, status: Status) -> int:
        """Statuses are passed on many times, and measured once."""
        lamport, size = self._sizes.get(status.node, (-1, 0))
        if lamport != status.lamport:
            size = _size_of(status)
            self._sizes[status.node] = (status.lamport, size)
        return size

    def _sealed(self, packet: Packet, target: NodeId = EVERYBODY) -> bytes:
        return sign_datagram(self._own.key, self._own.me, self._own.next(), encode_packet(packet), target=target)

    # ---------------------------------------------------------------------------------------------------- hearing

    async def _listen(self, datagrams: Datagrams) -> None:
        while True:
            data, source = await datagrams.receive()
            try:
                sender, packet = self._opened(data)
            except (DamagedData, MalformedPacket) as problem:
                self._drop(source.address, "forged", f"a datagram is dropped: {problem}")
                continue
            self._met_at[sender] = self._world.clock.now()
            if isinstance(packet, PingBroadcast):
                self._hear(packet, sender)
            elif isinstance(packet, RequestState):
                await self._answer(packet, sender)
            else:
                self._drop(source.address, "unexpected", f"a {type(packet).__name__} has no business here")
            self._tell_waiters()

    def _opened(self, data: bytes) -> tuple[NodeId, Packet]:
        datagram = parse_datagram(data)
        key = self._key_of(datagram.sender)
        if key is None or datagram.sender == self._own.me or datagram.target not in (EVERYBODY, self._own.me):
            raise DamagedData(f"it is from {address_of(datagram.sender)} for {address_of(datagram.target)}")
        return datagram.sender, decode_packet(verify_datagram(datagram, key))

    def _key_of(self, node: NodeId) -> PublicKey | None:
        """The key that a node signs with, member or not; None if there is none, or it counts no longer."""
        registry = self._cluster_log.registry
        key = registry.key_of(node)
        if key is None:
            credential = self._facts.credential(node)
            key = None if credential is None else credential.public_key
        return None if key is None or registry.is_revoked(node, key.key_id) else key

    def _hear(self, packet: PingBroadcast, sender: NodeId) -> None:
        heard = []
        for status in packet.statuses:
            if status.node == sender:
                # It has signed the datagram, so this is news even of one that we do not know as a member.
                self._roster.note_position(sender, status.log_position)
            if not self._roster.rises(status):
                continue
            if self._take(status, sender, problem_of(status, self._key_of(status.node))):
                heard.append(status.node)
        if packet.request_id == 0 and heard:
            # Answers to RequestState are no throw of the dice, so they say nothing about who stayed silent.
            self._roster.count_broadcast(heard)

    def _take(self, status: Status, sender: NodeId, problem: str) -> bool:
        """Take a status, unless there is a problem with it; True if it is a sign of life."""
        now, node = self._world.clock.now(), status.node
        if problem:
            self._drop(address_of(sender), "status", f"a status of {address_of(node)} is dropped: {problem}")
            return False
        if claims_what_is_ours(status, self._own.arc, self._own.log_position):
            since = self._claimed_since.setdefault(node, now)
            quiet = self._quiet_claims if now - since < CLAIM_PATIENCE_S else self._quiet
            self._drop(address_of(sender), "claim", f"a status of {address_of(node)} is dropped: it claims places that are ours", quiet)
            return False
        if node == sender:
            self._claimed_since.pop(node, None)
        return self._roster.hear(status, now, relayed=node != sender)

    async def _answer(self, packet: RequestState, sender: NodeId) -> None:
        now = self._world.clock.now()
        if packet.mini_status is not None and packet.mini_status.node == sender:
            self._roster.hear_mini(packet.mini_status, now)
        if now - self._answered_at.get(sender, -math.inf) < ANSWER_S_MIN:
            return
        self._answered_at[sender] = now
        await self._send(self._page(packet.request_id, sender), address_of(sender))
        if self._roster.is_unheard(sender):
            # It lives, but has said nothing of itself yet. It has heard us by then, so this ends here.
            await self._ask(address_of(sender))

    # ---------------------------------------------------------------------------------------------------- private

    async def _until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            news = trio.Event()
            self._waiters[news] = condition
            try:
                await news.wait()
            finally:
                self._waiters.pop(news, None)

    def _tell_waiters(self) -> None:
        """Wake those whose condition holds: news come with every datagram, and hardly ever are what somebody waits for."""
        for news, condition in list(self._waiters.items()):
            if condition():
                news.set()
                del self._waiters[news]

    def _drop(self, source: str, kind: str, text: str, quiet: QuietLog | None = None) -> None:
        self.dropped += 1
        (quiet or self._quiet).say(self._world.clock.now(), source, kind, text)


_EMPTY_PING_BYTES = len(encode_packet(PingBroadcast(())))
_HEADS_BYTES = 6
"""What the heads of a request id and of a longer array may add."""
_PAGE_BYTES = DATAGRAM_BYTES_MAX - DATAGRAM_OVERHEAD_BYTES - _EMPTY_PING_BYTES - _HEADS_BYTES


def _size_of(status: Status) -> int:
    return len(encode_packet(PingBroadcast((status,)))) - _EMPTY_PING_BYTES
