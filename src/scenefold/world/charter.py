"""A cluster's charter: what a newcomer must believe of it, signed by its authority (specs/15-cluster-log.md, Enrolling).

Made once, by `cluster init`; whoever hands it over, its signature tells that it is the cluster's own. The cluster's facts follow from it
and from the authority's certificate alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import NODES_MAX, PARTICIPANTS_MAX
from scenefold.crypto import CARD_BYTES_MAX, Authority, Card, PublicKey, SealingPublicKey, check_signed
from scenefold.wire.common import U16, U32
from scenefold.wire.containers import Many, Struct
from scenefold.wire.errors import MalformedPacket
from scenefold.wire.kinds import Bin, Text
from scenefold.wire.pieces import pack_piece, unpack_piece
from scenefold.world.facts import ClusterFacts, Credential
from scenefold.world.ports import Ports

CHARTER_DOMAIN = b"scenefold/charter"
CHARTER_BYTES_MAX = 256 * 1024
SEEDS_MAX = 3
_OWNERS_MAX = 16


@dataclass(frozen=True, slots=True)
class CharteredNode:
    """A founder."""

    node: NodeId
    key: bytes
    sealing_key: bytes


@dataclass(frozen=True, slots=True)
class Charter:
    """`owners`: cards of the users that the cluster began with."""

    name: str
    cluster_id: bytes
    low_port: int
    high_port: int
    founders: tuple[CharteredNode, ...]
    voters: tuple[NodeId, ...]
    log_key: bytes
    owners: tuple[bytes, ...]

    @classmethod
    def of(cls, facts: ClusterFacts) -> Self:
        """The charter that says these facts."""
        founders = [credential for credential in facts.credentials if credential.node_id in facts.founders]
        return cls(
            name=facts.name,
            cluster_id=facts.cluster_id,
            low_port=facts.ports.low,
            high_port=facts.ports.high,
            founders=tuple(CharteredNode(one.node_id, one.public_key.raw, one.sealing_key.raw) for one in founders),
            voters=facts.voters,
            log_key=facts.log_key.raw,
            owners=facts.owners,
        )

    def signed(self, authority: Authority) -> bytes:
        """The charter with the authority's signature."""
        body = pack_piece(_CHARTER, self, size_max=CHARTER_BYTES_MAX)
        return pack_piece(_SIGNED, _Signed(body, authority.sign(CHARTER_DOMAIN, body)), size_max=CHARTER_BYTES_MAX)


@dataclass(frozen=True, slots=True)
class _Signed:
    charter: bytes
    signature: bytes


_KEY = Bin(lengths=(32,))
_NODE = Struct(CharteredNode, ("node", U32), ("key", _KEY), ("sealing_key", _KEY))
_CHARTER = Struct(
    Charter,
    ("name", Text(200)),
    ("cluster_id", Bin(lengths=(16,))),
    ("low_port", U16),
    ("high_port", U16),
    ("founders", Many(_NODE, NODES_MAX)),
    ("voters", Many(U32, PARTICIPANTS_MAX)),
    ("log_key", _KEY),
    ("owners", Many(Bin(CARD_BYTES_MAX), _OWNERS_MAX)),
)
_SIGNED = Struct(_Signed, ("charter", Bin(CHARTER_BYTES_MAX)), ("signature", Bin(128)))


def facts_of(charter: bytes, authority: bytes) -> ClusterFacts:
    """What a signed charter says, believed by the authority's certificate (PEM); DamagedData if it is not its, or says what cannot be."""
    try:
        known = unpack_piece(_SIGNED, charter, size_max=CHARTER_BYTES_MAX)
        check_signed(authority, known.signature, CHARTER_DOMAIN, known.charter)
        said = unpack_piece(_CHARTER, known.charter, size_max=CHARTER_BYTES_MAX)
        for owner in said.owners:
            Card.verified(owner, authority)
        founders = tuple(
            Credential(one.node, address_of(one.node), PublicKey(one.key), SealingPublicKey(one.sealing_key)) for one in said.founders
        )
        return ClusterFacts(
            name=said.name,
            cluster_id=said.cluster_id,
            ports=Ports(said.low_port, said.high_port),
            seeds=tuple(founder.address for founder in founders[:SEEDS_MAX]),
            credentials=founders,
            founders=tuple(founder.node_id for founder in founders),
            voters=said.voters,
            log_key=PublicKey(said.log_key),
            owners=said.owners,
            authority=authority,
            charter=charter,
        )
    except (MalformedPacket, ValueError, LocalFault) as problem:
        raise DamagedData(f"the cluster's charter says what cannot be: {problem}") from problem
