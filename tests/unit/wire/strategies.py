"""Hypothesis strategies made from the table of packets: every value that a kind allows, edges included."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from scenefold.base.location import Location
from scenefold.wire.common import MINI_STATUS, Packet
from scenefold.wire.containers import Late, Many, Struct, Tagged
from scenefold.wire.kinds import Bin, Choice, Flag, Float, Kind, Maybe, Nothing, Place, Text, Uint
from scenefold.wire.table import ROWS
from unit.wire.lawful import lawful


def values(kind: Kind[Any]) -> st.SearchStrategy[Any]:
    """Values of this kind; long ones rarely, or every example would take seconds."""
    match kind:
        case Uint():
            edges = [edge for edge in (0, 31, 32, 127, 128, 255, 256, 65535, 65536, 2**32 - 1, 2**32) if kind.least <= edge <= kind.most]
            return st.one_of(st.integers(kind.least, kind.most), st.sampled_from([*edges, kind.least, kind.most]))
        case Choice():
            return st.sampled_from(list(kind.members))
        case Flag():
            return st.booleans()
        case Float():
            least = 0.0 if kind.positive else None
            return st.floats(min_value=least, exclude_min=kind.positive, allow_nan=False, allow_infinity=False)
        case Bin() if kind.lengths:
            return st.one_of(*(st.binary(min_size=size, max_size=size) for size in kind.lengths if size <= 64))
        case Bin():
            sizes = st.sampled_from([0, 1, 255, 256, 65535, 65536]).filter(lambda size: size <= kind.size_max)
            return st.one_of(st.binary(max_size=40), sizes.map(lambda size: b"\x93" * size))
        case Text():
            return st.text(max_size=20).filter(lambda text: len(text.encode("utf-8", "replace")) <= kind.size_max)
        case Place():
            return st.binary(min_size=20, max_size=20).map(Location)
        case Nothing():
            return st.none()
        case Late():
            return st.one_of(st.just(kind.absent), values(kind.inner))
        case Maybe():
            return st.one_of(st.none(), values(kind.inner))
        case Many() if kind.counts:
            return st.one_of(*(st.tuples(*[values(kind.inner)] * count) for count in kind.counts))
        case Many():
            return st.lists(values(kind.inner), max_size=3).map(tuple)
        case Struct():
            return _lawful_values(kind)
        case Tagged():
            return st.one_of(*(values(struct) for struct in kind.structs.values()))
    raise AssertionError(kind)


def _lawful_values(kind: Struct[Any]) -> st.SearchStrategy[Any]:
    law = kind.law
    fields = st.fixed_dictionaries({name: values(inner) for name, inner in kind.fields})
    made = fields.map(lambda drawn: kind.build(**lawful(law, drawn)))
    return made.filter(law.holds) if law else made


def packets_of(number: int) -> st.SearchStrategy[Packet]:
    row = ROWS[number]
    mini_status = st.none() if number == 1 else st.one_of(st.none(), values(MINI_STATUS))
    law = row.law
    fields = st.fixed_dictionaries({name: values(kind) for name, kind in row.fields}).map(lambda drawn: lawful(law, drawn))
    packets = st.builds(
        lambda drawn, request_id, mini_status: row.packet(**drawn, request_id=request_id, mini_status=mini_status),
        fields,
        st.integers(0, 2**32 - 1),
        mini_status,
    )
    return packets.filter(law.holds) if law else packets


PACKETS = st.sampled_from(sorted(ROWS)).flatmap(packets_of)
