"""What a node keeps about copies as the bytes of the store's note, and back, strictly (specs/20-copies.md). Pure."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.plain_values import exactly
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.configurations_note import check_configurations, decode_configurations, encode_configurations
from scenefold.peer.copies.copies import Copies, Passing
from scenefold.peer.copies.custody_note import check_custody, decode_custody, encode_custody
from scenefold.peer.copies.notes import arc_of, number_of, plain_arc
from scenefold.peer.line.holding import HANDOVER_BYTES
from scenefold.wire import MalformedPacket, Member, pack_value, unpack_value

_VERSION = 1
_KEYS = {"configurations", "custody", "passing", "unrecovered", "v"}


def encode_copies(copies: Copies) -> bytes:
    return pack_value(
        {
            "v": _VERSION,
            "configurations": encode_configurations(copies.configurations),
            "custody": encode_custody(copies.custody),
            "passing": [[found.handover, encode_configurations(_as_configurations(copies, found))] for found in copies.passing],
            "unrecovered": [plain_arc(gap) for gap in copies.unrecovered],
        },
        what="copies",
    )


def decode_copies(note: bytes, me: Member) -> Copies:
    """DamagedData if the note is none that `encode_copies` writes, or another incarnation's."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or value.get("v") != _VERSION or set(value) != _KEYS:
            raise ValueError("not the fields of what is kept about copies")
        copies = Copies(
            decode_configurations(value["configurations"]),
            decode_custody(value["custody"]),
            tuple(_passing(handover, told) for handover, told in value["passing"]),
            tuple(arc_of(first, last) for first, last in value["unrecovered"]),
        )
        if copies.configurations.me != me:
            raise ValueError("kept by another incarnation")
        _check_unrecovered(copies)
    except (MalformedPacket, ValueError, TypeError) as problem:
        raise DamagedData(
            "the note about copies is damaged", where=str(problem), remedy="wipe the folder: the node comes back as a newcomer"
        ) from problem
    return copies


def check_copies(copies: Copies) -> None:
    """Before it is written. ValueError for what nobody could read again."""
    check_configurations(copies.configurations)
    check_custody(copies.custody)
    for found in copies.passing:
        check_configurations(_as_configurations(copies, found))
    _check_unrecovered(copies)


def _check_unrecovered(copies: Copies) -> None:
    if any(part.last >= following.first for part, following in pairwise(copies.unrecovered)):
        raise ValueError("unrecovered parts that are not in order")


def _as_configurations(copies: Copies, passing: Passing) -> Configurations:
    return Configurations(copies.configurations.me, passing.number, passing.segments)


def _passing(handover: Any, told: Any) -> Passing:
    found = decode_configurations(told)
    return Passing(exactly(handover, HANDOVER_BYTES), number_of(found.number), found.segments)
