"""If this fails, custody can be told in ways that contradict themselves, or a status outgrows its datagram."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import msgpack
import pytest

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.limits import (
    BLACKLIST_MAX,
    CONFIGURATIONS_MAX,
    COPIES_MAX,
    CUSTODY_ENTRIES_MAX,
    FRAME_BYTES_MAX,
    HANDOVER_BATCH_RECORDS_MAX,
    SHADOWS_MAX,
)
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.prefixes import AddressPrefix
from scenefold.peer.datagrams.contents import PACKET_BYTES_MAX
from scenefold.wire import (
    ROWS,
    ArcSum,
    BlacklistChanged,
    ChangeBlacklist,
    ClaimRange,
    CompareRange,
    Configuration,
    Confirmed,
    CopiesFound,
    CopiesStored,
    Copy,
    CopyState,
    CustodyEntry,
    GetCopies,
    HeldFetched,
    HeldListed,
    ListedRecord,
    ListHeld,
    MalformedPacket,
    Member,
    Packet,
    PassedSegment,
    PingBroadcast,
    RangeCompared,
    RecordBytes,
    RecordKey,
    RecordVersion,
    SceneTurn,
    SetCustody,
    Span,
    Status,
    decode_packet,
    encode_packet,
)

ADA, BOB, EVE = NodeId(1), NodeId(2), NodeId(3)
OWNER, HOLDER, THIRD = (Member(node, bytes(16)) for node in (ADA, BOB, EVE))
LOW, MIDDLE, HIGH = (Location.from_number(number << 150) for number in (1, 2, 3))
LAYOUT = (MIDDLE, HIGH)
ENTRY = CustodyEntry(LAYOUT, LOW, MIDDLE, 5, (OWNER, HOLDER), 2, True)
UNDER = Configuration(5, (OWNER, HOLDER), 2)
PASSED = PassedSegment(LAYOUT, LOW, MIDDLE, (UNDER, replace(UNDER, number=6, members=(THIRD, HOLDER))), (Confirmed(HOLDER, 6),))
VERSION = RecordVersion(1, 2, 3, 4, b"d" * 32)
BYTES = RecordBytes(bytes(64), b"header", b"text")


def setting(*entries: CustodyEntry, **changes: Any) -> SetCustody:
    return replace(SetCustody(OWNER, HOLDER, 5, LOW, HIGH, entries), **changes)


def found(*copies: Copy) -> CopiesFound:
    return CopiesFound((UNDER,), copies)


GOOD: list[Packet] = [
    setting(),
    setting(ENTRY),
    setting(ENTRY, replace(ENTRY, first=MIDDLE.next(), last=HIGH, number=4)),
    setting(ENTRY, replace(ENTRY, layout=(LAST,))),
    ClaimRange(bytes(16), LOW, HIGH),
    ClaimRange(bytes(16), LOW, HIGH, 7, (PASSED, replace(PASSED, first=MIDDLE.next(), last=HIGH, configurations=(), confirmed=()))),
    CopiesFound((), (Copy(CopyState.NO_CUSTODY, 0, b"", None),)),
    found(*(Copy(state, 0, b"", None) for state in (CopyState.NOTHING, CopyState.DAMAGED, CopyState.NO_CUSTODY))),
    found(Copy(CopyState.DIGEST, 0, b"d" * 32, None), Copy(CopyState.RECORD, 0, b"", BYTES)),
    RangeCompared((ArcSum(1 << 40, bytes(32), None, True), ArcSum(0, bytes(32), (), False))),
    RangeCompared((ArcSum(1, bytes(32), (ListedRecord(LOW, b"", VERSION),), True),)),
    CopiesStored((0, 22, 10), "why"),
    HeldListed(0, (), (ENTRY,), None),
    HeldListed(0, (), (ENTRY,), None, (SceneTurn(SceneId(1), 1), SceneTurn(SceneId(7), 1 << 40))),
    HeldFetched((), (3, 1)),
    ChangeBlacklist(),
    ChangeBlacklist((AddressPrefix(0, 0),), (AddressPrefix(0, 1), AddressPrefix(7, 32)), 0),
    BlacklistChanged(1, ()),
]


@pytest.mark.parametrize("packet", GOOD, ids=lambda packet: type(packet).__name__)
def test_what_makes_sense_is_taken(packet: Packet) -> None:
    assert decode_packet(encode_packet(packet)) == packet


@pytest.mark.parametrize(
    ("packet", "field", "problem"),
    [
        (setting(replace(ENTRY, members=(HOLDER, OWNER))), "SetCustody", "owner first of members of entries"),
        (setting(replace(ENTRY, members=(Member(ADA, b"i" * 16), HOLDER))), "SetCustody", "owner first of members of entries"),
        (setting(replace(ENTRY, number=6)), "SetCustody", "number at most"),
        (setting(ENTRY, replace(ENTRY, first=MIDDLE)), "SetCustody", "of one layout apart"),
        (setting(ENTRY, first=MIDDLE), "SetCustody", "entries in first to last"),
        (setting(ENTRY, last=LOW), "SetCustody", "entries in first to last"),
        (setting(first=HIGH, last=LOW), "SetCustody", "first ≤ last"),
        (setting(replace(ENTRY, first=MIDDLE, last=LOW)), "SetCustody.entries[0]", "first ≤ last"),
        (setting(replace(ENTRY, members=())), "SetCustody.entries[0]", "needed of them at most all"),
        (setting(replace(ENTRY, needed=3)), "SetCustody.entries[0]", "needed of them at most all"),
        (setting(replace(ENTRY, members=(OWNER, HOLDER, HOLDER))), "SetCustody.entries[0]", "members distinct"),
        (setting(replace(ENTRY, members=(OWNER,) * 9)), "SetCustody.entries[0].members", "at most 8"),
        (setting(replace(ENTRY, needed=0)), "SetCustody.entries[0].needed", "outside"),
        (setting(replace(ENTRY, needed=9)), "SetCustody.entries[0].needed", "outside"),
        (setting(replace(ENTRY, layout=(LOW, FIRST))), "SetCustody.entries[0]", "offsets in layout distinct and not 0"),
        (setting(replace(ENTRY, layout=(LOW, LOW))), "SetCustody.entries[0]", "offsets in layout distinct and not 0"),
        (ClaimRange(bytes(16), MIDDLE, HIGH, 6, (PASSED,)), "ClaimRange", "segments in first to last"),
        (ClaimRange(bytes(16), LOW, HIGH, 6, (PASSED, PASSED)), "ClaimRange", "of one layout apart"),
        (ClaimRange(bytes(16), LOW, HIGH, 6, (PASSED, replace(PASSED, first=MIDDLE, last=HIGH))), "ClaimRange", "of one layout apart"),
        (
            ClaimRange(bytes(16), LOW, HIGH, 6, (replace(PASSED, first=MIDDLE.next(), last=HIGH), PASSED)),
            "ClaimRange",
            "segments by layout and place",
        ),
        (
            ClaimRange(bytes(16), LOW, HIGH, 1, (replace(PASSED, configurations=PASSED.configurations[::-1]),)),
            "ClaimRange.segments[0]",
            "configurations by number, members, needed",
        ),
        (
            ClaimRange(bytes(16), LOW, HIGH, 1, (replace(PASSED, confirmed=(Confirmed(HOLDER, 1), Confirmed(HOLDER, 2))),)),
            "ClaimRange.segments[0]",
            "members of confirmed distinct",
        ),
        (found(Copy(CopyState.NOTHING, 1, b"", None)), "CopiesFound", "a place in holders"),
        (CopiesFound((), (Copy(CopyState.NOTHING, 0, b"", None),)), "CopiesFound", "a place in holders"),
        (found(Copy(CopyState.NO_CUSTODY, 1, b"", None)), "CopiesFound", "0 with NO_CUSTODY"),
        (found(Copy(CopyState.DIGEST, 0, b"", None)), "CopiesFound.copies[0]", "digest with state DIGEST alone"),
        (found(Copy(CopyState.NOTHING, 0, b"d" * 32, None)), "CopiesFound.copies[0]", "digest with state DIGEST alone"),
        (found(Copy(CopyState.RECORD, 0, b"", None)), "CopiesFound.copies[0]", "record with state RECORD alone"),
        (found(Copy(CopyState.DAMAGED, 0, b"", BYTES)), "CopiesFound.copies[0]", "record with state RECORD alone"),
        (RangeCompared((ArcSum(2, bytes(32), (), True),)), "RangeCompared.sums[0]", "records nil or as many as count"),
        (CompareRange(1, 1, (Span(HIGH, LOW),), 0), "CompareRange.arcs[0]", "first ≤ last"),
        (CompareRange(1, 1, (), 257), "CompareRange.list_below", "outside"),
        (CopiesStored((23,), ""), "CopiesStored.reasons[0]", "outside"),
        (ListHeld(OWNER, HOLDER, 1, LOW, HIGH, b"", 0), "ListHeld.limit", "outside"),
        (ListHeld(OWNER, HOLDER, 1, LOW, HIGH, bytes(65), 1), "ListHeld.after", "at most 64"),
        (HeldFetched((), (1, 1)), "HeldFetched", "missing distinct"),
        (ChangeBlacklist((AddressPrefix(7, 32),), (AddressPrefix(7, 32),)), "ChangeBlacklist", "nothing in both add and remove"),
        (ChangeBlacklist(add=(AddressPrefix(7, 31),)), "ChangeBlacklist.add[0]", "behind its first bits"),
        (BlacklistChanged(1, (AddressPrefix(0, 32),) * 33), "BlacklistChanged.prefixes", "at most 32"),
        (PingBroadcast((Status(1, ADA, bytes(16), 1, "", blacklist=(AddressPrefix(1, 24),)),)), None, "behind its first bits"),
        (PingBroadcast((Status(1, ADA, bytes(16), 1, "", blacklist=(AddressPrefix(0, 33),)),)), None, "outside"),
    ],
)
def test_what_contradicts_itself_is_neither_sent_nor_taken(packet: Packet, field: str | None, problem: str) -> None:
    with pytest.raises(LocalFault) as sent:
        encode_packet(packet)
    assert field in (None, sent.value.where) and problem in str(sent.value)
    with pytest.raises(MalformedPacket) as taken:
        decode_packet(msgpack.packb(_array(packet)))
    assert field in (None, taken.value.field) and problem in taken.value.problem


def _array(packet: Packet) -> list[Any]:
    return [packet.TYPE, 0, None, *(_plain(getattr(packet, name)) for name, _ in ROWS[packet.TYPE].fields)]


def _plain(value: Any) -> Any:
    """Like the wire's own, without its laws."""
    if is_dataclass(value):
        return [_plain(getattr(value, field.name)) for field in fields(value)]
    if isinstance(value, tuple):  # A prefix as well.
        return [_plain(item) for item in value]
    return bytes(value) if isinstance(value, bytes) else value


