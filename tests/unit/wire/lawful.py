"""Fields that keep their packet's or struct's law, made from fields that were drawn one by one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from scenefold.base.ids import NodeId
from scenefold.base.image_limits import ADAPTIVE_MAX, CLAMP_MAX, EXPOSURE_MAX, ROTATION_MAX, SAMPLERS, SKY_MAX
from scenefold.base.location import FIRST
from scenefold.wire.copy_packets import Copy, CopyState, Counted, Listed
from scenefold.wire.custody import Confirmed, CustodyEntry, Enough, LaidOut, Passed, PassedSegment, Rising, Single
from scenefold.wire.custody_packets import Assigned
from scenefold.wire.laws import All, Apart, Distinct, Inside, Law, Masked, Needs, OneOf, Only, Order, Pairs
from scenefold.wire.log_entries import Boxed
from scenefold.wire.members import Member
from scenefold.wire.render_settings import Sensible, Traceable


def lawful(law: Law | None, fields: dict[str, Any]) -> dict[str, Any]:
    """The same fields, as little changed as the law asks for; what it cannot mend is left to a filter."""
    match law:
        case All():
            for part in law.laws:
                fields = lawful(part, fields)
        case Order():
            lower, upper = fields[law.lower], fields[law.upper]
            if lower is not None and upper is not None and lower > upper:
                fields = {**fields, law.lower: upper, law.upper: lower}
        case Needs():
            if fields[law.needed] is None:
                fields = {**fields, law.field: None}
        case OneOf():
            fields = {**fields, law.second: fields[law.second] and not fields[law.first]}
        case Pairs():
            extras, count = fields[law.extras], len(fields[law.items])
            if len(extras) < count:
                fields = {**fields, law.extras: ()}
            else:
                fields = {**fields, law.extras: extras[:count]}
        case Boxed():
            sides = [sorted(pair) for pair in zip(fields["low"], fields["high"], strict=False)]
            low, high = tuple(pair[0] for pair in sides), tuple(pair[1] for pair in sides)
            fields = {**fields, "dimensions": len(sides), "low": low, "high": high}
        case Sensible():
            fields = _sensible(fields)
        case Traceable():
            fields = _traceable(fields)
        case Distinct():
            fields = {**fields, law.items: tuple(dict.fromkeys(fields[law.items]))}
        case Apart():
            fields = {**fields, law.second: tuple(item for item in fields[law.second] if item not in fields[law.first])}
        case Masked():
            kept = fields[law.address] >> (32 - fields[law.bits]) << (32 - fields[law.bits])
            fields = {**fields, law.address: kept}
        case Only() if fields[law.other] is not law.wanted:
            fields = {**fields, law.field: b"" if isinstance(fields[law.field], bytes) else None}
        case Only():
            # Nothing to put there: another value of the other field then.
            is_there = fields[law.field] is not None and fields[law.field] != b""
            fields = fields if is_there else {**fields, law.other: type(law.wanted)(0)}
        case Inside():
            first, last = fields["first"], fields["last"]
            clipped = [(arc, max(arc.first, first), min(arc.last, last)) for arc in fields[law.arcs]]
            inside = [(arc, *((low, high) if low <= high else (first, last))) for arc, low, high in clipped]
            fields = {**fields, law.arcs: tuple(replace(arc, first=low, last=high) for arc, low, high in inside)}
        case Enough():
            members = tuple(dict.fromkeys(fields["members"])) or (Member(NodeId(1), bytes(16)),)
            fields = {**fields, "members": members, "needed": min(fields["needed"], len(members))}
        case Rising():
            by_number = {found.number: found for found in fields["configurations"]}
            fields = {**fields, "configurations": tuple(by_number[number] for number in sorted(by_number))}
        case Passed():
            fields = _passed(fields)
        case Single():
            numbers = {found.member: found.number for found in fields["confirmed"]}
            fields = {**fields, "confirmed": tuple(Confirmed(member, number) for member, number in numbers.items())}
        case LaidOut():
            fields = {**fields, "layout": tuple(offset for offset in dict.fromkeys(fields["layout"]) if offset != FIRST)}
        case Assigned():
            fields = {**fields, "entries": _assigned(fields)}
        case Listed():
            records = fields["records"]
            fields = fields if records is None else {**fields, "count": len(records)}
        case Counted():
            count = len(fields["holders"])
            fields = {**fields, "copies": tuple(_under(copy, count) for copy in fields["copies"])}
        case None:
            pass
        case _:
            raise AssertionError(law)
    return fields


def _sensible(fields: dict[str, Any]) -> dict[str, Any]:
    """Both sides or neither; a sky and an exposure brought into their bounds."""
    sky, exposure = fields["sky"], fields["exposure"]
    return {
        **fields,
        "height": None if fields["width"] is None else fields["height"] or fields["width"],
        "sky": None if sky is None else tuple(min(abs(channel), SKY_MAX) for channel in sky),
        "camera": fields["camera"] or None,
        "exposure": None if exposure is None else max(-EXPOSURE_MAX, min(exposure, EXPOSURE_MAX)),
    }


def _traceable(fields: dict[str, Any]) -> dict[str, Any]:
    """A whole lens or none, a known sampler, numbers within their bounds, and always a bounce for roulette, so that something is said."""
    aperture, adaptive, sampler, turn = (fields[name] for name in ("aperture", "adaptive", "sampler", "environment_rotation"))
    return {
        **fields,
        **{name: None if fields[name] is None else _within(fields[name], 1e-3, CLAMP_MAX) for name in ("clamp_direct", "clamp_indirect")},
        "aperture": None if aperture is None else _within(aperture, 1e-3, 1e9),
        "focus": None if aperture is None else _within(fields["focus"] or 1.0, 1e-3, 1e9),
        "sampler": None if sampler is None else SAMPLERS[len(sampler) % len(SAMPLERS)],
        "roulette_from": fields["roulette_from"] or 1,
        "adaptive": None if adaptive is None else _within(adaptive, 1e-3, ADAPTIVE_MAX),
        "min_samples": None if adaptive is None else fields["min_samples"],
        "environment_rotation": None if turn is None else max(-ROTATION_MAX, min(turn, ROTATION_MAX)),
    }


def _within(value: float, least: float, most: float) -> float:
    return max(least, min(abs(value), most))


def _assigned(fields: dict[str, Any]) -> tuple[CustodyEntry, ...]:
    """The entries as the packet's owner may set them, those that overlap left out."""
    owner, found = fields["owner"], list[CustodyEntry]()
    for entry in fields["entries"]:
        if any(entry.layout == other.layout and entry.first <= other.last and other.first <= entry.last for other in found):
            continue
        members = (owner, *(member for member in entry.members[1:] if member != owner))
        needed = min(entry.needed, len(members))
        found.append(replace(entry, members=members, needed=needed, number=min(entry.number, fields["number"])))
    return tuple(found)


def _passed(fields: dict[str, Any]) -> dict[str, Any]:
    """The segments in order, those that overlap left out."""
    found = list[PassedSegment]()
    for segment in sorted(fields["segments"], key=lambda segment: (segment.layout, segment.first)):
        if not found or (found[-1].layout, found[-1].last) < (segment.layout, segment.first):
            found.append(segment)
    return {**fields, "segments": tuple(found)}


def _under(copy: Copy, count: int) -> Copy:
    """A copy that counts under one of so many holders; with none of them it counts for nothing."""
    if copy.state == CopyState.NO_CUSTODY or not count:
        return Copy(CopyState.NO_CUSTODY, 0, b"", None)
    return replace(copy, holders=copy.holders % count)
