"""If this fails, two authors of a scene's log overwrite each other, or a lost answer turns into a refusal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.peer.proposals import is_decided
from scenefold.wire import Ballot, Phase, ProposalId, ProposeSceneLog, SceneLogPublic
from unit.peer.scenes_made import first_header, later_header

FIRST = first_header()
SECOND = later_header(FIRST)
THIRD = later_header(SECOND)
LOG = b"a sealed log"


def proposal(public: SceneLogPublic, **changes: Any) -> ProposeSceneLog:
    fields: dict[str, Any] = {
        "genesis": public.genesis,
        "proposal": ProposalId(public.position, Ballot(1, NodeId(0)), Phase.ACCEPT),
        "private": LOG,
        **changes,
    }
    return ProposeSceneLog(route=(), nodes=(), highest=None, takeover=False, public=public, mac_epoch=0, mac=b"", **fields)


def test_what_extends_the_log_by_one_is_the_next() -> None:
    assert not is_decided(proposal(FIRST), None, None)
    assert not is_decided(proposal(SECOND), FIRST, LOG)
    assert not is_decided(proposal(THIRD), SECOND, LOG)


def test_what_is_repeated_was_decided() -> None:
    assert is_decided(proposal(SECOND), SECOND, LOG)
    assert is_decided(proposal(FIRST, private=b"sealed anew"), FIRST, LOG), "the first record is always the same"


@pytest.mark.parametrize(
    ("packet", "known", "reason"),
    [
        (proposal(SECOND), None, RejectReason.UNKNOWN_SCENE_OR_SPACE),
        (proposal(SECOND, private=b"another move of the same space"), SECOND, RejectReason.POSITION_TAKEN),
        (proposal(replace(SECOND, write_floor=2)), SECOND, RejectReason.POSITION_TAKEN),
        (proposal(FIRST), SECOND, RejectReason.POSITION_BEHIND),
        (proposal(THIRD), FIRST, RejectReason.ILL_FORMED),
        (proposal(SECOND, genesis=bytes(32)), FIRST, RejectReason.ILL_FORMED),
        (proposal(SECOND, proposal=ProposalId(3, Ballot(1, NodeId(0)), Phase.ACCEPT)), FIRST, RejectReason.ILL_FORMED),
        (proposal(SECOND, proposal=ProposalId(2, Ballot(1, NodeId(0)), Phase.PREPARE)), FIRST, RejectReason.ILL_FORMED),
    ],
    ids=["no first", "same header, another log", "another header", "too late", "a gap", "genesis", "position", "phase"],
)
def test_what_does_not_extend_the_log_is_refused(packet: ProposeSceneLog, known: SceneLogPublic | None, reason: RejectReason) -> None:
    with pytest.raises(Refused) as refused:
        is_decided(packet, known, LOG)
    assert refused.value.reason is reason
