"""The voter: it decides the cluster's log, for now alone, and grants owner leases (specs/15-cluster-log.md).

With one voter there is no majority to ask, so PREPARE and ACCEPT fall together: an entry is committed once it is durable
here, under its final bytes. Everybody else proposes to it. What it must not forget over a restart, the last life of
each node that it granted a lease under, is durable before that is granted; when it last granted a lease to whom it may
forget, because it then counts from its own start, as if it had granted one to everybody just before.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Awaitable, Callable
from dataclasses import replace

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import HEADER_DOMAIN, LEASE_DOMAIN, LOG_DOMAIN, SigningKey
from scenefold.peer.cluster_log.beginnings import Beginnings
from scenefold.peer.cluster_log.lives import Lives, is_restored, lives_asked_with, note_of, pack_granted, unpack_granted
from scenefold.peer.cluster_log.log_rules import BEGAN_ANEW, check_proposer, committed_at, in_words, lease_message, predecessor
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.card_rules import credential_of
from scenefold.peer.timing import T_WAIT_S
from scenefold.store import Store
from scenefold.wire import AddNode, LogEntry, LogRecord, Member, RemoveNode, RequestSceneLog, SceneLogPublic, SignedRecord
from scenefold.wire.enrol_entries import Trust
from scenefold.world import QuietLog, World
from scenefold.world.facts import ClusterFacts

Veto = Callable[[Member], Awaitable[str | None]]
Commit = Callable[[SignedRecord, Registry], Awaitable[None]]

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


def first_trust_of(node: NodeId, attempt: int = 0) -> bytes:
    """The request id of the record by which a node is trusted from the start. Everybody can know it, so a member may have put a record of its
    own into the log under it: then it is that of the next attempt.
    """
    again = attempt.to_bytes(4, "big") if attempt else b""
    return hashlib.sha256(b"scenefold/first-trust" + node.to_bytes(4, "big") + again).digest()[:16]


async def check_not_vetoed(member: Member, proposer: NodeId, registry: Registry, veto: Veto | None) -> None:
    """Refused (13) if a voter objects to a removal. Who leaves by itself is not held back, nor is one whose key was revoked; anybody else may
    turn out to be alive."""
    if member.node == proposer or veto is None or not registry.stands(member.node) or registry.is_barred(member.node):
        return
    objection = await veto(member)
    if objection is not None:
        raise Refused(RejectReason.BUSY, f"{address_of(member.node)} is not removed: {objection}")


class Voter:
    """Made on the node that holds the log's signing key. `commit` makes a record durable and tells everybody."""

    def __init__(
        self, world: World, store: Store, facts: ClusterFacts, key: SigningKey, registry: Callable[[], Registry], commit: Commit
    ) -> None:
        self._world = world
        self._store = store
        self._facts = facts
        self._key = key
        self._registry = registry
        self._commit = commit
        self._lock = trio.Lock()
        self._leased_at: dict[NodeId, float] = {}
        self._granted: dict[NodeId, tuple[bytes, int]] = {}
        self._noting: dict[NodeId, trio.Lock] = {}
        self._started_at = world.clock.now()
        self._beginnings = Beginnings()
        self._quiet = QuietLog(_log)
        self.veto: Veto | None = None
        """Asked about removals that another node proposes: a reason against it, or None."""

    def leased_at(self, node: NodeId) -> float | None:
        """Local time of the last lease that was granted to a node; None since this start."""
        return self._leased_at.get(node)

    def lapsed(self, learnt_at: Callable[[int], float]) -> list[NodeId]:
        """Members that hold no lease any more, wherever their clocks stand."""
        registry, now = self._registry(), self._world.clock.now()
        silent = []
        for node in registry.members:
            known = registry.current(node)
            assert known is not None
            since = max(self._since(node), learnt_at(known.position))
            if node not in registry.voters and now - since > T_WAIT_S:
                silent.append(node)
        return silent

    # ---------------------------------------------------------------------------------------------------- entries

    async def decide(self, entry: LogEntry, request_id: bytes, proposer: NodeId) -> int:
        """Commit an entry, and answer its position; Refused with the reason.

        A request that was committed before is answered as it was then. Position and chain are set here: who proposes
        need not know what was decided a moment ago.
        """
        self._refuse_unless_allowed(entry, request_id, proposer)
        if isinstance(entry, RemoveNode) and self._committed_at(entry, request_id) is None:
            await check_not_vetoed(entry.member, proposer, self._registry(), self.veto)
        async with self._lock:
            known = self._committed_at(entry, request_id)
            if known is not None:
                return known
            self._refuse_unless_allowed(entry, request_id, proposer)
            if not isinstance(entry, AddNode):
                return await self._append(entry, request_id, proposer)
            return await self._register(entry, request_id, proposer)

    async def found(self, entry: LogEntry) -> None:
        """Commit the first record, and whom the cluster trusts from the start: nobody becomes a member in between. What was interrupted is
        done to the end; what was done is not done again, so that a trust may be withdrawn for ever.
        """
        async with self._lock:
            if self._registry().position == 0:
                await self._append(entry, self._world.entropy.token(16), self._facts.voter)
            for node in self._facts.trusted:
                known = self._facts.credential(node)
                if known is None or credential_of(node, self._registry(), self._facts) != known:
                    continue
                trust = Trust(node, True, known.sealing_key.raw)
                request_id = self._first_request_of(trust)
                if request_id is not None:
                    await self._append(trust, request_id, self._facts.voter)

    def _first_request_of(self, trust: Trust) -> bytes | None:
        """The request id to commit it under; None if it was committed. Each id that a member took before has cost it a record."""
        attempt = 0
        while True:
            request_id = first_trust_of(trust.node, attempt)
            try:
                return request_id if self._registry().committed_at(request_id, trust) is None else None
            except Refused:
                attempt += 1

    def _committed_at(self, entry: LogEntry, request_id: bytes) -> int | None:
        return committed_at(entry, request_id, self._registry())

    def _refuse_unless_allowed(self, entry: LogEntry, request_id: bytes, proposer: NodeId) -> None:
        if self._committed_at(entry, request_id) is None:
            check_proposer(entry, proposer, self._registry(), self._facts, self._world.clock.wall())

    async def _register(self, entry: AddNode, request_id: bytes, node: NodeId) -> int:
        now = self._world.clock.now()
        try:
            self._beginnings.check(node, now)
        except Refused as refusal:
            self._quiet.say(now, address_of(node), "beginnings", refusal.what)
            raise
        old = predecessor(entry, self._registry())
        if old is not None:
            await self._retire(old)
        position = await self._append(entry, request_id, node)
        self._beginnings.count(node, self._world.clock.now())
        return position

    async def _retire(self, old: Member) -> None:
        """Remove the incarnation before a new one, once no lease of it can be alive."""
        wait_s = self._since(old.node) + T_WAIT_S - self._world.clock.now()
        if wait_s >= 0:
            raise Refused(RejectReason.BUSY, f"id in use: {address_of(old.node)} may hold a lease for {wait_s:.0f} s more")
        await self._append(RemoveNode(old, BEGAN_ANEW), self._world.entropy.token(16), self._facts.voter)

    async def _append(self, entry: LogEntry, request_id: bytes, origin: NodeId) -> int:
        registry = self._registry()
        if registry.voting.councils:
            raise Refused(RejectReason.NOT_READY, "the log's key decides no more, and voters do not yet", remedy="try again in a moment")
        record = LogRecord(registry.position + 1, registry.head, request_id, origin, entry)
        after = registry.apply(record)
        data = record.encode()
        # Shielded: the asker's connection may end, but a record that is half committed would be decided twice.
        with trio.CancelScope(shield=True):
            await self._commit(SignedRecord(data, self._key.sign(LOG_DOMAIN, data)), after)
        _log.info("cluster log, position %d: %s", record.position, in_words(entry))
        return record.position

    def header(self, position: int) -> SceneLogPublic:
        """The signed public header of a committed position."""
        header = replace(self._facts.genesis_header, position=position)
        return replace(header, signature=self._key.sign(HEADER_DOMAIN, header.signable()))

    # ----------------------------------------------------------------------------------------------------- leases

    async def grant(self, packet: RequestSceneLog, asker: NodeId) -> bool:
        """Whether the asker has a lease from when it asked on; False if its log is not the newest.

        Refused: 12 not a member, 18 an incarnation that was removed, or a restored backup; 4 the proof is wrong; 5 no life.
        """
        member = packet.member
        if member is None or member.node != asker:
            raise Refused(RejectReason.NOT_AUTHORISED, "a lease is asked for by the node itself")
        lives = lives_asked_with(packet.lives)
        self._refuse_unless_current(member)
        if packet.have != self._registry().position:
            return False
        self._check_proof(packet, member, lives)
        await self._note_life(member, lives)
        # The log may have gone on while the life was being written.
        self._refuse_unless_current(member)
        if packet.have != self._registry().position:
            return False
        self._leased_at[asker] = self._world.clock.now()
        return True

    def _refuse_unless_current(self, member: Member) -> None:
        registry = self._registry()
        removal = registry.removal(member.incarnation)
        if removal is not None:
            raise Refused(RejectReason.WRONG_INCARNATION, f"this incarnation was removed: {removal.reason}")
        if not registry.is_current(member):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{address_of(member.node)} is no member under this incarnation")

    def _check_proof(self, packet: RequestSceneLog, member: Member, lives: Lives) -> None:
        registry = self._registry()
        key = registry.key_of(member.node)
        assert key is not None
        genesis = self._facts.genesis_header.genesis
        try:
            key.verify(packet.proof, LEASE_DOMAIN, lease_message(genesis, packet.have, registry.head, packet.nonce, member, lives))
        except DamagedData as problem:
            raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem

    async def _note_life(self, member: Member, lives: Lives) -> None:
        """Keep durably under which life a node was granted a lease; Refused (18) if it does not know the last one."""
        granted = (member.incarnation, lives.now)
        if self._granted.get(member.node) == granted:
            return
        # One at a time: a node and a copy of its disk that ask at once must not both find the life that both know.
        async with self._noting.setdefault(member.node, trio.Lock()):
            known = self._granted.get(member.node) or await self._recorded(member.node)
            if known is not None and known[0] == member.incarnation and is_restored(known[1], lives):
                text = (
                    f"the disk of {address_of(member.node)} is a restored backup: it has had a lease since that its disk does not know of"
                )
                raise Refused(RejectReason.WRONG_INCARNATION, text)
            if known != granted:
                # Whoever asked may be gone before the note is durable; what is believed here must not fall behind the disk then.
                self._granted.pop(member.node, None)
                with trio.CancelScope(shield=True):
                    await self._store.put_note(note_of(member.node), pack_granted(*granted))
            self._granted[member.node] = granted

    async def _recorded(self, node: NodeId) -> tuple[bytes, int] | None:
        data = await self._store.get_note(note_of(node))
        return None if data is None else unpack_granted(data)

    def _since(self, node: NodeId) -> float:
        return self._leased_at.get(node, self._started_at)
