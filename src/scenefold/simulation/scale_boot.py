"""A very large simulated cluster that has been running: as after a restart of all nodes, with tables already filled.

A thousand nodes that start for the first time make a log of a thousand records and tables of a million statuses, which takes a
simulation on one core longer than what is measured afterwards. So every disk gets the cluster's log beforehand, with all
nodes registered on their founding seats, and each roster a status of everybody, as relayed by gossip. From then on everything is
done by the nodes themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from scenefold.base.ids import NodeId
from scenefold.crypto import HEADER_DOMAIN, LOG_DOMAIN
from scenefold.peer.balance import balancer
from scenefold.peer.cluster_log.log_book import LogBook
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.membership import gossip
from scenefold.simulation.cluster import DATA_FOLDER, Cluster, Node, key_of
from scenefold.store import open_store
from scenefold.wire import AddNode, Found, Founder, LogEntry, LogRecord, Member, SignedRecord

NEVER_S = 1e9


async def prepare(cluster: Cluster, founders: int) -> None:
    """Write the log of a cluster, whose founders have all registered, to the disks of all founders."""
    nodes = [cluster.nodes[slot] for slot in range(founders)]
    log_key = key_of(cluster.net.seed, "the cluster's log")
    members: list[Member] = []
    for node in nodes:
        world = cluster.net.world(node.name, node.address, node.disk)
        async with open_store(world, DATA_FOLDER, node.node_id) as store:
            members.append(Member(node.node_id, store.identity.incarnation))
    seats = tuple(Founder(node.node_id, *_keys_of(node), node.address) for node in nodes)
    entries: list[LogEntry] = [Found(seats, cluster.facts.voters)]
    for node, member in zip(nodes, members, strict=True):
        entries.append(AddNode(member, *_keys_of(node), node.address, NodeId(0)))
    records, head = [], Registry().head
    for position, entry in enumerate(entries, 1):
        record = LogRecord(position, head, position.to_bytes(16, "big"), cluster.facts.voter, entry)
        data, head = record.encode(), record.hash()
        records.append(SignedRecord(data, log_key.sign(LOG_DOMAIN, data)))
    public = replace(cluster.facts.genesis_header, position=len(records))
    header = replace(public, signature=log_key.sign(HEADER_DOMAIN, public.signable()))
    for node in nodes:
        world = cluster.net.world(node.name, node.address, node.disk)
        async with open_store(world, DATA_FOLDER, node.node_id) as store:
            book = LogBook(store)
            await book.append(records, header)


def _keys_of(node: Node) -> tuple[bytes, bytes]:
    return node.secrets.signing.public.raw, node.secrets.sealing.public.raw


def fill_tables(cluster: Cluster) -> None:
    """Tell every running node of every other one, as gossip would have."""
    contexts = [node.context for node in cluster.running.values() if node.context is not None]
    statuses = [context.own.signed() for context in contexts]
    for context in contexts:
        now = context.world.clock.now()
        for status in statuses:
            context.roster.hear(status, now, relayed=True)


@contextmanager
def nothing_told_at_start() -> Iterator[None]:
    """Nodes that start meanwhile do not tell all others of themselves: they did so before the restart."""
    module: Any = gossip
    before, module.TELL_S = module.TELL_S, NEVER_S
    try:
        yield
    finally:
        module.TELL_S = before


@contextmanager
def nothing_balanced() -> Iterator[None]:
    """Nodes that hold nothing have nothing to balance, and a thousand that look at a thousand each take a while to see it."""
    before = balancer.LOOK_S
    balancer.LOOK_S = NEVER_S
    try:
        yield
    finally:
        balancer.LOOK_S = before
