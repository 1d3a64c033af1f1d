"""If one fails, some order of crashes, lost, doubled and late packets gives a place two owners, or loses what was acknowledged."""

from __future__ import annotations

from random import Random

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from scenefold.base.ids import NodeId
from scenefold.peer.line.ends import Side
from unit.peer.line.line_calm import calm
from unit.peer.line.line_model import Model
from unit.peer.line.line_nodes import CELLS, Node

NEWCOMERS = [NodeId(15), NodeId(25), NodeId(26), NodeId(20), NodeId(30)]
indexes = st.integers(0, 255)
sides = st.sampled_from(Side)


def step(model: Model, random: Random, weights: list[int]) -> None:
    """One operation, weighted so that handovers and surveys get somewhere between the faults."""
    nodes = model.alive()
    node = random.choice(nodes if random.random() < 0.3 else model.registered())
    side, number = random.choice(list(Side)), random.randrange(256)
    match random.choices(OPERATIONS, weights)[0]:
        case "deliver":
            model.deliver(number, keep=random.random() < 0.15)
        case "newest":
            model.deliver(-1, keep=random.random() < 0.15)
        case "prod":
            for each in Side:
                model.prod(node, each)
        case "copy":
            for cell in range(CELLS):
                model.copy(node, side, cell)
        case "write":
            model.write(node, number % CELLS)
        case "offer":
            model.offer(node, side, number)
        case "withdraw":
            model.withdraw(node, side)
        case "freeze":
            model.freeze(node, side)
        case "release":
            model.release(node, side)
        case "take back":
            model.take_back(node, side)
        case "delete":
            model.delete(node, side)
        case "hand":
            model.hand(node, number)
        case "seek":
            model.seek(node, number)
        case "learn":
            model.learn(node, node.position + 1 + number % 3)
        case "grant":
            model.grant(node)
        case "lapse":
            node.leased = False
        case "end leases":
            model.end_leases()
        case "crash":
            node.crash()
        case "remove":
            model.remove(number)
        case "pass on":
            model.pass_on(node, side, number)
        case "remove receiver":
            model.remove_receiver(number)
        case "join":
            model.join(NEWCOMERS[number % len(NEWCOMERS)], number // 8)


_TABLE = {
    "deliver": 30, "newest": 20, "prod": 24, "copy": 10, "write": 10, "offer": 8, "withdraw": 1, "freeze": 8, "release": 16,
    "take back": 6, "delete": 8, "hand": 3, "seek": 24, "learn": 6, "grant": 12, "lapse": 1, "end leases": 4, "crash": 2, "remove": 1, "join": 2,
    "pass on": 0, "remove receiver": 0,
}  # fmt: skip
_HARSH = {**_TABLE, "pass on": 16, "remove receiver": 6, "remove": 0, "join": 4, "take back": 12, "crash": 1}
OPERATIONS, WEIGHTS, HARSH = list(_TABLE), list(_TABLE.values()), list(_HARSH.values())
"""Harsh: receivers are removed while a piece is on its way to them, and others take their places."""


def walk(seed: int, steps: int = 400, weights: list[int] = WEIGHTS) -> Model:
    random = Random(seed)
    model = Model(founders=random.randrange(1, 4))
    for _ in range(steps):
        step(model, random, weights)
        model.check()
    calm(model)
    return model


@pytest.mark.parametrize("first_seed", range(0, 160, 20))
def test_random_walks_keep_one_owner_and_lose_nothing(first_seed: int) -> None:
    for seed in range(first_seed, first_seed + 20):
        walk(seed)


def test_pieces_of_removed_receivers_are_taken_back_and_lose_nothing() -> None:
    assert sum(walk(seed, weights=HARSH).counts.get("taken back", 0) for seed in range(100)) >= 30


class Line(RuleBasedStateMachine):
    """The same operations, chosen and shortened by hypothesis."""

    def __init__(self) -> None:
        super().__init__()
        self.model = Model()

    def node(self, index: int) -> Node:
        nodes = self.model.alive()
        return nodes[index % len(nodes)]

    @rule(index=indexes, keep=st.booleans())
    def deliver(self, index: int, keep: bool) -> None:
        self.model.deliver(index, keep=keep)

    @rule(index=indexes, side=sides)
    def prod(self, index: int, side: Side) -> None:
        self.model.prod(self.node(index), side)

    @rule(index=indexes, side=sides)
    def copy(self, index: int, side: Side) -> None:
        for cell in range(CELLS):
            self.model.copy(self.node(index), side, cell)

    @rule(index=indexes, cell=st.integers(0, CELLS - 1))
    def write(self, index: int, cell: int) -> None:
        self.model.write(self.node(index), cell)

    @rule(index=indexes, side=sides, count=indexes)
    def offer(self, index: int, side: Side, count: int) -> None:
        self.model.offer(self.node(index), side, count)

    @rule(index=indexes, side=sides)
    def withdraw(self, index: int, side: Side) -> None:
        self.model.withdraw(self.node(index), side)

    @rule(index=indexes, side=sides)
    def freeze_and_release(self, index: int, side: Side) -> None:
        self.model.freeze(self.node(index), side)
        self.model.release(self.node(index), side)

    @rule(index=indexes, side=sides)
    def take_back(self, index: int, side: Side) -> None:
        self.model.take_back(self.node(index), side)

    @rule(index=indexes, side=sides)
    def delete(self, index: int, side: Side) -> None:
        self.model.delete(self.node(index), side)

    @rule(index=indexes, stray=indexes)
    def hand(self, index: int, stray: int) -> None:
        self.model.hand(self.node(index), stray)

    @rule(index=indexes, which=indexes)
    def seek(self, index: int, which: int) -> None:
        self.model.seek(self.node(index), which)

    @rule(index=indexes, count=st.integers(1, 3))
    def learn(self, index: int, count: int) -> None:
        node = self.node(index)
        self.model.learn(node, node.position + count)

    @rule(index=indexes)
    def grant(self, index: int) -> None:
        self.model.grant(self.node(index))

    @rule()
    def end_leases(self) -> None:
        self.model.end_leases()

    @rule(index=indexes)
    def crash(self, index: int) -> None:
        self.node(index).crash()

    @rule(index=indexes)
    def remove(self, index: int) -> None:
        self.model.remove(index)

    @rule(newcomer=st.sampled_from(NEWCOMERS), left_of=indexes)
    def join(self, newcomer: NodeId, left_of: int) -> None:
        self.model.join(newcomer, left_of)

    @invariant()
    def holds(self) -> None:
        self.model.check()

    def teardown(self) -> None:
        calm(self.model)


TestLine = Line.TestCase
TestLine.settings = settings(max_examples=60, stateful_step_count=60, deadline=None, suppress_health_check=list(HealthCheck))
