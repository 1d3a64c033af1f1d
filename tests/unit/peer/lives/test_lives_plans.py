"""If this fails, a disk that was copied is granted leases beside the other one, or a lease outlives what is waited for, in an order of steps that
is too unlikely for chance. Each plan comes to nothing as it is, and breaks a claim where a rule is left out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from unit.peer.lives.lives_judge import Broken
from unit.peer.lives.lives_mutants import (
    granted_to_who_does_not_know_the_voters,
    granted_with_something_accepted,
    the_first_of_two_lives,
    told_by_who_still_grants,
)
from unit.peer.lives.lives_walk import Walk
from unit.peer.lives.lives_world import LEASE_S, WAIT_S, Entry, Machine, Weather, World


class Plan(Walk):
    """0, 1 and 2 vote; a node and its copy, neither of which has asked yet."""

    def __init__(self) -> None:
        super().__init__(0)
        self.may_copy = True
        self._copy()
        self.node, self.copy = self.askers

    def exchange(self, *council: int) -> None:
        newest = self.sights[max(self.sights)]
        self.sights[newest.position + 1] = newest.after(Entry(council=frozenset(council)))

    def learn(self, *numbers: int) -> None:
        for number in numbers:
            self._learn(self.voters[number])

    def tell(self, teller: int, *numbers: int) -> None:
        for number in numbers:
            self._tell(self.voters[teller], self.voters[number])

    def visit(self, asker: object, *numbers: int) -> None:
        assert asker is self.node or asker is self.copy
        for number in numbers:
            self._visit(self.node if asker is self.node else self.copy, self.voters[number])

    def is_ready(self, number: int) -> bool:
        return self.voters[number].held.ready_at == max(self.sights)


@pytest.mark.parametrize("is_early", [False, True])
def test_lives_are_told_by_who_grants_no_more(is_early: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """1 and 2 tell 3 and 4, which come, and then grant the node as those who they still believe to be."""
    plan = Plan()
    if is_early:
        told_by_who_still_grants(monkeypatch, lambda: plan.sights[max(plan.sights)].councils)
    plan._ask(plan.node)
    plan.exchange(0, 3, 4)
    plan.learn(3, 4)
    for teller in (1, 2):
        plan.tell(teller, 3, 4)
    assert plan.is_ready(3) is plan.is_ready(4) is is_early
    plan.visit(plan.node, 1, 2)
    assert plan.node.process.is_granted
    if is_early:
        with pytest.raises(Broken, match=r"two lives of one number|again"):
            plan.visit(plan.copy, 3, 4)
        return
    plan.visit(plan.copy, 3, 4)
    plan.learn(1, 2)
    plan.tell(1, 3, 4)
    plan.tell(2, 3, 4)
    assert plan.is_ready(3) and plan.is_ready(4)
    plan.visit(plan.copy, 3, 4)
    assert plan.copy.process.is_restored and not plan.node.process.is_restored


@pytest.mark.parametrize("takes_the_first", [False, True])
def test_of_two_lives_of_one_number_neither_is_taken(takes_the_first: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """0 and 2 have granted the node, 1 the copy. Who hears of both cannot tell which was granted."""
    if takes_the_first:
        the_first_of_two_lives(monkeypatch)
    plan = Plan()
    plan.visit(plan.node, 0, 2)
    plan.visit(plan.copy, 1)
    assert plan.node.process.is_granted and not plan.copy.process.is_granted
    plan.exchange(1, 3, 4)
    plan.learn(0, 1, 2, 3)
    plan.tell(1, 3)
    plan.tell(2, 3)
    plan.tell(0, 1)
    assert plan.is_ready(1) and plan.is_ready(3)
    plan.copy.question = None
    if takes_the_first:
        with pytest.raises(Broken, match=r"two lives of one number|again"):
            plan.visit(plan.copy, 1, 3)
        return
    plan.visit(plan.copy, 1, 3)
    assert plan.copy.process.is_restored
    # The node knows that its own was granted, so it asks under the next.
    plan._ask(plan.node)
    plan.visit(plan.node, 1, 3)
    assert plan.node.process.is_granted and plan.node.process.life is not None and plan.node.process.life.number == 1


def stable(*council: int) -> tuple[World, Machine]:
    """These vote, and a node, whose disk is its own, holds a lease."""
    world = World(1, 1, 1, 5)
    world.run(3.0)
    world.propose(Entry(council=frozenset(council)))
    world.run(20.0)
    node = world.machines[5]
    assert world.open is None and {one.disk.position for one in world.machines.values()} == {2}
    assert node.process is not None and node.process.asker.holds(world.local(node))
    # Its life will do: that the first answer of all may bring a new one, and no lease, is not the subject here.
    node.process.asker = replace(node.process.asker, life_s=1_000.0)
    return world, node


def cut_off(world: World, numbers: set[int]) -> None:
    """These hear nobody else, and nobody else them."""
    others = world.machines.keys() - numbers
    world.blocked |= {pair for a in numbers for b in others for pair in ((a, b), (b, a))}


@pytest.mark.parametrize("grants", [False, True])
def test_who_has_voted_grants_nothing(grants: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """0 and 1 have voted for the removal of the node, and 0 alone knows that it is decided."""
    if grants:
        granted_with_something_accepted(monkeypatch)
    world, node = stable(0, 1, 2)
    for number in (0, 1):
        world.machines[number].disk.accepted = 3
    world.sights[3] = world.sights[2].after(Entry(removes=node.who))
    cut_off(world, {0})
    # Nobody takes over what was voted for: who has voted hears of it last.
    world.gossip = 0.0
    world._learn(world.machines[0], 3)
    if grants:
        with pytest.raises(Broken, match="longer than is waited for"):
            world.run(LEASE_S)
        return
    world.run(WAIT_S)
    assert node.process is not None and not node.process.asker.holds(world.local(node)) and world.sight(node).position == 2


@pytest.mark.parametrize("grants", [False, True])
def test_who_asks_knows_who_votes(grants: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """0, 3 and 4 vote now, and 3 and 4 remove the node. It has heard of none of that, and asks 0, who has heard of the first, and 1, who has not."""
    if grants:
        granted_to_who_does_not_know_the_voters(monkeypatch)
    world, node = stable(0, 1, 2)
    cut_off(world, {1, 5})
    world.propose(Entry(council=frozenset({0, 3, 4})))
    world.run(20.0)
    machines = world.machines
    assert [machines[number].disk.held.ready_at for number in (0, 3, 4)] == [3, 3, 3] and node.disk.position == 2
    world.gossip = 0.0
    cut_off(world, {3, 4})
    for number in (3, 4):
        machines[number].disk.accepted = 4
    world.sights[4] = world.sights[3].after(Entry(removes=node.who))
    world._learn(machines[3], 4)
    world.run(1.0)
    world.blocked -= {(0, 5), (5, 0)}
    if grants:
        with pytest.raises(Broken, match="longer than is waited for"):
            world.run(LEASE_S)
        return
    world.run(WAIT_S)
    assert node.process is not None and not node.process.asker.holds(world.local(node)) and world.sight(node).position == 3


@pytest.mark.parametrize("from_the_answer", [False, True])
def test_a_lease_counts_from_when_it_was_asked_for(from_the_answer: bool) -> None:
    """The voters' answers take a while, in which the node's removal is decided, and learnt."""
    world, node = stable(0, 1, 2)
    world.leases_from_answers = from_the_answer
    world.weather = Weather(delay_s=(0.6, 0.6))
    assert node.process is not None
    asked = node.process.asked_at
    while node.process.asked_at == asked:
        world.run(0.01)
    world.run(0.7)
    for number in (0, 1):
        world.machines[number].disk.accepted = 3
    world.sights[3] = world.sights[2].after(Entry(removes=node.who))
    world.gossip = 0.0
    world._learn(world.machines[3], 3)
    if from_the_answer:
        with pytest.raises(Broken, match="longer than is waited for"):
            world.run(1.0)
        return
    world.run(WAIT_S)
    assert not node.process.asker.holds(world.local(node))
