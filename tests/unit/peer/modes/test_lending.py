"""If this fails, whoever wants a lease of a participant that may not act yet takes that for the last word, or a stranger's lease is relayed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.peer.modes.lending import Lending
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.wire import BorrowLease, LeaseUse, Member

ME, OTHER, OUTSIDE = NodeId(1), NodeId(2), NodeId(3)
GENESIS = b"g" * 32


def lending(me: NodeId, modes: SceneModes | None = None) -> Any:
    participants = [SimpleNamespace(member=Member(node, bytes(16))) for node in (ME, OTHER)]
    known = SimpleNamespace(public=SimpleNamespace(genesis=GENESIS, participants=participants))
    nobody: Any = None
    return Lending(nobody, nobody, me, lambda _scene: modes, lambda _scene: cast(Any, known))


def asked(lender: NodeId, use: LeaseUse = LeaseUse.EDIT) -> BorrowLease:
    return BorrowLease(SceneId(7), GENESIS, use, 1, lender, 5, bytes(16), bytes(64))


@pytest.mark.parametrize("use", [LeaseUse.EDIT, LeaseUse.RENDER])
async def test_a_participant_that_does_not_act_yet_may_be_asked_again(use: LeaseUse) -> None:
    with pytest.raises(Refused, match="has no lease") as caught:
        await lending(ME)._on_borrow(asked(ME, use), "user:ada")
    assert caught.value.reason is RejectReason.MODE_FORBIDS


@pytest.mark.parametrize(("me", "lender"), [(ME, OTHER), (OUTSIDE, ME), (OUTSIDE, OUTSIDE)])
async def test_nobody_lends_for_another_and_no_stranger_lends(me: NodeId, lender: NodeId) -> None:
    with pytest.raises(Refused, match="by no other") as caught:
        await lending(me)._on_borrow(asked(lender), "user:ada")
    assert caught.value.reason is RejectReason.NOT_AUTHORISED
