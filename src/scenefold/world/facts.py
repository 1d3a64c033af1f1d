"""What all nodes and users of a cluster know from the start: its name, keys and founders (specs/15-cluster-log.md).

A profile on disk gives these facts (profile.py), a simulation makes them in memory; the node's code takes them as a
value and never asks where they come from. Who is a member *now* says the cluster's log, which begins with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from scenefold.base.ids import NodeId, SceneId
from scenefold.crypto import PublicKey, SealingPublicKey
from scenefold.wire import KeyEntry, SceneLogPublic, SceneMode
from scenefold.world.ports import Ports

GENESIS_POSITION = 1


@dataclass(frozen=True, slots=True)
class Credential:
    """A node that the cluster's authority has certified: its id, address, the key that it signs with, and that which is sealed to."""

    node_id: NodeId
    address: str
    public_key: PublicKey
    sealing_key: SealingPublicKey


@dataclass(frozen=True)
class ClusterFacts:
    """`credentials`, `founders` and `voters` in id order; the voters are founders, the founders have credentials.

    Founders stand on the line from the start; the other credentials are of spares, which may join.
    `log_key` is the public half of the key that signs the cluster's log. `authority`: its certificate (PEM), by which cards are
    believed; `charter`: these facts as it signed them (charter.py), to be handed to newcomers; `owners`: cards (DER) of the users that
    the cluster began with. A cluster in memory may do without these three: then nobody can be enrolled. `trusted`: known to the voter
    alone, which enters it into the log when it founds that: whom besides itself the cluster trusts from the start.
    """

    name: str
    cluster_id: bytes
    ports: Ports
    seeds: tuple[str, ...]
    credentials: tuple[Credential, ...]
    founders: tuple[NodeId, ...]
    voters: tuple[NodeId, ...]
    log_key: PublicKey
    authority: bytes = b""
    charter: bytes = b""
    owners: tuple[bytes, ...] = ()
    trusted: tuple[NodeId, ...] = ()

    def __post_init__(self) -> None:
        known = [credential.node_id for credential in self.credentials]
        if not set(self.trusted) <= set(known):
            raise ValueError("who is trusted has a credential")
        for ids, above in ((known, known), (self.founders, known), (self.voters, self.founders)):
            if not ids or list(ids) != sorted(set(ids)) or not set(ids) <= set(above):
                raise ValueError("credentials, founders and voters are given in id order, each once and out of the ones before")
        if len(self.cluster_id) != 16:
            raise ValueError("a cluster id has 16 bytes")

    @property
    def voter(self) -> NodeId:
        """The one that decides the cluster's log, as long as there is one."""
        return self.voters[0]

    def credential(self, node: NodeId) -> Credential | None:
        """The credential of a node, None if the facts know none."""
        return self._by_id.get(node)

    @cached_property
    def genesis_header(self) -> SceneLogPublic:
        """The unsigned header of position 1 of the cluster's log. Its hash is the log's genesis, and gives its scene id."""
        key = KeyEntry(self.log_key.suite, self.log_key.raw)
        unborn = SceneLogPublic(
            scene=SceneId(1),
            genesis=bytes(32),
            origin=self.voter,
            position=GENESIS_POSITION,
            write_floor=0,
            mode=SceneMode.EDIT,
            spaces=(),
            writers=(),
            public_key=self.log_key.key_id,
            private_key=self.log_key.key_id,
            keys=(key,),
            first_key=key.raw,
            # Whoever has this key decides, and signs the headers with it: they need no decision besides.
            origin_key=key.raw,
        )
        return unborn.with_genesis()

    @cached_property
    def _by_id(self) -> dict[NodeId, Credential]:
        return {credential.node_id: credential for credential in self.credentials}
