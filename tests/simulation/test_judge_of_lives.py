"""If this fails, a node is removed that could be heard, or ends by a fault of its own, and nobody objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
import trio

from scenefold.base.errors import DamagedData, LocalFault, Unreachable
from scenefold.peer.balance.draining import NodeDrained
from scenefold.peer.cluster_log.registered import DRAINED, NO_INCARNATION, Removal
from scenefold.peer.enrolment.enrolment import IdentityRenewed
from scenefold.simulation import laws
from scenefold.simulation.disks import incarnation_of
from scenefold.simulation.removals import JUDGED_S, _removed
from scenefold.wire import Member
from scenefold.world.ports import DiskFull
from simulation.quiet import Rest, at_rest


@dataclass(frozen=True, slots=True)
class Case:
    """What is so before n1 is removed, and what the removal says."""

    before: Callable[[Rest], object] = lambda _rest: None
    reason: str = "silent for 20 s"
    incarnation: bytes | None = None


def cut_off(rest: Rest) -> None:
    """From the voter, and the third node from n1."""
    for one, other in ((0, 1), (1, 2)):
        rest.cluster.watch.reach.cut(one, other, rest.cluster.net.now)


def cut_from_the_voter(rest: Rest) -> None:
    rest.cluster.watch.reach.cut(0, 1, rest.cluster.net.now)


def told_to_leave(rest: Rest) -> None:
    rest.cluster.nodes[1].told_to_leave = True


def judged_dead_and_back(rest: Rest) -> None:
    """The voter judges it while it is dead, and is slow to write that down."""
    watch, node, now = rest.cluster.watch, rest.cluster.nodes[1], rest.cluster.net.now
    incarnation = incarnation_of(node.disk)
    assert incarnation is not None
    watch.reach.goes_down(1, now - 15.0)
    watch.judged(Member(node.node_id, incarnation), True)
    watch.reach.comes_up(1, now)


def judged_long_ago(rest: Rest) -> None:
    """And nobody has judged it since."""
    judged_dead_and_back(rest)
    watch = rest.cluster.watch
    watch.judged_at = {incarnation: at - 2 * JUDGED_S for incarnation, at in watch.judged_at.items()}


def held_back_again(rest: Rest) -> None:
    """The voter has heard it, and says so."""
    judged_dead_and_back(rest)
    node = rest.cluster.nodes[1]
    incarnation = incarnation_of(node.disk)
    assert incarnation is not None
    rest.cluster.watch.judged(Member(node.node_id, incarnation), False)
    rest.cluster.watch.reach.comes_up(1, rest.cluster.net.now - 100.0)


def removed(case: Case) -> list[str]:
    """The laws that such a removal breaks."""
    broken: list[str] = []

    async def look(rest: Rest) -> None:
        node, watch = rest.cluster.nodes[1], rest.cluster.watch
        case.before(rest)
        await trio.sleep(15.0)
        incarnation = incarnation_of(node.disk) if case.incarnation is None else case.incarnation
        assert incarnation is not None
        assert watch.violations == []
        _removed(rest.cluster, Removal(Member(node.node_id, incarnation), case.reason, 99))
        assert watch.counts["removals"] == 1
        assert all(violation.slots == (1, 0) and case.reason in violation.what for violation in watch.violations)
        broken.extend(violation.law for violation in watch.violations)

    at_rest(look)
    return broken


@pytest.mark.parametrize(
    "case",
    [
        Case(),
        Case(cut_from_the_voter),
        Case(told_to_leave),
        Case(reason=DRAINED),
        Case(judged_long_ago),
        Case(held_back_again),
    ],
    ids=[
        "it could be heard",
        "another could hear it",
        "leaving, it fell silent for others",
        "it drained unasked",
        "it has been back for long",
        "the voter has heard it since",
    ],
)
def test_who_could_be_reached_must_not_be_removed(case: Case) -> None:
    assert removed(case) == [laws.REMOVED_RIGHTLY]


@pytest.mark.parametrize(
    "case",
    [
        Case(lambda rest: rest.cluster.crash(1, silent=True)),
        Case(cut_off),
        Case(judged_dead_and_back),
        Case(told_to_leave, reason=DRAINED),
        Case(incarnation=NO_INCARNATION),
        Case(incarnation=bytes([7]) * 16),
    ],
    ids=[
        "it was dead",
        "nobody could hear it",
        "it came back too late",
        "it left as it was told",
        "its founding seat",
        "another incarnation",
    ],
)
def test_who_could_not_or_left_may_be_removed(case: Case) -> None:
    assert removed(case) == []


def no_room() -> LocalFault:
    """What a start on a full disk ends with."""
    fault = LocalFault("no room")
    fault.__cause__ = DiskFull("not for one page")
    return fault


def ended(*ends: BaseException, came_up: bool = True) -> tuple[list[str], Rest]:
    """What is said of a life of n1 that ended by itself."""
    said: list[str] = []
    rests: list[Rest] = []

    async def look(rest: Rest) -> None:
        node = rest.cluster.nodes[1]
        rest.cluster._judge_end(node, list(ends), came_up=came_up)
        said.extend(f"{violation.law}: {violation.what}" for violation in rest.cluster.watch.violations)
        rests.append(rest)
        # Who was drained is switched off; its life is none of this test's.
        if node.scope is not None:
            node.scope.cancel()

    at_rest(look)
    return said, rests[0]


@pytest.mark.parametrize(
    ("ends", "came_up", "words"),
    [
        ((), True, "without a reason"),
        ((ValueError("a bug"),), True, "ValueError: a bug"),
        ((LocalFault("a bad argument"),), False, "LocalFault: a bad argument"),
        ((DamagedData("rotten"),), True, "DamagedData: rotten"),
        ((no_room(),), True, "LocalFault: no room"),
        ((no_room(), ValueError("a bug")), False, "LocalFault: no room; ValueError: a bug"),
        ((IdentityRenewed("anew"), ValueError("a bug")), True, "IdentityRenewed: anew; ValueError: a bug"),
    ],
)
def test_a_life_that_ends_by_a_fault_is_a_violation(ends: tuple[BaseException, ...], came_up: bool, words: str) -> None:
    said, _ = ended(*ends, came_up=came_up)
    assert said == [f"{laws.SOUND}: n1 ends by itself: {words}"]


@pytest.mark.parametrize(
    ("end", "came_up"), [(Unreachable("no seed answers"), True), (no_room(), False)], ids=["no seed", "a start on a full disk"]
)
def test_a_life_that_the_world_ends_is_none(end: BaseException, came_up: bool) -> None:
    said, rest = ended(end, came_up=came_up)
    assert said == []
    assert rest.cluster.nodes[1].is_wanted


def test_a_new_incarnation_is_counted_and_no_violation() -> None:
    said, rest = ended(IdentityRenewed("anew"))
    assert said == []
    assert rest.cluster.watch.counts["new incarnations"] == 1
    assert rest.cluster.nodes[1].is_wanted


def test_who_has_drained_is_switched_off() -> None:
    said, rest = ended(NodeDrained("all is handed over"))
    node = rest.cluster.nodes[1]
    assert said == []
    assert node.has_left and node.left.is_set() and not node.is_wanted and node.context is None
    assert rest.cluster.watch.counts["drained"] == 1
