"""A cluster with an authority in the simulated world: certificates with dates, invitations, and who comes by them."""

from __future__ import annotations

import datetime
import hashlib
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import trio

from scenefold.base.ids import node_id_of
from scenefold.crypto import (
    AUTHORITY_PURPOSE,
    Authority,
    Card,
    InvitedKind,
    MemberSecrets,
    SigningKey,
    Token,
    mark_of,
    new_tls_key,
    tls_key_in,
)
from scenefold.node.running import run_assembled
from scenefold.peer import NodeContext, NodeSettings
from scenefold.peer.enrolment.papers import Papers
from scenefold.simulation.cluster import key_of, secrets_of
from scenefold.wire.enrol_entries import ANY_NODE, Invite
from scenefold.world.charter import Charter
from scenefold.world.facts import ClusterFacts, Credential
from scenefold.world.profile import ClusterProfile
from scenefold.world.sim import SimDisk, SimNet
from scenefold.world.sim.clock import WALL_BEGIN

DAY = datetime.timedelta(days=1)
BEGIN = datetime.datetime.fromtimestamp(WALL_BEGIN, datetime.UTC)


@dataclass(eq=False)
class Member:
    """Who has a certificate. `kept`: newer ones."""

    name: str
    address: str
    secrets: MemberSecrets
    certificate: bytes
    kept: list[bytes] = field(default_factory=list)
    disk: SimDisk = field(default_factory=SimDisk)
    context: NodeContext | None = None
    scope: trio.CancelScope | None = None


class Studio:
    """Its nodes are 10.0.0.1 and on; the first votes, and has the authority's key."""

    def __init__(self, net: SimNet, count: int, nursery: trio.Nursery, *, age: datetime.timedelta = DAY) -> None:
        """`age`: of the certificates that the cluster begins with, which count for a year."""
        self.net = net
        self._nursery = nursery
        self.authority = Authority.create("studio", now=BEGIN - age)
        self._since = BEGIN - age
        self.nodes = [self.certified(f"node:{node_id_of(address)}", address) for address in (f"10.0.0.{n + 1}" for n in range(count))]
        owner = self.certified("user:owner", admin=True)
        self._log_key = key_of(net.seed, "the cluster's log")
        ids = [node_id_of(node.address) for node in self.nodes]
        bare = ClusterFacts(
            name="studio",
            cluster_id=hashlib.sha256(f"{net.seed} studio".encode()).digest()[:16],
            ports=net.ports,
            seeds=tuple(node.address for node in self.nodes[:3]),
            credentials=tuple(
                Credential(node_id_of(node.address), node.address, node.secrets.signing.public, node.secrets.sealing.public)
                for node in self.nodes
            ),
            founders=tuple(ids),
            voters=(ids[0],),
            log_key=self._log_key.public,
            owners=(Card.read(owner.certificate).der,),
        )
        self.facts = replace(bare, authority=self.authority.certificate, charter=Charter.of(bare).signed(self.authority))
        public = self.nodes[0].secrets.sealing.public
        self._sealed = public.seal(self.authority.key_der(), AUTHORITY_PURPOSE, bare.cluster_id, bytes)

    def certified(self, name: str, address: str = "", *, admin: bool = False) -> Member:
        secrets = secrets_of(self.net.seed, name)
        where, key = ([address] if address else []), tls_key_in(new_tls_key())
        return Member(
            name, address, secrets, self.authority.certify(name, where, key, keys=secrets.public(is_administrator=admin), now=self._since)
        )

    # --------------------------------------------------------------------------------------------------------- lives

    async def start(self, *numbers: int) -> None:
        for number in numbers:
            node = self.nodes[number]
            log_key, sealed = (self._log_key, self._sealed) if number == 0 else (None, b"")
            await self._nursery.start(partial(self._live, node, self.facts, log_key, sealed))

    async def start_newcomer(self, profile: ClusterProfile, address: str) -> Member:
        """A node that was enrolled, by the profile that it got."""
        identity = profile.node_identity(address)
        node = Member(identity.name, address, profile.node_secrets(address), identity.certificate)
        await self._nursery.start(partial(self._live, node, profile.facts(), None, b""))
        return node

    async def _live(
        self, node: Member, facts: ClusterFacts, log_key: SigningKey | None, sealed: bytes, *, task_status: trio.TaskStatus[None]
    ) -> None:
        world = self.net.world(node.name, node.address, node.disk, certificate=node.certificate)
        settings = NodeSettings(profile_folder=Path("/profile"), address=node.address, data_folder=Path("/data"), memory_bytes=1 << 30)
        papers = Papers(node.certificate, sealed, node.kept.append)
        with trio.CancelScope() as node.scope:
            async with trio.open_nursery() as life:
                node.context = await life.start(partial(run_assembled, settings, facts, node.secrets, log_key, world, (), papers=papers))
                task_status.started()

    def stop(self, number: int) -> None:
        node = self.nodes[number]
        assert node.scope is not None
        self.net.crash(node.address)
        node.context = None
        node.scope.cancel()

    def of(self, number: int) -> NodeContext:
        context = self.nodes[number].context
        assert context is not None
        return context

    async def joined(self) -> None:
        for node in self.nodes:
            if node.context is not None:
                await node.context.joined.wait()

    # --------------------------------------------------------------------------------------------------- invitations

    async def invite(self, name: str, addresses: tuple[str, ...] = ()) -> Token:
        """As the voter takes an administrator's order into the log."""
        key = key_of(self.net.seed, f"invitation of {name}")
        expires = int(self.of(0).world.clock.wall()) + 3600
        await self.of(0).cluster_log.propose(Invite(key.public.raw, name, False, expires, "user:owner"))
        kind = InvitedKind.NODE if name == ANY_NODE else InvitedKind.USER
        ports, ids = self.net.ports, tuple(map(node_id_of, addresses))
        return Token(kind, key.seed, mark_of(self.authority.certificate), expires, ports.low, ports.high, ids)

    async def all_know(self, position: int) -> None:
        """Return once every node that runs has the cluster's log so far."""
        for node in self.nodes:
            if node.context is not None:
                await node.context.cluster_log.changed_after(position - 1)
