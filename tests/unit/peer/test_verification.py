"""If this fails, a node stores a record that its writer did not sign for this very place, or that nobody may write."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import ED25519, RECORD_DOMAIN, RSA3072
from scenefold.peer.records.verification import KnownScene, epochs_of, verified_copy, verified_put, verify_all
from scenefold.wire import HandItem, KeyEntry, PutItem, SpaceEntry, WriterEntry
from unit.crypto.suites_made import SIGNING
from unit.peer.scenes_made import FOR_EVER, HEADER_KEY, PLACE, SPACE, STRANGER, WRITER, first_header, later_header, offered, sealed

SCENE = first_header()
KNOWN = KnownScene.of(SCENE)
RECORD = sealed(SCENE)
ITEM = offered(RECORD)
ELSEWHERE = Location.from_number(7)


def flipped(data: bytes, at: int = -1) -> bytes:
    changed = bytearray(data)
    changed[at] ^= 1
    return bytes(changed)


def test_a_writers_record_is_taken_as_it_is() -> None:
    assert verified_put(ITEM, KNOWN).record == RECORD


@pytest.mark.parametrize(
    "item, reason",
    [
        (replace(ITEM, signature=flipped(ITEM.signature)), RejectReason.SIGNATURE_INVALID),
        (replace(ITEM, signature=bytes(64)), RejectReason.SIGNATURE_INVALID),
        (replace(ITEM, ciphertext=flipped(ITEM.ciphertext)), RejectReason.SIGNATURE_INVALID),
        (replace(ITEM, header=flipped(ITEM.header, 70)), RejectReason.SIGNATURE_INVALID),
        (replace(ITEM, ciphertext=ITEM.ciphertext + b"x"), RejectReason.ILL_FORMED),
        (replace(ITEM, header=b""), RejectReason.ILL_FORMED),
        (replace(ITEM, header=flipped(ITEM.header, 0)), RejectReason.ILL_FORMED),
        (replace(ITEM, location=ELSEWHERE), RejectReason.ILL_FORMED),
        (replace(ITEM, space=SpaceId(11)), RejectReason.ILL_FORMED),
        (offered(sealed(SCENE, genesis=SCENE.genesis[:4] + bytes(28))), RejectReason.ILL_FORMED),
        (offered(sealed(SCENE, space=SpaceId(11))), RejectReason.UNKNOWN_SCENE_OR_SPACE),
        (offered(sealed(SCENE, space=SpaceId(11), epoch=2)), RejectReason.NOT_READY),
        (offered(sealed(SCENE, STRANGER)), RejectReason.NOT_AUTHORISED),
        (offered(sealed(SCENE, STRANGER, epoch=2)), RejectReason.NOT_READY),
    ],
    ids=[
        "signature bit",
        "no signature",
        "ciphertext bit",
        "seq bit",
        "longer ciphertext",
        "no header",
        "version",
        "moved",
        "moved to another space",
        "another genesis",
        "unknown space",
        "space of a later header",
        "no writer",
        "writer of a later header",
    ],
)
def test_anything_else_is_refused(item: PutItem, reason: RejectReason) -> None:
    with pytest.raises(Refused) as caught:
        verified_put(item, KNOWN)
    assert caught.value.reason == reason


def test_a_writer_writes_in_its_time_only() -> None:
    scene = later_header(first_header(writers=(WriterEntry(WRITER.key_id, 3, 5),)), position=6)
    known = KnownScene.of(scene)
    for epoch in (3, 5):
        verified_put(offered(sealed(scene, epoch=epoch)), known)
    for epoch in (2, 6):
        with pytest.raises(Refused) as caught:
            verified_put(offered(sealed(scene, epoch=epoch)), known)
        assert caught.value.reason == RejectReason.KEY_REVOKED


def test_who_may_write_by_a_header_that_is_not_here_yet_is_not_refused_for_good() -> None:
    """He may be new, or have been given his access back."""
    revoked = first_header(writers=(WriterEntry(WRITER.key_id, 0, 0),))
    for scene, key in ((SCENE, STRANGER), (revoked, WRITER)):
        known, record = KnownScene.of(scene), sealed(scene, key, epoch=2)
        with pytest.raises(Refused) as caught:
            verified_put(offered(record), known)
        assert caught.value.reason is RejectReason.NOT_READY
        with pytest.raises(Refused) as caught:
            verified_copy(HandItem(scene.scene, SPACE, PLACE, b"", record.signature, record.header_bytes, record.ciphertext), known)
        assert caught.value.reason is RejectReason.NOT_READY


def test_an_epoch_below_the_floor_is_refused() -> None:
    scene = later_header(SCENE, position=4, write_floor=4)
    with pytest.raises(Refused) as caught:
        verified_put(offered(sealed(scene, epoch=3)), KnownScene.of(scene))
    assert caught.value.reason == RejectReason.MODE_FORBIDS


def test_a_record_under_a_former_key_is_refused_and_a_copy_of_it_is_not() -> None:
    scene = KnownScene.of(later_header(SCENE, key_epoch=2))
    for key_epoch in (0, 1):
        with pytest.raises(Refused) as caught:
            verified_put(offered(sealed(SCENE, epoch=2, key_epoch=key_epoch)), scene)
        assert caught.value.reason == RejectReason.MODE_FORBIDS
    verified_put(offered(sealed(SCENE, epoch=2, key_epoch=2)), scene)
    old = sealed(SCENE, epoch=1)
    copy = HandItem(SCENE.scene, SPACE, PLACE, b"", old.signature, old.header_bytes, old.ciphertext)
    verified_copy(copy, scene)


def test_nobody_takes_a_place_for_ever_by_an_epoch_that_has_not_come() -> None:
    scene = KnownScene.of(later_header(SCENE, position=4, key_epoch=1))
    for epoch, key_epoch, reason in (
        (5, 1, RejectReason.NOT_READY),
        (2**64 - 1, 1, RejectReason.NOT_READY),
        (4, 2, RejectReason.ILL_FORMED),
        (4, 2**32 - 1, RejectReason.ILL_FORMED),
    ):
        record = sealed(SCENE, epoch=epoch, key_epoch=key_epoch)
        with pytest.raises(Refused) as caught:
            verified_put(offered(record), scene)
        assert caught.value.reason is reason
        copy = HandItem(SCENE.scene, SPACE, PLACE, b"", record.signature, record.header_bytes, record.ciphertext)
        with pytest.raises(Refused) as caught:
            verified_copy(copy, scene)
        assert caught.value.reason is reason
    verified_put(offered(sealed(SCENE, epoch=4, key_epoch=1)), scene)


def test_a_scene_says_where_copies_belong_and_nobody_writes_to_a_shadow() -> None:
    fourth, middle = (Location.from_number(1 << bits) for bits in (158, 159))
    shadows = [SpaceEntry(SpaceId(number), SPACE, offset, 1, 1, False, False) for number, offset in ((12, fourth), (11, middle))]
    scene = first_header(spaces=(replace(SCENE.spaces[0], copies=3, copies_min=2), *shadows))
    known = KnownScene.of(scene)
    assert known.layouts == {SPACE: (middle, fourth)}
    assert known.needed == {SPACE: 2}
    verified_put(offered(sealed(scene)), known)
    record = sealed(scene, space=SpaceId(12))
    with pytest.raises(Refused, match=r"space 12 holds the copies of space 10") as caught:
        verified_put(offered(record), known)
    assert caught.value.reason is RejectReason.UNKNOWN_SCENE_OR_SPACE
    assert caught.value.remedy == "write to space 10"
    early = HandItem(scene.scene, SpaceId(12), PLACE, b"", record.signature, record.header_bytes, record.ciphertext)
    verified_copy(early, known)


def test_no_copy_is_kept_under_a_key_that_the_scene_does_not_have() -> None:
    scene = KnownScene.of(later_header(SCENE, position=4, key_epoch=1))
    # Who handed over the second one may know a header that is not here.
    for epoch, key_epoch, reason in ((4, 2, RejectReason.ILL_FORMED), (5, 2, RejectReason.NOT_READY)):
        record = sealed(SCENE, epoch=epoch, key_epoch=key_epoch)
        with pytest.raises(Refused) as caught:
            verified_copy(HandItem(SCENE.scene, SPACE, PLACE, b"", record.signature, record.header_bytes, record.ciphertext), scene)
        assert caught.value.reason is reason


def test_each_record_has_a_verdict_of_its_own() -> None:
    good, bad = ITEM, replace(ITEM, signature=bytes(64))
    verdicts = verify_all([(item, KNOWN) for item in (good, bad, good)])
    assert [isinstance(verdict, Refused) for verdict in verdicts] == [False, True, False]


def test_the_epochs_of_records_say_how_new_a_header_must_be() -> None:
    later = later_header(SCENE, position=9)
    other = first_header(write_floor=1)
    items = [offered(sealed(later)), offered(sealed(SCENE)), offered(sealed(other)), replace(offered(sealed(later)), header=b"short")]
    assert epochs_of(items) == {SCENE.scene: 9, other.scene: 1}
    assert epochs_of([replace(items[0], header=b"")]) == {SCENE.scene: 0}


def test_a_writer_of_the_other_suite_writes_beside_those_of_this_one() -> None:
    rsa = SIGNING[RSA3072]
    keys = tuple(KeyEntry(key.public.suite, key.public.raw) for key in (HEADER_KEY, WRITER, rsa))
    scene = first_header(keys=keys, writers=tuple(WriterEntry(key.key_id, 0, FOR_EVER) for key in (WRITER, rsa)))
    known = KnownScene.of(scene)
    for key in (WRITER, rsa):
        record = sealed(scene, key)
        assert verified_put(offered(record), known).record == record
        header = record.header._replace(suite=ED25519 + RSA3072 - key.suite).encode()
        bent = replace(record, header_bytes=header, signature=key.sign(RECORD_DOMAIN, header))
        with pytest.raises(Refused, match="by a key of suite") as caught:
            verified_put(offered(bent), known)
        assert caught.value.reason == RejectReason.SIGNATURE_INVALID
    with pytest.raises(Refused) as caught:
        verified_put(replace(offered(sealed(scene, rsa)), signature=bytes(64)), known)
    assert caught.value.reason == RejectReason.SIGNATURE_INVALID


def test_a_writer_of_a_suite_of_later_programs_stops_nobody_else() -> None:
    scene = first_header(keys=(*SCENE.keys, KeyEntry(3, b"k" * 32)))
    verified_put(offered(sealed(scene)), KnownScene.of(scene))


def test_a_key_that_is_none_spoils_the_header() -> None:
    for suite, raw in ((ED25519, b"k" * 384), (RSA3072, b"k" * 32), (RSA3072, bytes(384))):
        with pytest.raises(DamagedData):
            KnownScene.of(replace(SCENE, keys=(*SCENE.keys, KeyEntry(suite, raw))))
