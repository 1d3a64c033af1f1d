"""If this fails, two programs read different spaces from one log, or a log takes a record that it must not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import SPACE_ID_MAX, NodeId, SceneId, SpaceId
from scenefold.base.limits import COPIES_MAX
from scenefold.base.location import FIRST, LINE_LENGTH, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey, seal_log
from scenefold.scene.layout import SPACES
from scenefold.scene.log import (
    Layouts,
    OpenedLog,
    SceneLog,
    first_log,
    first_record,
    missing_shadows,
    open_private,
    seal_private,
    sign_record,
    with_shadows,
)
from scenefold.scene.log.turns import shift_of, shifted
from scenefold.wire import (
    Batch,
    BeginPurge,
    CreateSpace,
    CurveKind,
    LogEntry,
    LogRecord,
    MalformedPacket,
    RenderSettings,
    ScaleSpace,
    SceneMode,
    SetCopies,
    SetMode,
    TranslateSpace,
    Trust,
)
from unit.scene.log.members import MAKER

GENESIS = bytes(range(32))
ORIGIN = NodeId(7)
KEY = bytes(24)
HEADER_KEY = SigningKey(bytes(31) + b"\2")
HALL = SpaceId(11)


def space(**changes: Any) -> CreateSpace:
    plain = CreateSpace(HALL, 3, CurveKind.HILBERT, False, SpaceId(0), FIRST, 1, 1, False, "hall", (0.0,) * 3, (8.0,) * 3)
    return replace(plain, **changes)


def with_entries(*entries: LogEntry) -> SceneLog:
    log = first_log(GENESIS, ORIGIN, MAKER, copies=1)
    for entry in entries:
        log = log.apply(log.next_record(entry, log.position.to_bytes(16, "big"), ORIGIN))
    return log


def test_a_log_begins_with_the_spaces_of_the_layout() -> None:
    log = first_log(GENESIS, ORIGIN, MAKER, copies=1)
    assert log.position == 1
    assert [(space.id, space.name, space.dimensions, space.curve) for space in log.spaces.values()] == [
        (space.id, space.name, space.dimensions, space.curve) for space in SPACES
    ]
    assert next(log.free_ids()) == HALL
    assert first_record(GENESIS, ORIGIN, MAKER).encode() == first_record(GENESIS, ORIGIN, MAKER).encode()
    assert first_record(bytes(32), ORIGIN, MAKER).request_id != first_record(GENESIS, ORIGIN, MAKER).request_id


def test_entries_add_up() -> None:
    move, grow = TranslateSpace(HALL, (1.0, 2.0, 3.0)), ScaleSpace(HALL, 0.5)
    log = with_entries(space(), Batch((move, grow)), SetMode(SceneMode.RENDER))
    hall = log.named("hall")
    assert (hall.created, hall.transform.factor, hall.transform.offset) == (2, 0.5, (0.5, 1.0, 1.5))
    assert hall.world_box == ((0.5, 1.0, 1.5), (4.5, 5.0, 5.5))
    assert hall is log.space(HALL)
    assert (log.position, log.mode, log.write_floor) == (4, SceneMode.RENDER, 4)
    assert [entry.space for entry in log.public_spaces()] == list(range(1, 12))


def test_the_newest_word_on_what_an_image_is_counts_and_while_it_is_rendered_nobody_says_another() -> None:
    assert with_entries().render == RenderSettings()
    first, last = RenderSettings(64, 32, sky=(0.5, 0.5, 1.0)), RenderSettings(samples=16, camera="door")
    log = with_entries(first, Batch((space(), last)))
    assert log.render == last, "of what it does not say nothing is left"
    assert with_entries(first, SetMode(SceneMode.RENDER)).render == first
    with pytest.raises(Refused, match=r"changes in edit mode alone .*switch the scene back") as refused:
        with_entries(SetMode(SceneMode.RENDER), last)
    assert refused.value.reason is RejectReason.MODE_FORBIDS
    assert log.write_floor == 0


OUTPUT = space(space=SpaceId(40), name="output", render_output=True)
FIFTH = Location.from_number(5)


@pytest.mark.parametrize(
    "entry",
    [
        space(space=SpaceId(50), name="attic"),
        TranslateSpace(HALL, (1.0, 2.0, 3.0)),
        ScaleSpace(HALL, 2.0),
        SetCopies(HALL, 1, 1),
        Batch((TranslateSpace(SpaceId(40), (1.0, 2.0, 3.0)), ScaleSpace(HALL, 2.0))),
        Batch((SetMode(SceneMode.RENDER), ScaleSpace(HALL, 2.0))),
    ],
    ids=lambda entry: type(entry).__name__,
)
def test_while_a_scene_is_rendered_nobody_adds_what_would_change_its_spaces(entry: LogEntry) -> None:
    log = with_entries(space(), OUTPUT, SetMode(SceneMode.RENDER))
    record = log.next_record(entry, b"r" * 16, ORIGIN)
    with pytest.raises(Refused, match=r"in render mode: no space is (made|changed) but for the output of renders") as refused:
        log.apply(record)
    assert refused.value.reason is RejectReason.MODE_FORBIDS
    assert log.extended((record,)).position == log.position + 1, "logs of former versions are read as ever"


@pytest.mark.parametrize(
    "entry",
    [
        space(space=SpaceId(50), name="more output", render_output=True),
        TranslateSpace(SpaceId(40), (1.0, 2.0, 3.0)),
        Batch((space(space=SpaceId(50), name="more output", render_output=True), ScaleSpace(SpaceId(50), 2.0))),
        Batch(
            (
                space(space=SpaceId(50), name="more output", render_output=True, copies=2, copies_min=1),
                space(space=SpaceId(51), name="its copy", parent=SpaceId(50), offset=FIFTH, render_output=True),
            )
        ),
        Batch((SetMode(SceneMode.EDIT), ScaleSpace(HALL, 2.0))),
    ],
    ids=lambda entry: type(entry).__name__,
)
def test_spaces_for_the_output_of_renders_are_made_and_changed_in_any_mode(entry: LogEntry) -> None:
    log = with_entries(space(), OUTPUT, SetMode(SceneMode.RENDER))
    assert log.apply(log.next_record(entry, b"r" * 16, ORIGIN)).position == log.position + 1


def test_a_shadow_is_for_the_output_of_renders_if_what_it_copies_is() -> None:
    """A space of a former version may lack shadows: one more has its records lie elsewhere, whatever the shadow says of itself."""
    log = with_entries()
    for entry in (space(copies=2), SetMode(SceneMode.RENDER)):
        log = log.extended((log.next_record(entry, log.position.to_bytes(16, "big"), ORIGIN),))
    shadow = space(space=SpaceId(50), name="shadow", parent=HALL, offset=FIFTH, render_output=True)
    with pytest.raises(Refused, match="in render mode: no space is made but for the output of renders"):
        log.apply(log.next_record(shadow, b"r" * 16, ORIGIN))


@pytest.mark.parametrize(
    "hidden", [TranslateSpace(HALL, (1.0, 2.0, 3.0)), RenderSettings(samples=16), BeginPurge()], ids=lambda entry: type(entry).__name__
)
@pytest.mark.parametrize("there", [SceneMode.RENDER, SceneMode.EDIT], ids=lambda mode: mode.name.lower())
def test_nobody_leaves_a_mode_and_comes_back_to_it_in_one_record(there: SceneMode, hidden: Any) -> None:
    """Its header would show the mode of before, and who decides would take it for no change of the mode."""
    log = with_entries(space(), SetMode(there))
    record = log.next_record(Batch((SetMode(SceneMode.EDIT), hidden, SetMode(there))), b"r" * 16, ORIGIN)
    with pytest.raises(Refused, match="sets the scene's mode once at most") as refused:
        log.apply(record)
    assert refused.value.reason is RejectReason.ILL_FORMED
    read = log.extended((record,))
    assert (read.position, read.mode) == (log.position + 1, there), "who reads a log takes it as it is, alike at all"


def at(number: int) -> Location:
    return Location.from_number(number)


SHADOW = space(space=SpaceId(12), name="shade", parent=HALL, offset=at(9))
LATER = replace(SHADOW, space=SpaceId(13), name="later", offset=at(5))
TWICE = Batch((space(copies=2, copies_min=2), SHADOW))


def test_a_shadow_lies_where_its_parent_lies() -> None:
    log = with_entries(TWICE, TranslateSpace(HALL, (1.0, 2.0, 3.0)), Batch((SetCopies(HALL, 3, 2), LATER)), ScaleSpace(HALL, 2.0))
    hall, shade, latest = (log.named(name) for name in ("hall", "shade", "later"))
    assert hall.world_box == shade.world_box == latest.world_box == ((2.0, 4.0, 6.0), (18.0, 20.0, 22.0))
    assert shade.transform_since(3) == latest.transform_since(3) == hall.transform_since(3)
    assert (shade.created, latest.created) == (2, 4)


@pytest.mark.parametrize(
    "entries",
    [
        [space(space=SpaceId(2))],
        [space(name="geometry")],
        [space(name="")],
        [space(copies_min=2)],
        [space(copies=0, copies_min=0)],
        [space(parent=SpaceId(99))],
        [SHADOW],
        [Batch((space(copies=2), replace(SHADOW, dimensions=2, low=(0.0,) * 2, high=(1.0,) * 2)))],
        [Batch((space(copies=2), replace(SHADOW, high=(9.0,) * 3)))],
        [TWICE, replace(LATER, parent=SpaceId(12))],
        [TWICE, TranslateSpace(SpaceId(12), (0.0,) * 3)],
        [TWICE, SetCopies(SpaceId(12), 1, 1)],
        [SetCopies(HALL, 1, 1)],
        [TranslateSpace(HALL, (0.0,) * 3)],
        [space(), TranslateSpace(HALL, (0.0,) * 2)],
        [space(), TranslateSpace(HALL, (1e18,) * 3)],
        [space(), ScaleSpace(HALL, 1e-200), ScaleSpace(HALL, 1e-200)],
        [space(), ScaleSpace(HALL, 1e200), ScaleSpace(HALL, 1e200)],
        [space(node_managed=True), ScaleSpace(HALL, 2.0)],
        [Trust(NodeId(1), True, bytes(32))],
        [Batch((space(), space()))],
    ],
)
def test_an_entry_that_does_not_fit_is_refused(entries: list[LogEntry]) -> None:
    log = with_entries(*entries[:-1])
    with pytest.raises(Refused) as refused:
        log.apply(log.next_record(entries[-1], b"r" * 16, ORIGIN))
    assert refused.value.reason is RejectReason.ILL_FORMED


@pytest.mark.parametrize(
    ("entries", "complaint", "remedy"),
    [
        ([TWICE, replace(LATER, parent=SpaceId(12))], "space 12 is a shadow itself", "space 11, whose copies it holds"),
        ([SHADOW], "there is no space 11", ""),
    ],
)
def test_who_wants_a_shadow_of_a_shadow_hears_whose_it_is(entries: list[LogEntry], complaint: str, remedy: str) -> None:
    log = with_entries(*entries[:-1])
    with pytest.raises(Refused, match=complaint) as refused:
        log.apply(log.next_record(entries[-1], b"r" * 16, ORIGIN))
    assert remedy in refused.value.remedy


@pytest.mark.parametrize(
    ("entries", "complaint"),
    [
        ([Batch((space(copies=2), replace(SHADOW, offset=FIRST)))], "the offset of a shadow is not 0"),
        ([Batch((space(copies=3), SHADOW, replace(LATER, offset=at(9))))], "space 13 is a shadow of space 11 with this offset already"),
        ([TWICE, replace(LATER, offset=at(9))], "space 12 is a shadow of space 11 with this offset already"),
        ([TWICE, LATER], "space 11 has 2 copies, and the shadows that those take"),
        ([space(), SHADOW], "space 11 has 1 copy, which takes no shadow"),
        ([Batch((space(copies=2), replace(SHADOW, copies=2)))], "a shadow is one copy itself, so it has 1 of 1, not 1 of 2"),
        ([space(copies=9)], "a space has 1 to 8 copies, and from 1 to all of them must be there, not 1 of 9"),
        ([space(copies=3)], "space 11 shall have 3 copies, and has 0 of the 2 shadows"),
        ([TWICE, SetCopies(HALL, 3, 2)], "space 11 shall have 3 copies, and has 1 of the 2 shadows"),
        ([TWICE, SetCopies(HALL, 1, 1), LATER], "space 11 has 1 copy, which takes no shadow"),
    ],
)
def test_nobody_adds_a_shadow_that_would_not_count_and_who_reads_takes_it(entries: list[LogEntry], complaint: str) -> None:
    """Early programs made such logs, and what they hold must stay readable."""
    log = with_entries(*entries[:-1])
    record = log.next_record(entries[-1], b"r" * 16, ORIGIN)
    with pytest.raises(Refused, match=complaint) as refused:
        log.apply(record)
    assert refused.value.reason is RejectReason.ILL_FORMED
    read = log.extended([record])
    layouts = Layouts.of(read.public_spaces())
    assert layouts.needed[HALL] <= 1 + len(layouts.offsets[HALL]) <= layouts.wanted[HALL]
    assert read.apply(read.next_record(ScaleSpace(HALL, 2.0), b"s" * 16, ORIGIN)).position == read.position + 1, "it goes on"


def test_copies_are_set_and_the_layout_follows() -> None:
    def layout(log: SceneLog) -> tuple[Location, ...]:
        return Layouts.of(log.public_spaces()).offsets[HALL]

    def since(log: SceneLog) -> int:
        return shift_of(SceneId(0), HALL, log.position)

    log = with_entries(Batch((space(copies=3), SHADOW, LATER)))
    assert layout(log) == (at(9), at(5))
    log = with_entries(space(), Batch((SHADOW, LATER, SetCopies(HALL, 3, 2))))
    assert layout(log) == shifted((at(9), at(5)), since(log))
    assert (log.space(HALL).copies, log.space(HALL).copies_min) == (3, 2)
    fewer = log.apply(log.next_record(SetCopies(HALL, 2, 1), b"r" * 16, ORIGIN))
    assert layout(fewer) == shifted((at(9),), since(fewer))
    assert len(fewer.spaces) == len(log.spaces), "shadows stay, and count again when there shall be more"
    more = fewer.apply(fewer.next_record(SetCopies(HALL, 3, 3), b"s" * 16, ORIGIN))
    assert layout(more) == shifted((at(9), at(5)), since(more))
    assert more.write_floor == 0, "what was signed before is written still"
    least = more.apply(more.next_record(SetCopies(HALL, 3, 1), b"t" * 16, ORIGIN))
    assert layout(least) == layout(more), "who holds copies is the same"


@given(st.lists(st.integers(1, COPIES_MAX), min_size=1, max_size=5), st.integers(1, COPIES_MAX))
def test_a_space_gets_the_shadows_that_it_lacks(steps: list[int], first: int) -> None:
    (made, *shadows) = with_shadows(space(copies=first), with_entries())
    log = with_entries(Batch((made, *shadows)))
    assert [shadow.offset.number for shadow in shadows] == [index * LINE_LENGTH // first for index in range(1, first)]
    for index, copies in enumerate(steps):
        entry = Batch((SetCopies(HALL, copies, 1), *missing_shadows(log.space(HALL), copies, log)))
        log = log.apply(log.next_record(entry, bytes([index]) * 16, ORIGIN))
        layouts = Layouts.of(log.public_spaces())
        assert len(layouts.offsets[HALL]) == copies - 1
    most = max(first, *steps)
    assert [space.name for space in log.spaces.values()][10:] == ["hall", *(f"hall copy {index}" for index in range(1, most))]
    assert list(log.spaces)[10:] == list(range(11, 11 + most))


def test_shadows_have_names_of_their_own_that_fit() -> None:
    log = with_entries(space(space=SpaceId(20), name="hall copy 1"))
    made = with_shadows(space(copies=3, copies_min=2), log)
    assert [entry.name for entry in made] == ["hall", "hall copy 2", "hall copy 3"]
    assert [entry.space for entry in made] == [11, 21, 22]
    long = with_shadows(space(name="é" * 32, copies=2, space=SpaceId(SPACE_ID_MAX)), log)
    assert long[1].name == "é" * 28 + " copy 1" and len(long[1].name.encode()) <= 64
    assert long[1].space == 21
    full = with_entries(space(space=SpaceId(SPACE_ID_MAX)))
    assert next(full.free_ids()) == 11, "numbers below are used when there are none above"


@pytest.mark.parametrize(("copies", "least"), [(1, 2), (3, 2), (3, 3), (COPIES_MAX, 1)])
def test_a_scene_may_begin_with_any_number_of_copies(copies: int, least: int) -> None:
    log = first_log(GENESIS, ORIGIN, MAKER, copies, least)
    layouts = Layouts.of(log.public_spaces())
    third = tuple(at(index * LINE_LENGTH // copies) for index in range(1, copies))
    assert layouts.offsets == {space.id: third for space in SPACES}
    assert set(layouts.needed.values()) == {min(least, copies)}
    assert len(log.spaces) == len(SPACES) * copies and layouts.lacking() == {}


def test_a_record_follows_its_log() -> None:
    log = with_entries(space())
    for record in (
        replace(log.next_record(ScaleSpace(HALL, 2.0), b"r" * 16, ORIGIN), position=2),
        replace(log.next_record(ScaleSpace(HALL, 2.0), b"r" * 16, ORIGIN), prev_hash=bytes(32)),
        log.next_record(ScaleSpace(HALL, 2.0), (1).to_bytes(16, "big"), ORIGIN),
    ):
        with pytest.raises(Refused):
            log.apply(record)


def test_what_is_not_there_is_named_with_what_is() -> None:
    with pytest.raises(LocalFault, match="it has meta, geometry"):
        with_entries().named("hall")
    with pytest.raises(LocalFault, match="space 11"):
        with_entries().space(HALL)
    with pytest.raises(LocalFault) as missing:
        with_entries(TWICE).named("attic")
    assert missing.value.remedy.endswith(", files, hall"), "of shadows there are many, and nobody may use them"


def records_of(*entries: LogEntry) -> list[LogRecord]:
    records = [first_record(GENESIS, ORIGIN, MAKER, copies=1)]
    for index, entry in enumerate(entries):
        records.append(SceneLog.of(records).next_record(entry, bytes([index]) * 16, ORIGIN))
    return records


@given(st.lists(st.sampled_from([1.0, 2.0, 0.5, 3.0]), max_size=5))
def test_a_sealed_log_is_read_as_it_was(factors: list[float]) -> None:
    records = records_of(space(), *(ScaleSpace(HALL, factor) for factor in factors))
    signed = [sign_record(record, HEADER_KEY) for record in records]
    private = seal_private(signed, genesis=GENESIS, symmetric_key=KEY, key_epoch=0, nonce=bytes(12))
    opening: dict[str, Any] = {"genesis": GENESIS, "position": len(records), "symmetric_key": KEY, "header_key": HEADER_KEY.public}
    opened = open_private(private, **opening)
    log = opened.state
    assert log == SceneLog.of(records)
    assert list(opened.records) == signed
    for known in range(len(records) + 1):
        assert open_private(private, known=OpenedLog(SceneLog.of(records[:known]), tuple(signed[:known])), **opening) == opened
    other = tuple(sign_record(record, HEADER_KEY) for record in records_of(space(name="another"), space(space=SpaceId(20))))
    assert open_private(private, known=OpenedLog(SceneLog.of([one.decoded() for one in other]), other), **opening) == opened
    step_by_step = SceneLog()
    for record in records:
        step_by_step = step_by_step.apply(record)
    assert step_by_step == log


def test_a_log_opens_for_its_scene_position_and_key_only() -> None:
    signed = [sign_record(record, HEADER_KEY) for record in records_of(space())]
    private = seal_private(signed, genesis=GENESIS, symmetric_key=KEY, key_epoch=0, nonce=bytes(12))
    right: dict[str, Any] = {"genesis": GENESIS, "position": 2, "symmetric_key": KEY, "header_key": HEADER_KEY.public}
    wrong: list[dict[str, Any]] = [
        {"genesis": bytes(32)},
        {"position": 1},
        {"symmetric_key": b"k" * 24},
        {"header_key": SigningKey(bytes(32)).public},
    ]
    for change in wrong:
        with pytest.raises(DamagedData):
            open_private(private, **{**right, **change})
    for broken in (b"", private[:20], private[:-1], private[:-1] + bytes([private[-1] ^ 1]), b"\2" + private[1:]):
        with pytest.raises(DamagedData):
            open_private(broken, **right)


def test_a_log_that_does_not_hold_together_is_damaged() -> None:
    first, second = (sign_record(record, HEADER_KEY) for record in records_of(space()))
    for records in ([second], [first, first], [replace(first, record=b"nonsense")], [second, first]):
        signed = [sign_record_bytes(record.record) for record in records]
        private = seal_private(signed, genesis=GENESIS, symmetric_key=KEY, key_epoch=0, nonce=bytes(12))
        with pytest.raises(DamagedData):
            open_private(private, genesis=GENESIS, position=len(records), symmetric_key=KEY, header_key=HEADER_KEY.public)


def sign_record_bytes(record: bytes) -> Any:
    from scenefold.crypto import LOG_DOMAIN
    from scenefold.wire import SignedRecord

    return SignedRecord(record, HEADER_KEY.sign(LOG_DOMAIN, record))


@given(st.binary(max_size=400), st.integers(1, 10))
def test_whatever_was_sealed_is_a_log_or_damaged(plain: bytes, position: int) -> None:
    """A key holder's mistake, or malice, ends in words and never in a traceback."""
    sealed = seal_log(plain, genesis=GENESIS, position=position, symmetric_key=KEY, key_epoch=0, nonce=bytes(12))
    with pytest.raises(DamagedData):
        open_private(sealed, genesis=GENESIS, position=position, symmetric_key=KEY, header_key=HEADER_KEY.public)


@given(st.data())
def test_changed_bytes_of_a_record_do_not_pass(data: st.DataObject) -> None:
    encoded = bytearray(records_of(space(), ScaleSpace(HALL, 2.0))[-1].encode())
    encoded[data.draw(st.integers(0, len(encoded) - 1))] ^= data.draw(st.integers(1, 255))
    before = SceneLog.of(records_of(space()))
    try:
        after = before.apply(LogRecord.decode(bytes(encoded)))
    except (MalformedPacket, Refused):
        return
    # Only who and what may have changed: a request id, an origin, a space, a factor.
    assert (after.position, len(after.spaces)) == (3, 11)
