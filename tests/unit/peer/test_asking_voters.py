"""If this fails, a node is told that the cluster's log refuses what a voter may have had decided meanwhile."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import NotReached, Refused, ScenefoldError, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.asking_voters import AskingVoters, ask_in_turn
from scenefold.peer.timing import PROPOSE_S_MAX
from unit.client.fake_nodes import make_world
from unit.peer.logs_made import node

UNKNOWN = Refused(RejectReason.NOT_READY, "nobody knows")
TOO_EARLY = Refused(RejectReason.MODE_FORBIDS, "not at this time")


async def asked(*said: ScenefoldError | int, councils: int = 1) -> int:
    """What comes of it if the one voter says this, one round after the other, and from then on the last."""
    left = list(said)

    async def decide(*_: object) -> int:
        what = left.pop(0) if len(left) > 1 else left[0]
        if isinstance(what, int):
            return what
        raise what

    log: Any = SimpleNamespace(
        voting=SimpleNamespace(councils=(None,) * councils), voters=[node(0)], committed_at=lambda *_: None, position=1, head=bytes(32)
    )
    facts: Any = SimpleNamespace(voter=node(0))
    peers: Any = SimpleNamespace(others=list)
    nobody: Any = None
    return await AskingVoters(make_world(), peers, facts, node(0), lambda: log, decide, nobody).propose(nobody, bytes(16))


@pytest.mark.parametrize("open_by", [UNKNOWN, Unreachable("the answer was lost")])
@pytest.mark.parametrize("later", [TOO_EARLY, Refused(RejectReason.BUSY, "later")])
async def test_what_an_earlier_round_left_open_no_later_refusal_ends(
    autojump_clock: MockClock, open_by: ScenefoldError, later: ScenefoldError
) -> None:
    began = trio.current_time()
    with pytest.raises(Unreachable):
        await asked(open_by, later)
    assert trio.current_time() - began == pytest.approx(PROPOSE_S_MAX), "it may still be found decided"
    assert await asked(open_by, later, 7) == 7


@pytest.mark.parametrize("said", [(TOO_EARLY,), (NotReached("off"), TOO_EARLY)])
async def test_what_nobody_has_begun_is_refused_at_once(autojump_clock: MockClock, said: tuple[ScenefoldError, ...]) -> None:
    with pytest.raises(Refused, match="not at this time"):
        await asked(*said)
    assert trio.current_time() < 1.0


async def test_who_decides_alone_knows_what_it_has_decided(autojump_clock: MockClock) -> None:
    with pytest.raises(Refused, match="not at this time"):
        await asked(Unreachable("the answer was lost"), TOO_EARLY, councils=0)


NOBODY = Refused(RejectReason.NO_MAJORITY, "no majority")


async def passed_on(*said: ScenefoldError | int) -> Any:
    """What a node that is no voter hears of voters that say this, one each."""

    async def ask(voter: int) -> Any:
        what = said[voter]
        if isinstance(what, int):
            return what
        raise what

    numbers: Any = range(len(said))
    return await ask_in_turn(numbers, ask)


@pytest.mark.parametrize("open_by", [UNKNOWN, Unreachable("the answer was lost")])
@pytest.mark.parametrize("later", [TOO_EARLY, NOBODY, NotReached("off")])
async def test_what_one_voter_may_have_begun_the_others_do_not_refuse(open_by: ScenefoldError, later: ScenefoldError) -> None:
    with pytest.raises(Unreachable, match=open_by.what):
        await passed_on(open_by, later)
    with pytest.raises(Unreachable, match=open_by.what):
        await passed_on(NOBODY, open_by, later)
    assert await passed_on(open_by, 7) == 7


@pytest.mark.parametrize(("said", "what"), [((NotReached("off"), NOBODY), "no majority"), ((NOBODY, TOO_EARLY), "not at this time")])
async def test_what_no_voter_has_begun_is_refused(said: tuple[ScenefoldError, ...], what: str) -> None:
    with pytest.raises(Refused, match=what):
        await passed_on(*said)
    with pytest.raises(NotReached):
        await passed_on(NOBODY, NotReached("off"))