def test_the_largest_status_fits_a_datagram() -> None:
    big, blacklist = 2**64 - 1, tuple(AddressPrefix(2**32 - 1 - index, 32) for index in range(BLACKLIST_MAX))
    status = Status(
        lamport=big,
        node=NodeId(2**32 - 1),
        incarnation=bytes(16),
        boot=2**32 - 1,
        address="x" * 64,
        left_fence=MIDDLE,
        right_bound=HIGH,
        render_pool=2**32 - 1,
        scene_frame=big,
        offline_fraction=2**32 - 1,
        offline_blocks=big,
        online_fraction=2**32 - 1,
        online_blocks=2**32 - 1,
        rays_per_second=2**32 - 1,
        ray_queue_length=2**32 - 1,
        log_position=big,
        blacklist=blacklist,
        blacklist_version=big,
        signature=bytes(384),
    )
    assert len(encode_packet(PingBroadcast((status,), request_id=2**32 - 1))) <= PACKET_BYTES_MAX


def test_full_lists_fit_a_frame() -> None:
    offsets = tuple(Location.from_number(2**159 + index) for index in range(SHADOWS_MAX))
    members = tuple(Member(NodeId(2**32 - 1 - index), bytes(16)) for index in range(COPIES_MAX))
    configuration = Configuration(2**64 - 1, members, COPIES_MAX)
    full = PassedSegment(offsets, LOW, HIGH, (configuration,), tuple(Confirmed(member, 2**64 - 1) for member in members))
    places = [Location.from_number(LOW.number + index) for index in range(CONFIGURATIONS_MAX)]
    segments = tuple(replace(full, first=place, last=place) for place in places)
    assert len(encode_packet(ClaimRange(bytes(16), LOW, HIGH, 2**64 - 1, segments))) < FRAME_BYTES_MAX // 2
    entry = CustodyEntry(offsets, LOW, HIGH, 2**64 - 1, members, COPIES_MAX, True)
    assert len(encode_packet(HeldListed(0, (), (entry,) * CUSTODY_ENTRIES_MAX, None))) < FRAME_BYTES_MAX // 4
    key = RecordKey(1, LOW, bytes(16))
    assert len(encode_packet(GetCopies(1, 2**64 - 1, (key,) * 8192, True, False))) < FRAME_BYTES_MAX // 4
    listed = ListedRecord(LOW, bytes(16), RecordVersion(2**64 - 1, 2**64 - 1, 2**32 - 1, 2**64 - 1, bytes(32)))
    sums = (ArcSum(256, bytes(32), (listed,) * 256, True),) * 64
    assert len(encode_packet(RangeCompared(sums))) < FRAME_BYTES_MAX // 4
    assert len(encode_packet(HeldFetched((), tuple(range(HANDOVER_BATCH_RECORDS_MAX))))) < FRAME_BYTES_MAX // 4
