"""What a node believes of what it hears by datagram (specs/11-peers.md, Gossip).

Which datagrams count is decided before (peer/datagrams). A status in one counts if it is signed with the key of the node that it
describes, and of the incarnation that the cluster's log names. All else is dropped, counted, and logged at most once a
minute. A status that does not rise has no effect, and an incarnation that is not registered is nobody. A status that names a position of the cluster's log that is not known here is a sign of life, and
waits: what it claims is judged once the log has come so far.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import PublicKey, SealingPublicKey
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.enrolment.card_rules import credential_of
from scenefold.peer.membership.claims import LastingClaims, claims_what_is_ours, is_early, problem_of, problems_of
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.signs import Sign, Signs
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.membership.throws import ROUND_S, Throws
from scenefold.wire import Packet, PingBroadcast, Status, decode_packet
from scenefold.world import QuietLog, World
from scenefold.world.buckets import Buckets
from scenefold.world.facts import ClusterFacts

CLAIM_PATIENCE_S = 10.0
"""A claim on what is ours may be old news for so long; after that, something is wrong."""

STATUSES_BURST = 256
"""Statuses of one sender that are looked at, at once: some forty datagrams."""
STATUSES_PER_S = 64.0
"""And this many more each second; a node says some ten a second to each other one. To verify one takes a tenth of a millisecond."""

_log = logging.getLogger("scenefold.peer.membership.gossip")


class Early(NamedTuple):
    """A status whose claims cannot be judged yet, who told it, and when by our clock."""

    status: Status
    sender: NodeId
    heard_at: float

    def is_overruled(self, word: Status, now: float) -> bool:
        """Whether a status that the node says itself now, and that is not early, means that this one is not true.

        An older one may have been on its way for a while.
        """
        is_later = word.incarnation != self.status.incarnation or word.lamport >= self.status.lamport
        return is_later or now - self.heard_at >= CLAIM_PATIENCE_S


class Hearing:
    """Judges datagrams and statuses, and puts what is right into the roster."""

    def __init__(self, world: World, own: OwnStatus, roster: Roster, cluster_log: ClusterLog, facts: ClusterFacts) -> None:
        self._world = world
        self._own = own
        self._roster = roster
        self._cluster_log = cluster_log
        self._facts = facts
        self._quiet = QuietLog(_log)
        self._quiet_claims = QuietLog(_log, logging.INFO)
        self._lasting = LastingClaims()
        self._verifications = Buckets(STATUSES_BURST, STATUSES_PER_S)
        self._throws = Throws()
        self._early: dict[NodeId, Early] = {}
        """The newest status of each peer that names a log position above ours."""
        self.is_contested = False
        """Somebody has claimed what is ours since this was last set to False: others may believe it until we speak."""
        self.signs = Signs()
        self.dropped = 0
        """Packets and statuses that did not verify, or claimed what is ours, since the start."""

    def packet_of(self, data: bytes) -> Packet:
        """The packet of a datagram that counts; MalformedPacket if it is none."""
        return decode_packet(data)

    def sealing_key_of(self, node: NodeId) -> SealingPublicKey | None:
        """The key that datagrams of a node are sealed with, member or not; None if there is none, or the node was revoked."""
        if self.key_of(node) is None:
            return None
        key = self._cluster_log.registry.sealing_key_of(node)
        if key is None:
            credential = credential_of(node, self._cluster_log.registry, self._facts)
            key = None if credential is None else credential.sealing_key
        return key

    def key_of(self, node: NodeId) -> PublicKey | None:
        """The key that a node signs with, member or not; None if there is none, or it counts no longer."""
        registry = self._cluster_log.registry
        key = registry.key_of(node)
        if key is None:
            credential = credential_of(node, registry, self._facts)
            key = None if credential is None else credential.public_key
        return None if key is None or registry.is_revoked(node, key.key_id) else key

    def hear(self, packet: PingBroadcast, sender: NodeId) -> None:
        """Take what rises of a broadcast, or of an answer like one."""
        heard, now = [], self._world.clock.now()
        for status in packet.statuses:
            if status.node == sender:
                # It has sealed the datagram, so this is news even of one that we do not know as a member.
                self._roster.note_position(sender, status.log_position)
            if not self._has_time_for(status, sender):
                continue
            if status.node == self._own.me:
                self._hear_of_myself(status, sender)
            if self._judge(status, sender):
                heard.append(status.node)
        # Answers to RequestState are no throw of the dice, so they say nothing about who stayed silent. Nor does who is
        # no member, or speaks more often than the dice let it.
        if packet.request_id == 0 and heard and self._roster.is_peer(sender) and self._throws.take(sender, self._roster.count, now):
            self._roster.count_broadcast(heard)

    def _has_time_for(self, status: Status, sender: NodeId) -> bool:
        """Whether a status may be verified, if that would be done at all: who signs wrongly, or ever anew, takes no more of our time."""
        if status.node != self._own.me and not self._roster.rises(status):
            return True
        if self._verifications.take(str(sender), self._world.clock.now()):
            return True
        self.drop(address_of(sender), "crowd", "statuses are dropped unread: too many come from there")
        return False

    def _judge(self, status: Status, sender: NodeId) -> bool:
        """Verify and take a status, if it would change anything; True if it is a sign of life."""
        return self._roster.rises(status) and self._take(status, sender, problem_of(status, self.key_of(status.node)))

    def _take(self, status: Status, sender: NodeId, problem: str) -> bool:
        """Take a status that would change something, unless there is a problem with it; True if it is a sign of life."""
        now, node = self._world.clock.now(), status.node
        if problem:
            if self.key_of(node) is not None:
                self.signs.note(Sign.FORGED, address_of(sender), now)
            self.drop(address_of(sender), "status", f"a status of {address_of(node)} is dropped: {problem}")
            return False
        is_contest, early = claims_what_is_ours(status, self._own.arc), is_early(status, self._roster.position)
        if is_contest:
            self.is_contested = True
            lasts = self._lasting.note(node, early, now, CLAIM_PATIENCE_S + self._roster.count * ROUND_S) >= CLAIM_PATIENCE_S
            quiet = self._quiet if lasts else self._quiet_claims
            # By what the log says behind our end of it, the places may be that node's.
            if lasts and not early:
                self.signs.note(Sign.CONTESTED, address_of(sender), now)
            why = f", by position {status.log_position} of the cluster's log, and nobody has shown us that" if early else ""
            text = f"a status of {address_of(node)} is dropped: it claims places that are ours{why}"
            self.drop(address_of(sender), "claim", text, quiet)
        elif node == sender:
            self._lasting.end(node)
        if early:
            waiting = self._early.get(node)
            if waiting is None or status.lamport > waiting.status.lamport or status.incarnation != waiting.status.incarnation:
                self._early[node] = Early(status, sender, now)
            return self._roster.note_life(status, now, relayed=node != sender)
        if node == sender and node in self._early and self._early[node].is_overruled(status, now):
            # By its own word it knows no more than we do: whatever said otherwise is over.
            del self._early[node]
        return not is_contest and self._roster.hear(status, now, relayed=node != sender)

    def _hear_of_myself(self, status: Status, sender: NodeId) -> None:
        """Somebody speaks in our name, with our key, and later than we did: what we say must not be taken for older."""
        own = self._own
        if status.incarnation != own.incarnation or not own.may_follow(status.lamport) or problem_of(status, own.key.public):
            return
        own.follow(status.lamport)
        self.is_contested = True
        self.signs.note(Sign.OWN_KEY, address_of(sender), self._world.clock.now())
        # After a restore from a backup these are our own of before, and the voter says so in a moment.
        text = "statuses of this node are heard that it has not made: unless it begins anew now, as an older copy of itself, somebody else has its key"
        self.drop(address_of(sender), "myself", f"{text}, and that has to be revoked")

    def log_grew(self) -> None:
        """The roster has taken a newer log: what was early may be judged now."""
        self._throws.keep(self._roster.is_peer)
        due = [heard for heard in self._early.values() if not is_early(heard.status, self._roster.position)]
        self._early = {node: heard for node, heard in self._early.items() if is_early(heard.status, self._roster.position)}
        for heard in due:
            # Its key may have been revoked, or its incarnation removed, since it was verified.
            self._judge(heard.status, heard.sender)

    async def take_table(self, statuses: Sequence[Status], source: NodeId) -> int:
        """Take a whole table that a member has sent; the number of signs of life in it."""
        # Lamport time 0 stands for a member that was never heard there: nobody has signed that.
        news = [(status, self.key_of(status.node)) for status in statuses if status.lamport and self._roster.rises(status)]
        problems = await self._world.workers.run("crypto", problems_of, news)
        taken = 0
        for (status, key), problem in zip(news, problems, strict=True):
            # Meanwhile a newer one may have come, or the log may have removed the node or revoked its key.
            if self._roster.rises(status) and key == self.key_of(status.node):
                taken += self._take(status, source, problem)
        return taken

    def drop(self, source: str, kind: str, text: str, quiet: QuietLog | None = None) -> None:
        """Count what is not believed, and say so now and then."""
        self.dropped += 1
        (quiet or self._quiet).say(self._world.clock.now(), source, kind, text)
