"""If this fails, a pass closes while rays of it still fly, so that its image is too dark, or never closes at all.

A toy pool: nodes create, pass on and retire rays; rays, reports, and readings travel for as long as chance likes
and overtake one another. Chance plays the scheduler, and Hypothesis plays chance.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.render.ledger import Counts, PassLedger, PassState


class ToyPool:
    """Node 0 owns the pass. All that may happen next is in `moves`."""

    def __init__(self, nodes: int, camera_rays: int, pick: list[int]) -> None:
        self.ledger = PassLedger(nodes)
        self.nodes = range(nodes)
        self.counts = [Counts() for _ in self.nodes]
        self.told: list[Counts | None] = [None for _ in self.nodes]
        self.waiting = [0 for _ in self.nodes]
        self.rays: list[int] = []
        """Targets of rays under way."""
        self.reports: list[tuple[int, Counts]] = []
        self.asked: list[int] = []
        self.replies: list[tuple[int, Counts]] = []
        self.spare = 30
        """Rays that may still be born, so that it ends."""
        self.pick = pick
        self.bounced = 0
        self.count(0, Counts(created=camera_rays))
        self.waiting[0] = camera_rays

    def count(self, node: int, more: Counts) -> None:
        self.counts[node] += more

    @property
    def is_over(self) -> bool:
        return not self.rays and not any(self.waiting)

    def choose(self, among: int) -> int:
        return self.pick.pop() % among if self.pick else 0

    def tell(self, node: int) -> None:
        if not self.waiting[node] and self.told[node] != self.counts[node]:
            self.told[node] = self.counts[node]
            self.reports.append((node, self.counts[node]))

    def trace(self, node: int) -> None:
        """One ray waits here: it ends, with up to two new ones, or flies on."""
        self.waiting[node] -= 1
        fate = self.choose(4)
        if fate == 0 and len(self.nodes) > 1 and self.spare:
            self.spare -= 1
            self.send(node)
            self.count(node, Counts(sent=1))
        else:
            born = min(fate % 3, self.spare)
            self.spare -= born
            self.count(node, Counts(created=born, retired=1))
            for _ in range(born):
                if self.choose(2) and len(self.nodes) > 1:
                    self.send(node)
                    self.count(node, Counts(sent=1))
                else:
                    self.waiting[node] += 1
        self.tell(node)

    def send(self, node: int) -> None:
        others = [other for other in self.nodes if other != node]
        self.rays.append(others[self.choose(len(others))])

    def receive(self, place: int) -> None:
        target = self.rays.pop(place)
        self.waiting[target] += 1
        self.count(target, Counts(received=1))

    def hear(self, place: int) -> None:
        if self.ledger.report(*self.reports.pop(place)):
            self.collect()

    def collect(self) -> None:
        self.ledger.begin_collection()
        self.asked = list(self.nodes)

    def answer(self, place: int) -> None:
        node = self.asked.pop(place)
        self.replies.append((node, self.counts[node]))

    def gather(self, place: int) -> None:
        state = self.ledger.collected(*self.replies.pop(place))
        if state is PassState.CLOSED:
            assert self.is_over, "closed while rays fly"
        elif state is PassState.OPEN and self.ledger.looks_settled:
            self.bounced += 1
            self.collect()

    def step(self) -> bool:
        """Do one of the things that can happen; False if nothing can."""
        moves: list[tuple[Callable[[int], None], int]] = [(self.trace, node) for node in self.nodes if self.waiting[node]]
        moves += [(self.receive, place) for place in range(len(self.rays))]
        moves += [(self.hear, place) for place in range(len(self.reports))]
        moves += [(self.answer, place) for place in range(len(self.asked))]
        moves += [(self.gather, place) for place in range(len(self.replies))]
        if not moves or self.ledger.state is PassState.CLOSED:
            return False
        move, argument = moves[self.choose(len(moves))]
        move(argument)
        return True


@settings(max_examples=400)
@given(st.integers(1, 4), st.integers(1, 4), st.lists(st.integers(0, 10**6), max_size=250))
def test_a_pass_closes_when_its_last_ray_ended_and_not_before(nodes: int, camera_rays: int, pick: list[int]) -> None:
    pool = ToyPool(nodes, camera_rays, pick)
    steps = 0
    while pool.step():
        steps += 1
        assert steps < 5000
    assert pool.ledger.state is PassState.CLOSED, "it must close at last"
    assert pool.is_over


def test_reports_during_the_second_reading_are_no_part_of_the_first() -> None:
    """A report younger than one reading can make up for what another reading saw later: totals agree, and lie."""
    ledger = PassLedger(2)
    assert ledger.report(0, Counts(created=4, retired=4))
    ledger.begin_collection()
    ledger.collected(0, Counts(created=4, retired=4))
    assert not ledger.report(0, Counts(created=6, retired=6, sent=1, received=1))
    assert ledger.collected(1, Counts(created=2, retired=2, sent=1, received=1)) is PassState.OPEN


def test_first_and_second_must_agree_node_totals_or_not() -> None:
    ledger = PassLedger(2)
    assert not ledger.report(1, Counts()), "nothing has begun"
    assert not ledger.report(0, Counts(created=5, sent=3, retired=2))
    assert ledger.report(1, Counts(received=3, retired=3))
    ledger.begin_collection()
    assert ledger.collected(0, Counts(created=5, sent=3, retired=2)) is PassState.COLLECTING
    assert ledger.collected(1, Counts(received=3, retired=3)) is PassState.CLOSED


def test_older_reports_change_nothing() -> None:
    ledger = PassLedger(1)
    assert ledger.report(0, Counts(created=3, retired=3))
    assert ledger.report(0, Counts(created=3, retired=1)), "an older one, late"
    assert ledger.looks_settled


def test_a_reading_that_fails_leaves_the_pass_open() -> None:
    ledger = PassLedger(2)
    ledger.report(0, Counts(created=1, retired=1))
    ledger.begin_collection()
    ledger.abandon_collection()
    assert ledger.state is PassState.OPEN
    with pytest.raises(AssertionError):
        ledger.collected(0, Counts())
