"""What may have been lost, as the bytes of the store's note, and back, strictly (specs/20-copies.md, What is lost). Pure."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.base.limits import COPIES_MAX
from scenefold.base.plain_values import exactly, whole
from scenefold.peer.copies.notes import arc_of, plain_arc, truth
from scenefold.wire import MalformedPacket, Member, NotedLoss, pack_value, unpack_value
from scenefold.wire.copy_packets import Span
from scenefold.wire.loss_packets import LOSS_ARCS_MAX, LOSS_ID_BYTES, LOSS_NODES_MAX, LOSSES_KEPT_MAX

NOTE = "losses"
ACKNOWLEDGED_MAX = 256
"""Remembered, so that nobody who was away brings one back. Of more the oldest are forgotten."""
_VERSION = 1
_KEYS = {"acknowledged", "losses", "v"}
_NODE_MAX = (1 << 32) - 1
_MS_MAX = (1 << 64) - 1


@dataclass(frozen=True, slots=True)
class Losses:
    """What a node keeps, the oldest first. Transitions answer the value after them, the same one if nothing changes."""

    kept: tuple[NotedLoss, ...] = ()
    acknowledged: tuple[bytes, ...] = ()

    @property
    def ids(self) -> tuple[bytes, ...]:
        return tuple(map(id_of, self.kept))

    def add(self, *losses: NotedLoss) -> Losses:
        """With those that are not known yet, and that nobody has acknowledged here. Where there are too many, whoever notes most has the fewest kept."""
        found = {id_of(loss): loss for loss in self.kept}
        for loss in losses:
            name = id_of(loss)
            if name not in found and name not in self.acknowledged:
                found[name] = loss
                if len(found) > LOSSES_KEPT_MAX:
                    counts = Counter(one.noted_by for one in found.values())
                    most = max(counts, key=lambda node: (counts[node], node == loss.noted_by))
                    del found[next(name for name in reversed(found) if found[name].noted_by == most)]
        return self if tuple(found.values()) == self.kept else Losses(tuple(found.values()), self.acknowledged)

    def acknowledge(self, ids: tuple[bytes, ...]) -> Losses:
        """Without these, also if they are told again."""
        new = tuple(name for name in dict.fromkeys(ids) if name not in self.acknowledged)
        if not new:
            return self
        left = tuple(loss for loss in self.kept if id_of(loss) not in new)
        return Losses(left, (*self.acknowledged, *new)[-ACKNOWLEDGED_MAX:])


def id_of(loss: NotedLoss) -> bytes:
    """The same for what is found once more, as after a crash; when it was found does not count."""
    return sha256(pack_value(_plain(loss, noted_ms=0), what="a loss")).digest()[:LOSS_ID_BYTES]


def encode_losses(losses: Losses) -> bytes:
    kept = [_plain(loss, loss.noted_ms) for loss in losses.kept]
    return pack_value({"v": _VERSION, "losses": kept, "acknowledged": list(losses.acknowledged)}, what="losses")


def _plain(loss: NotedLoss, noted_ms: int) -> list[Any]:
    removed = [[member.node, member.incarnation] for member in loss.removed]
    return [loss.noted_by, noted_ms, loss.copies, loss.is_left, removed, [plain_arc(span.arc) for span in loss.arcs]]


def decode_losses(note: bytes) -> Losses:
    """DamagedData if the note is none that `encode_losses` writes."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or value.get("v") != _VERSION or set(value) != _KEYS:
            raise ValueError("not the fields of losses")
        acknowledged = tuple(exactly(name, LOSS_ID_BYTES) for name in value["acknowledged"])
        losses = Losses(tuple(_loss(*found) for found in value["losses"]), acknowledged)
        if len(losses.kept) > LOSSES_KEPT_MAX or encode_losses(losses) != note:
            raise ValueError("more than is kept, or said in another way than it is written")
    except (MalformedPacket, ValueError, TypeError) as problem:
        remedy = "`scenectl node repair` lets the node forget what was lost: look at `scenectl cluster health` of the others first"
        raise DamagedData("the note of what may have been lost is damaged", where=str(problem), remedy=remedy) from problem
    return losses


def _loss(noted_by: Any, noted_ms: Any, copies: Any, is_left: Any, removed: Any, arcs: Any) -> NotedLoss:
    members = tuple(Member(NodeId(whole(node, 0, _NODE_MAX)), exactly(incarnation, 16)) for node, incarnation in removed)
    spans = tuple(Span(found.first, found.last) for found in (arc_of(first, last) for first, last in arcs))
    if len(members) > LOSS_NODES_MAX or len(spans) > LOSS_ARCS_MAX:
        raise ValueError("more than a loss names")
    return NotedLoss(
        NodeId(whole(noted_by, 0, _NODE_MAX)), whole(noted_ms, 0, _MS_MAX), whole(copies, 2, COPIES_MAX), truth(is_left), members, spans
    )
