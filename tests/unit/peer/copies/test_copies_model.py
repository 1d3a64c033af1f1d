"""If one fails, some order of messages, removals and readers gives less than was acknowledged, or a rule is not needed.

For each rule there is a story that goes wrong without it, and well with it; walks look for stories that nobody thought of.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest

from scenefold.base.ids import NodeId
from unit.peer.copies.copies_model import Model
from unit.peer.copies.copies_mutants import MUTANTS, without
from unit.peer.copies.copies_nodes import LAYOUT, PLACE, Broken, Message, Node, Rules
from unit.peer.copies.copies_walks import walk

WALKS = 60


@pytest.mark.parametrize("first", range(0, WALKS, 20))
def test_no_walk_reads_less_than_was_acknowledged(first: int) -> None:
    counts: dict[str, int] = {}
    for seed in range(first, first + 20):
        for what, count in walk(seed, Rules()).counts.items():
            counts[what] = counts.get(what, 0) + count
    # A model in which nothing happens finds nothing.
    assert {"acknowledged", "activated", "read"} <= set(counts), counts


def flush(model: Model) -> None:
    while model.messages:
        model.deliver(0, keep=False)


def ready(model: Model, owner: Node, *holders: Node) -> None:
    """The owner makes a configuration active, and has not said so yet."""
    owner.configurations = owner.configurations.place(LAYOUT, [(PLACE, tuple(node.member for node in holders))], model.needed)
    model.say(owner)
    flush(model)
    for node in holders:
        model.compare(node)
    flush(model)
    model.activate(owner)


def told(model: Model, owner: Node, *holders: Node) -> None:
    ready(model, owner, *holders)
    model.say(owner)
    flush(model)


def written(model: Model, owner: Node) -> bool:
    """Whether a write of this owner is acknowledged."""
    model.write(owner)
    model.send(owner)
    flush(model)
    return model.settle(owner)


def reads(model: Model, *nodes: Node) -> None:
    model.begin_reading()
    for node in nodes:
        model.read(model.readers[-1], node)


def late(model: Model, owner: Node) -> list[Message]:
    """What an owner says now, and what comes only much later."""
    model.say(owner)
    messages, model.messages = model.messages, []
    return messages


def lose(model: Model, node: Node, *, lease: bool = False) -> None:
    model.remove(node)
    node.leased = lease
    for other in model.nodes.values():
        other.known = len(model.log)


def old_members_are_asked(model: Model, nodes: list[Node]) -> None:
    p, a, b, x, y = nodes
    told(model, p, a, b)
    assert written(model, p)
    ready(model, p, x, y)
    written(model, p)
    reads(model, a, b)


def one_that_is_being_filled_is_asked(model: Model, nodes: list[Node]) -> None:
    p, a, b, x, _ = nodes
    told(model, p, a, b)
    assert written(model, p)
    p.configurations = p.configurations.place(LAYOUT, [(PLACE, (x.member,))], 2)
    model.say(p)
    flush(model)
    reads(model, x)


def what_is_owed_is_forgotten(model: Model, nodes: list[Node]) -> None:
    p, a, b, _, _ = nodes
    told(model, p, a, b)
    model.write(p)
    model.send(p)
    model.messages = [message for message in model.messages if message.target != b.member]
    flush(model)
    assert model.settle(p)
    told(model, p, b)
    reads(model, b)


def who_was_not_compared_answers(model: Model, nodes: list[Node]) -> None:
    p, a, b, x, _ = nodes
    told(model, p, a, b)
    assert written(model, p)
    p.configurations = p.configurations.place(LAYOUT, [(PLACE, (x.member,))], 2)
    model.say(p)
    flush(model)
    model.activate(p)
    model.say(p)
    flush(model)
    reads(model, x)


def a_word_comes_late(model: Model, nodes: list[Node]) -> None:
    p, a, x, _, _ = nodes
    ready(model, p, a)
    kept = late(model, p)
    model.messages = list(kept)
    flush(model)
    assert written(model, p)
    told(model, p, x)
    assert written(model, p)
    model.messages = kept
    flush(model)
    reads(model, a)


def a_word_for_the_life_before_comes(model: Model, nodes: list[Node]) -> None:
    p, a, _, _, _ = nodes
    ready(model, p, a)
    assert written(model, p)
    kept = late(model, p)
    lose(model, a)
    model.come_back(a, with_disk=False)
    model.messages = kept
    flush(model)
    reads(model, *model.registered())


def a_word_of_an_earlier_owner_comes(model: Model, nodes: list[Node]) -> None:
    p, a, r, q, x = nodes
    ready(model, p, a)
    assert written(model, p)
    kept = late(model, p)
    model.give(p, r)
    model.claim()
    lose(model, r)
    recovered(model, q)
    model.deaf = {a.member}
    q.configurations = q.configurations.place(LAYOUT, [(PLACE, (x.member,))], 2)
    model.say(q)
    model.messages = [message for message in model.messages if message.target not in model.deaf]
    flush(model)
    model.compare(x)
    flush(model)
    model.activate(q)
    written_but_to(model, q)
    model.deaf = set()
    model.messages = kept
    flush(model)
    reads(model, a)


def written_but_to(model: Model, owner: Node) -> None:
    """A write that those whom nobody reaches do not hear of."""
    model.write(owner)
    model.send(owner)
    model.messages = [message for message in model.messages if message.target not in model.deaf]
    flush(model)
    model.settle(owner)


def recovered(model: Model, node: Node) -> None:
    model.adopt(node)
    while model.ask(node):
        pass
    model.recover(node)


def removed_holders_go_on_for_a_while(model: Model, nodes: list[Node]) -> None:
    p, a, b, q, x = nodes
    told(model, p, a, b)
    assert written(model, p)
    lose(model, p)
    lose(model, a, lease=True)
    lose(model, b, lease=True)
    recovered(model, q)
    told(model, q, x)
    written(model, q)
    written(model, q)
    reads(model, a, b)


def what_is_unsettled_is_given(model: Model, nodes: list[Node]) -> None:
    p, a, b, q, _ = nodes
    told(model, p, a, b)
    model.write(p)
    if model.give(p, q):
        model.claim()
        model.settle(q)
    reads(model, a, b)


STORIES: dict[str, Callable[[Model, list[Node]], None]] = {
    "rule 2": old_members_are_asked,
    "closed": old_members_are_asked,
    "not whole": one_that_is_being_filled_is_asked,
    "debts": what_is_owed_is_forgotten,
    "compared": who_was_not_compared_answers,
    "floors": a_word_comes_late,
    "incarnations": a_word_for_the_life_before_comes,
    "promises": a_word_of_an_earlier_owner_comes,
    "leases of who was not heard": removed_holders_go_on_for_a_while,
    "settled when given": what_is_unsettled_is_given,
}


def tell_story(mutant: str, *, broken: bool) -> None:
    with without(mutant if broken else None) as rules:
        model = Model(Random(3), rules, nodes=5, copies=3, needed=2)
        for node in model.nodes.values():
            node.known = len(model.log)
        STORIES[mutant](model, [model.nodes[member] for member in sorted(model.nodes, key=lambda member: NodeId(member.node))])


@pytest.mark.parametrize("mutant", MUTANTS)
def test_each_rule_is_missed(mutant: str) -> None:
    with pytest.raises(Broken):
        tell_story(mutant, broken=True)


@pytest.mark.parametrize("mutant", MUTANTS)
def test_with_the_rule_all_is_well(mutant: str) -> None:
    tell_story(mutant, broken=False)
