"""If this fails, a render whose organiser dies ends, or one that can never succeed is begun for ever."""

from __future__ import annotations

import pytest

from scenefold.base.errors import LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SealingKey
from scenefold.render.anew import BEGUN_MAX, PAUSE_S, PAUSE_S_MAX, VAIN_MAX, Tries
from scenefold.render.choice import SILENT, LeftOut, Renderers

ASKED = [NodeId(1)]
LOST = Unreachable("gone")


def test_it_is_begun_anew_a_few_times_in_vain_and_later_each_time() -> None:
    tries, pauses = Tries(), []
    while tries.may_begin_anew(LOST, ASKED, 0):
        pauses.append(tries.pause_s)
    assert tries.begun == 1 + VAIN_MAX
    assert pauses == [PAUSE_S * 2**number for number in range(VAIN_MAX)] and max(pauses) <= PAUSE_S_MAX


def test_who_gets_further_is_begun_anew_as_often_again() -> None:
    tries = Tries()
    for passes in (0, 0, 0, 5, 5, 5, 9):
        assert tries.may_begin_anew(LOST, ASKED, passes)
    assert tries.pause_s == PAUSE_S
    assert tries.may_begin_anew(LOST, ASKED, 9) and tries.may_begin_anew(LOST, ASKED, 8)
    assert not tries.may_begin_anew(LOST, ASKED, 9), "what it had once is no progress"


def test_there_is_an_end_of_it() -> None:
    tries = Tries()
    passes = 0
    while tries.may_begin_anew(LOST, ASKED, passes):
        passes += 1
    assert tries.begun == BEGUN_MAX


@pytest.mark.parametrize(
    ("error", "is_so"),
    [
        (LOST, True),
        (Refused(RejectReason.NOT_READY, "it organises no such job"), True),
        (Refused(RejectReason.NOT_AUTHORISED, "no"), False),
        (Refused(RejectReason.MODE_FORBIDS, "edit mode"), False),
        (Refused(RejectReason.POOL_BUSY, "full"), False),
        (LocalFault("too large"), False),
        (PeerFault("nonsense"), False),
    ],
)
def test_what_will_fail_again_is_not_tried_again(error: ScenefoldError, is_so: bool) -> None:
    assert Tries().may_begin_anew(error, ASKED, 0) == is_so


def test_who_was_not_begun_is_not_begun_anew() -> None:
    """Nobody has been asked: the cluster does not answer, and waits help as little as before."""
    assert not Tries().may_begin_anew(LOST, [], 0)


def test_who_does_not_answer_is_left_out_and_named() -> None:
    keys = {NodeId(number): SealingKey(bytes(32)).public for number in (1, 2, 3)}
    before = LeftOut(NodeId(9), "a stranger")
    left = Renderers(keys, (before,)).without({NodeId(2), NodeId(7)})
    assert left.nodes == (1, 3)
    assert left.left_out == (before, LeftOut(NodeId(2), SILENT))
