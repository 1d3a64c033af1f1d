"""A holding as the bytes of the store's note, and back, strictly (specs/12-line.md, Holding). Pure.

The arc stands in the note as well as beside it, where puts are checked against: a note that speaks of another arc than
the store's is not trusted, since either may be the older one.
"""

from __future__ import annotations

from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.base.limits import NODES_MAX
from scenefold.base.location import Arc, Location
from scenefold.peer.line.ends import is_end_of
from scenefold.peer.line.holding import HANDOVER_BYTES, Handover, Heard, Holding, Step
from scenefold.wire import MalformedPacket, Member, pack_value, unpack_value

_VERSION = 1
_KEYS = {"arc", "heard", "left", "revision", "right", "v"}
_INCARNATION_BYTES = 16


def encode_holding(holding: Holding) -> bytes:
    return pack_value(
        {
            "v": _VERSION,
            "arc": None if holding.arc is None else [bytes(holding.arc.first), bytes(holding.arc.last)],
            "left": _plain(holding.left),
            "right": _plain(holding.right),
            "revision": holding.revision,
            "heard": [[heard.giver.node, heard.giver.incarnation, heard.number] for heard in holding.heard],
        },
        what="holding",
    )


def _plain(handover: Handover | None) -> list[Any] | None:
    if handover is None:
        return None
    peer, piece = handover.peer, handover.piece
    return [handover.id, str(handover.step), peer.node, peer.incarnation, bytes(piece.first), bytes(piece.last)]


def decode_holding(note: bytes) -> Holding:
    """DamagedData if the note is none that `encode_holding` writes."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or value.get("v") != _VERSION or set(value) != _KEYS:
            raise ValueError("not the fields of a holding")
        holding = Holding(
            arc=None if value["arc"] is None else _arc(*value["arc"]),
            left=_handover(value["left"]),
            right=_handover(value["right"]),
            revision=_number(value["revision"]),
            heard=tuple(Heard(_member(node, incarnation), _number(number)) for node, incarnation, number in value["heard"]),
        )
        _check(holding)
    except (MalformedPacket, ValueError, TypeError) as problem:
        raise DamagedData(
            "the note about this node's arc is damaged", where=str(problem), remedy="wipe the folder: the node comes back as a newcomer"
        ) from problem
    return holding


def _handover(value: Any) -> Handover | None:
    if value is None:
        return None
    identity, step, node, incarnation, first, last = value
    if not isinstance(identity, bytes) or len(identity) != HANDOVER_BYTES:
        raise ValueError("a handover's id has 16 bytes")
    return Handover(identity, Step(step), _member(node, incarnation), _arc(first, last))


def _arc(first: Any, last: Any) -> Arc:
    if not (isinstance(first, bytes) and isinstance(last, bytes)):
        raise TypeError("an arc is two locations")
    return Arc(Location(first), Location(last))


def _member(node: Any, incarnation: Any) -> Member:
    if not isinstance(incarnation, bytes) or len(incarnation) != _INCARNATION_BYTES:
        raise ValueError("an incarnation has 16 bytes")
    return Member(NodeId(_number(node)), incarnation)


def _number(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError("not a number from 0 on")
    return value


def _check(holding: Holding) -> None:
    """What every holding that this code made fulfils."""
    if len(holding.heard) > NODES_MAX:
        raise ValueError("more givers than nodes")
    for side, handover in holding.handovers:
        arc, piece = holding.arc, handover.piece
        if handover.step is Step.OFFERED and (arc is None or not is_end_of(piece, arc, side)):
            raise ValueError(f"what is offered is not the {side} end of the arc")
        if handover.step in (Step.RELEASED, Step.NOTED) and arc is not None and arc.intersection(piece) is not None:
            raise ValueError(f"what is on its way on the {side} lies in the arc")
