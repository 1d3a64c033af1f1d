"""Custody as the bytes of the store's note, and back, strictly (specs/20-copies.md, Custody). Pure."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.limits import CUSTODY_FLOORS_MAX, CUSTODY_KEPT_MAX
from scenefold.base.plain_values import whole
from scenefold.peer.copies.custody import Custody, Floor
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.notes import Known, Names, arc_of, number_of, plain_arc, truth
from scenefold.wire import MalformedPacket, pack_value, unpack_value

_VERSION = 1
_KEYS = {"entries", "floors", "layouts", "members", "v"}


def encode_custody(custody: Custody) -> bytes:
    names = Names()
    entries = [
        [
            names.layout(entry.layout),
            *plain_arc(entry.arc),
            entry.number,
            names.members(entry.members),
            entry.needed,
            entry.whole,
            entry.fenced,
        ]
        for entry in custody.entries
    ]
    floors = [[*plain_arc(floor.arc), floor.number] for floor in custody.floors]
    return pack_value({"v": _VERSION, "entries": entries, "floors": floors, **names.plain()}, what="custody")


def decode_custody(note: bytes) -> Custody:
    """DamagedData if the note is none that `encode_custody` writes."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or value.get("v") != _VERSION or set(value) != _KEYS:
            raise ValueError("not the fields of custody")
        known = Known(value)
        custody = Custody(
            tuple(_entry(known, *entry) for entry in value["entries"]),
            tuple(Floor(arc_of(first, last), number_of(number)) for first, last, number in value["floors"]),
        )
        check_custody(custody)
        if encode_custody(custody) != note:
            raise ValueError("said in another way than it is written")
    except (MalformedPacket, ValueError, TypeError, IndexError, KeyError) as problem:
        raise DamagedData(
            "the note about what this node holds for others is damaged",
            where=str(problem),
            remedy="wipe the folder: the node comes back as a newcomer",
        ) from problem
    return custody


def _entry(known: Known, layout: Any, first: Any, last: Any, number: Any, members: Any, needed: Any, is_whole: Any, fenced: Any) -> Entry:
    named = known.members(members)
    return Entry(
        known.layout(layout), arc_of(first, last), number_of(number), named, whole(needed, 1, len(named)), truth(is_whole), truth(fenced)
    )


def check_custody(custody: Custody) -> None:
    """ValueError for what is never written, so that nobody who lies can have a node write what it could not read again."""
    if len(custody.entries) > CUSTODY_KEPT_MAX or len(custody.floors) > CUSTODY_FLOORS_MAX:
        raise ValueError("more than is ever kept")
    places = [(entry.layout, entry.arc) for entry in custody.entries]
    floors = [((), floor.arc) for floor in custody.floors]
    for found in (places, floors):
        for (layout, arc), (following, after) in pairwise(found):
            if (layout, arc.last) >= (following, after.first):
                raise ValueError("places that are not in order, or said twice")
