"""If this fails, a node believes a scene header that the scene's owners never signed, or that was never decided, or refuses a good one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import KeyId, NodeId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import DECISION_DOMAIN, SigningKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.log import decided, succeeded
from scenefold.scene.log.certified import BY_PARTICIPANTS
from scenefold.scene.log.decisions import BY_ORIGIN
from scenefold.wire import Decision, KeyEntry, SceneLogPublic
from unit.peer.scenes_made import HEADER_KEY, STRANGER, WRITER, first_header, later_header, signed

FIRST = first_header()
assert FIRST.decision is not None
OTHER = first_header(write_floor=1)
STEPS = (succeeded(STRANGER, STRANGER.public, FIRST.genesis, 3),)


def refusal(header: SceneLogPublic, known: KnownScene | None = None) -> RejectReason:
    with pytest.raises(Refused) as caught:
        checked_header(header, known)
    return caught.value.reason


def test_a_first_header_vouches_for_itself() -> None:
    scene = checked_header(FIRST, None)
    assert scene.public == FIRST
    assert set(scene.keys) == {HEADER_KEY.key_id, WRITER.key_id}


def test_a_decision_in_a_later_form_is_told_from_a_wrong_one() -> None:
    with pytest.raises(Refused, match="form 3, which this program does not know"):
        checked_header(replace(FIRST, decision=Decision(3, (bytes(64),) * 3)), None)


def test_the_same_header_again_is_no_news_and_no_fault() -> None:
    assert checked_header(FIRST, checked_header(FIRST, None)).public == FIRST


def test_a_successor_of_the_same_key_is_taken() -> None:
    later = later_header(FIRST, write_floor=2)
    assert checked_header(later, checked_header(FIRST, None)).public == later
    assert checked_header(later, None).public == later, "a node that was away meets a later header first"


@pytest.mark.parametrize(
    "header, reason",
    [
        (replace(FIRST, scene=SceneId(FIRST.scene ^ 1)), RejectReason.ILL_FORMED),
        (signed(replace(FIRST, write_floor=7)), RejectReason.ILL_FORMED),
        (replace(FIRST, signature=bytes(64)), RejectReason.SIGNATURE_INVALID),
        (signed(FIRST, STRANGER), RejectReason.SIGNATURE_INVALID),
        (replace(FIRST, signature=HEADER_KEY.sign(DECISION_DOMAIN, FIRST.signable())), RejectReason.SIGNATURE_INVALID),
        (first_header(keys=(KeyEntry(1, WRITER.public.raw),)), RejectReason.ILL_FORMED),
        (FIRST.proposed(), RejectReason.SIGNATURE_INVALID),
        (replace(FIRST, decision=OTHER.decision), RejectReason.SIGNATURE_INVALID),
        (decided(FIRST, STRANGER), RejectReason.SIGNATURE_INVALID),
        (decided(FIRST, HEADER_KEY), RejectReason.SIGNATURE_INVALID),
        (replace(FIRST, decision=Decision(BY_ORIGIN, (FIRST.signature,))), RejectReason.SIGNATURE_INVALID),
        (replace(FIRST, decision=Decision(BY_ORIGIN, ())), RejectReason.SIGNATURE_INVALID),
        (replace(FIRST, decision=Decision(BY_ORIGIN, FIRST.decision.certificates * 2)), RejectReason.SIGNATURE_INVALID),
        (replace(FIRST, decision=Decision(BY_PARTICIPANTS, FIRST.decision.certificates)), RejectReason.SIGNATURE_INVALID),
        (replace(FIRST, decision=Decision(BY_PARTICIPANTS + 1, FIRST.decision.certificates)), RejectReason.SIGNATURE_INVALID),
        (signed(replace(FIRST, origin_key=STRANGER.public.raw), decider=STRANGER), RejectReason.ILL_FORMED),
    ],
    ids=[
        "id",
        "genesis",
        "no signature",
        "other key",
        "other domain",
        "key not in it",
        "proposed only",
        "decision of another header",
        "decided by a stranger",
        "decided by an owner",
        "the owner's signature as a decision",
        "no certificate",
        "two certificates",
        "decided in another form",
        "decided in an unknown form",
        "another deciding key",
    ],
)
def test_what_does_not_vouch_for_itself_is_refused(header: SceneLogPublic, reason: RejectReason) -> None:
    assert refusal(header) == reason


@pytest.mark.parametrize(
    "header, reason",
    [
        (FIRST, RejectReason.POSITION_BEHIND),
        (later_header(FIRST, write_floor=2, key_epoch=2), RejectReason.POSITION_TAKEN),
        (later_header(FIRST, position=3, write_floor=4, key_epoch=1), RejectReason.ILL_FORMED),
        (later_header(FIRST, position=3, write_floor=0), RejectReason.POSITION_BEHIND),
        (later_header(FIRST, STRANGER, position=3, public_key=STRANGER.key_id), RejectReason.NOT_AUTHORISED),
        (later_header(FIRST, position=3, origin=NodeId(2)), RejectReason.NOT_AUTHORISED),
        (later_header(FIRST, position=3, genesis=FIRST.genesis[:4] + bytes(28)), RejectReason.POSITION_TAKEN),
        (later_header(FIRST, position=3, write_floor=2, key_epoch=0), RejectReason.POSITION_BEHIND),
        (
            later_header(FIRST, STRANGER, position=3, write_floor=2, key_epoch=1, public_key=STRANGER.key_id, succession=STEPS),
            RejectReason.NOT_AUTHORISED,
        ),
        (later_header(FIRST, position=3, write_floor=2, key_epoch=1, succession=STEPS), RejectReason.NOT_AUTHORISED),
        (later_header(FIRST, position=3, write_floor=2, key_epoch=1).proposed(), RejectReason.SIGNATURE_INVALID),
        (later_header(FIRST, position=3, write_floor=2, key_epoch=1, decider=STRANGER), RejectReason.SIGNATURE_INVALID),
        (
            later_header(FIRST, position=3, write_floor=2, key_epoch=1, decider=STRANGER, origin_key=STRANGER.public.raw),
            RejectReason.ILL_FORMED,
        ),
        (later_header(FIRST, position=3, write_floor=2, key_epoch=1, writers=()), RejectReason.ILL_FORMED),
    ],
    ids=[
        "older",
        "same position otherwise",
        "a floor from the future",
        "floor sinks",
        "another header key",
        "another origin",
        "another genesis",
        "key epoch sinks",
        "a forged heir",
        "another heir than it says",
        "proposed only",
        "decided by a stranger",
        "another deciding key",
        "another maker",
    ],
)
def test_what_does_not_follow_is_refused(header: SceneLogPublic, reason: RejectReason) -> None:
    known = KnownScene.of(later_header(FIRST, write_floor=2, mode=FIRST.mode, key_epoch=1))
    assert refusal(header, known) == reason


def test_a_key_that_was_searched_for_its_id_is_not_the_header_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four bytes are found by trying. Here every key has the same id."""
    monkeypatch.setattr("scenefold.crypto.keys.key_id_of", lambda raw: KeyId(7))
    for module in ("scene_log.headers", "records.verification"):
        monkeypatch.setattr(f"scenefold.peer.{module}.key_id_of", lambda raw: KeyId(7))
    header_key, twin = SigningKey(b"h" * 32), SigningKey(b"t" * 32)
    alone = {"public_key": KeyId(7), "writers": (), "keys": (KeyEntry(1, header_key.public.raw),), "first_key": header_key.public.raw}
    first = signed(replace(FIRST, **alone, signature=bytes(64)).with_genesis(), header_key)
    known = checked_header(first, None)
    forged = signed(replace(first, position=2, keys=(KeyEntry(1, twin.public.raw),)), twin)
    assert refusal(forged, known) is RejectReason.NOT_AUTHORISED
    both = signed(replace(first, position=2, keys=(KeyEntry(1, header_key.public.raw), KeyEntry(1, twin.public.raw))), twin)
    assert refusal(both, known) is RejectReason.ILL_FORMED
