"""Records of a cluster's log, made by hand for tests: keys, founders, and a chain that goes on."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.crypto import LOG_DOMAIN, MemberSecrets, SealingKey, SigningKey
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import AddNode, Found, Founder, LogEntry, LogRecord, Member, RemoveNode, SignedRecord
from scenefold.world.facts import ClusterFacts, Credential
from scenefold.world.ports import Ports

LOG_KEY = SigningKey.from_seed(b"l" * 32)


def node(number: int) -> NodeId:
    return NodeId(node_id_of("127.0.0.2") + number)


def key_of(number: int) -> SigningKey:
    return SigningKey.from_seed(hashlib.sha256(b"node %d" % number).digest())


def secrets_of(number: int) -> MemberSecrets:
    return MemberSecrets(key_of(number), SealingKey(hashlib.sha256(b"sealing key of node %d" % number).digest()))


def _raw(number: int) -> tuple[bytes, bytes]:
    secrets = secrets_of(number)
    return secrets.signing.public.raw, secrets.sealing.public.raw


def incarnation(number: int, life: int = 0) -> bytes:
    return hashlib.sha256(b"life %d of %d" % (life, number)).digest()[:16]


def member(number: int, life: int = 0) -> Member:
    return Member(node(number), incarnation(number, life))


def found(count: int, voters: Sequence[int] = (0,)) -> Found:
    founders = (Founder(node(number), *_raw(number), address_of(node(number))) for number in range(count))
    return Found(tuple(founders), tuple(node(number) for number in voters))


def add(number: int, left_of: int | None = None, life: int = 0) -> AddNode:
    """Node `number` takes its founding seat, or stands left of another one."""
    target = NodeId(0) if left_of is None else node(left_of)
    return AddNode(member(number, life), *_raw(number), address_of(node(number)), target)


def remove(number: int, life: int = 0, reason: str = "gone") -> RemoveNode:
    return RemoveNode(member(number, life), reason)


def record(after: Registry, entry: LogEntry, request: bytes | None = None, origin: int = 0) -> LogRecord:
    """The record that says this behind everything in `after`."""
    request_id = hashlib.sha256(b"request %d" % (after.position + 1)).digest()[:16] if request is None else request
    return LogRecord(after.position + 1, after.head, request_id, node(origin), entry)


def folded(*entries: LogEntry) -> Registry:
    """The registry after these entries."""
    registry = Registry()
    for entry in entries:
        registry = registry.apply(record(registry, entry))
    return registry


def signed(record: LogRecord, key: SigningKey = LOG_KEY) -> SignedRecord:
    data = record.encode()
    return SignedRecord(data, key.sign(LOG_DOMAIN, data))


def facts(founders: int, spares: int = 0, ports: Ports | None = None) -> ClusterFacts:
    """A cluster of this many founders, the first of which is the voter."""
    credentials = [
        Credential(node(number), address_of(node(number)), key_of(number).public, secrets_of(number).sealing.public)
        for number in range(founders + spares)
    ]
    return ClusterFacts(
        name="trial",
        cluster_id=bytes(16),
        ports=ports or Ports(),
        seeds=(credentials[0].address,),
        credentials=tuple(credentials),
        founders=tuple(node(number) for number in range(founders)),
        voters=(node(0),),
        log_key=LOG_KEY.public,
    )
