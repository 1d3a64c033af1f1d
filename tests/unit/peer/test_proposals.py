"""If this fails, two authors of a scene's log overwrite each other, or a lost answer turns into a refusal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.headers import checked_header
from scenefold.peer.scene_log.proposals import decide
from scenefold.wire import ProposeSceneLog, SceneLogPublic
from unit.peer.scenes_made import DECIDER, LOG, STRANGER, first_header, later_header, signed

FIRST = first_header()
SECOND = later_header(FIRST)
THIRD = later_header(SECOND)
OTHER_LOG = b"another move of the same space"


def proposal(public: SceneLogPublic, **changes: Any) -> ProposeSceneLog:
    fields: dict[str, Any] = {
        "genesis": public.genesis,
        "private": LOG,
        **changes,
    }
    return ProposeSceneLog(public=public.proposed(), **fields)


def outcome(packet: ProposeSceneLog, known: SceneLogPublic | None, key: SigningKey = DECIDER, *, has_log: bool = True) -> SceneLogPublic:
    return decide(packet, None if known is None else KnownScene.of(known), key, has_log=has_log).public


def test_what_extends_the_log_by_one_is_the_next_and_shows_that_it_was_decided() -> None:
    for public, known in ((FIRST, None), (SECOND, FIRST), (THIRD, SECOND)):
        found = outcome(proposal(public), known)
        assert found == public
        assert checked_header(found, None).public == public


def test_what_is_repeated_was_decided() -> None:
    known = KnownScene.of(SECOND)
    assert decide(proposal(SECOND), known, DECIDER, has_log=True) is known
    assert decide(proposal(SECOND), known, DECIDER, has_log=False) is known, "also once the log was lost"


@pytest.mark.parametrize(
    ("packet", "known", "reason"),
    [
        (proposal(SECOND), None, RejectReason.UNKNOWN_SCENE_OR_SPACE),
        (proposal(later_header(FIRST, log=OTHER_LOG), private=OTHER_LOG), SECOND, RejectReason.POSITION_TAKEN),
        (proposal(replace(SECOND, write_floor=2)), SECOND, RejectReason.POSITION_TAKEN),
        (proposal(FIRST), SECOND, RejectReason.POSITION_BEHIND),
        (proposal(THIRD), FIRST, RejectReason.ILL_FORMED),
        (proposal(SECOND, genesis=bytes(32)), FIRST, RejectReason.ILL_FORMED),
        (proposal(SECOND, private=OTHER_LOG), FIRST, RejectReason.ILL_FORMED),
        (proposal(SECOND, private=b""), FIRST, RejectReason.ILL_FORMED),
        (replace(proposal(SECOND), public=SECOND), FIRST, RejectReason.ILL_FORMED),
        (proposal(signed(SECOND, STRANGER)), FIRST, RejectReason.SIGNATURE_INVALID),
    ],
    ids=[
        "no first",
        "same position, another log",
        "another header",
        "too late",
        "a gap",
        "genesis",
        "not the log of the header",
        "no log",
        "decided already",
        "by no owner",
    ],
)
def test_what_does_not_extend_the_log_is_refused(packet: ProposeSceneLog, known: SceneLogPublic | None, reason: RejectReason) -> None:
    with pytest.raises(Refused) as refused:
        outcome(packet, known)
    assert refused.value.reason is reason


def test_a_node_decides_only_under_the_key_that_the_scene_began_with() -> None:
    with pytest.raises(Refused, match="another key") as refused:
        outcome(proposal(SECOND), FIRST, STRANGER)
    assert refused.value.reason is RejectReason.NOT_AUTHORISED


def test_who_lost_the_log_decides_nothing_more() -> None:
    with pytest.raises(Refused, match="lost the scene's log") as refused:
        outcome(proposal(SECOND), FIRST, has_log=False)
    assert refused.value.reason is RejectReason.UNKNOWN_SCENE_OR_SPACE
