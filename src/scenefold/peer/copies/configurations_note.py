"""An owner's configurations as the bytes of the store's note, and back, strictly (specs/20-copies.md, Configurations). Pure."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.limits import CONFIGURATIONS_MAX, COPIES_MAX
from scenefold.base.plain_values import whole
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.notes import Known, Names, arc_of, number_of, plain_arc
from scenefold.peer.copies.segment import Change, Segment
from scenefold.wire import Configuration, MalformedPacket, Member, pack_value, unpack_value

_VERSION = 1
_KEYS = {"layouts", "me", "members", "number", "segments", "v"}


def encode_configurations(configurations: Configurations) -> bytes:
    names = Names()
    me = names.member(configurations.me)
    segments = [_plain(names, segment) for segment in configurations.segments]
    return pack_value(
        {"v": _VERSION, "me": me, "number": configurations.number, "segments": segments, **names.plain()}, what="configurations"
    )


def _plain(names: Names, segment: Segment) -> list[Any]:
    change = segment.change
    return [
        names.layout(segment.layout),
        *plain_arc(segment.arc),
        [[found.number, names.members(found.members), found.needed] for found in segment.configurations],
        None if change is None else [change.number, names.members(change.holders), change.needed],
        [[names.member(member), bound] for member, bound in sorted(segment.confirmed, key=lambda found: _order(found[0]))],
        names.members(sorted(segment.sound, key=_order)),
        segment.leaving,
    ]


def _order(member: Member) -> tuple[int, bytes]:
    return member.node, member.incarnation


def decode_configurations(note: bytes) -> Configurations:
    """DamagedData if the note is none that `encode_configurations` writes."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or value.get("v") != _VERSION or set(value) != _KEYS:
            raise ValueError("not the fields of configurations")
        known = Known(value)
        segments = tuple(_segment(known, *segment) for segment in value["segments"])
        configurations = Configurations(known.member(value["me"]), number_of(value["number"]), segments)
        check_configurations(configurations)
        if encode_configurations(configurations) != note:
            raise ValueError("said in another way than it is written")
    except (MalformedPacket, ValueError, TypeError, IndexError, KeyError) as problem:
        raise DamagedData(
            "the note about who holds copies of this node's arc is damaged",
            where=str(problem),
            remedy="wipe the folder: the node comes back as a newcomer",
        ) from problem
    return configurations


def _segment(
    known: Known, layout: Any, first: Any, last: Any, configurations: Any, change: Any, confirmed: Any, sound: Any, leaving: Any
) -> Segment:
    return Segment(
        known.layout(layout),
        arc_of(first, last),
        tuple(_configuration(known, *found) for found in configurations),
        None if change is None else _change(known, *change),
        frozenset((known.member(member), number_of(bound)) for member, bound in confirmed),
        frozenset(map(known.member, sound)),
        number_of(leaving),
    )


def _configuration(known: Known, number: Any, members: Any, needed: Any) -> Configuration:
    named = known.members(members)
    return Configuration(number_of(number), named, whole(needed, 1, len(named)))


def _change(known: Known, number: Any, holders: Any, needed: Any) -> Change:
    return Change(number_of(number), known.members(holders, least=0), whole(needed, 1, COPIES_MAX))


def check_configurations(configurations: Configurations) -> None:
    """ValueError for what is never written, so that nobody who lies can have a node write what it could not read again."""
    for segment, following in pairwise(configurations.segments):
        if (segment.layout, segment.arc.last) >= (following.layout, following.arc.first):
            raise ValueError("segments that are not in order, or said twice")
    if sum(max(1, len(segment.configurations)) for segment in configurations.segments) > CONFIGURATIONS_MAX:
        raise ValueError("more than is ever kept")
    for segment in configurations.segments:
        if any(one.rank >= other.rank for one, other in pairwise(segment.configurations)):
            raise ValueError("configurations that are not in order, or said twice")
        if max([*(found.number for found in segment.configurations), segment.leaving]) > configurations.number:
            raise ValueError("numbers above the highest one")
        if len(dict(segment.confirmed)) < len(segment.confirmed):
            raise ValueError("a member that confirms two numbers")
