"""A scene's keys on their way to those who render it: sealed to the nodes that the client chose, and to nobody else (specs/19-jobs.md). Pure.

A sealing key is made for each job. The scene's keys are sealed to it once, and its seed to each node, so a job does not grow with
the number of nodes times that of keys.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Self

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RENDER_PURPOSE, SealingKey, SealingPublicKey
from scenefold.scene.log import EpochKeys
from scenefold.wire import MalformedPacket, pack_value, unpack_value

SEED_BYTES = 32
BOX_BYTES_MAX = 512
SEALED_BYTES_MAX = 128 * 1024
Token = Callable[[int], bytes]


@dataclass(frozen=True, slots=True)
class SealedKeys:
    """`boxes`: the seed of the job's own key, sealed to each node, in id order. `keys`: the scene's, sealed to that key."""

    boxes: tuple[tuple[NodeId, bytes], ...]
    keys: bytes = field(repr=False)

    @property
    def nodes(self) -> frozenset[NodeId]:
        """Those that can open them."""
        return frozenset(node for node, _ in self.boxes)

    def row(self) -> list[Any]:
        """Plain values."""
        return [[[int(node), box] for node, box in self.boxes], self.keys]

    @classmethod
    def of_row(cls, row: Any) -> Self:
        """What `row` gave; ValueError or TypeError for anything else."""
        rows, keys = row
        boxes = tuple((NodeId(node), box) for node, box in rows)
        whole = all(type(node) is int and 0 <= node < 1 << 32 and _is_bytes(box, BOX_BYTES_MAX) for node, box in boxes)
        if not whole or not _is_bytes(keys, SEALED_BYTES_MAX) or len(boxes) > POOL_NODES_MAX:
            raise ValueError("boxes for nodes, and what they open, are expected")
        if any(one >= following for (one, _), (following, _) in pairwise(boxes)):
            raise ValueError("the boxes are in no order of their nodes")
        return cls(boxes, keys)


NO_KEYS = SealedKeys((), b"")
"""Of a job that no node reads anything for."""


@dataclass(frozen=True, slots=True)
class About:
    """What keys are sealed for; they open for nothing else."""

    cluster: bytes
    genesis: bytes
    job: int

    def context(self, node: NodeId | None = None) -> bytes:
        whom = b"" if node is None else node.to_bytes(4, "big")
        return b"".join((self.cluster, self.genesis, self.job.to_bytes(8, "big"), whom))


def seal_keys(keys: EpochKeys, recipients: Mapping[NodeId, SealingPublicKey], about: About, token: Token) -> SealedKeys:
    """The keys for these nodes. `token` draws random bytes."""
    own = SealingKey(token(SEED_BYTES))
    sealed = own.public.seal(pack_value({"keys": keys.rows()}), RENDER_PURPOSE, about.context(), token)
    boxes = tuple((node, recipients[node].seal(own.seed, RENDER_PURPOSE, about.context(node), token)) for node in sorted(recipients))
    return SealedKeys(boxes, sealed)


def open_keys(sealed: SealedKeys, node: NodeId, key: SealingKey, about: About) -> EpochKeys:
    """What was sealed to this node. Refused (12) if nothing was; DamagedData if it does not open, PeerFault if it holds no keys."""
    box = dict(sealed.boxes).get(node)
    if box is None:
        what = "the scene's keys are not sealed to this node, so it cannot render it"
        remedy = "trust it (`scenectl cluster trust`) or grant it the scene (`scenectl scene grant`)"
        raise Refused(RejectReason.NOT_AUTHORISED, what, where=address_of(node), remedy=remedy)
    try:
        own = SealingKey(key.open(box, RENDER_PURPOSE, about.context(node)))
        plain = own.open(sealed.keys, RENDER_PURPOSE, about.context())
        return EpochKeys.of_rows(unpack_value(plain, what="a scene's keys")["keys"])
    except DamagedData as problem:
        raise DamagedData(f"the scene's keys do not open here: {problem.what}", where=address_of(node)) from problem
    except (LocalFault, MalformedPacket, KeyError, TypeError, ValueError) as problem:
        raise PeerFault("what was sealed to this node holds no keys", where=address_of(node)) from problem


def _is_bytes(value: object, most: int) -> bool:
    return isinstance(value, bytes) and len(value) <= most
