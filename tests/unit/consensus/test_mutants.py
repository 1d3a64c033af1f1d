"""If this fails, the soup would not see a protocol that is wrong: then its silence is worth nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.consensus import Message, Propose
from scenefold.wire import Phase
from unit.consensus.laws import Broken
from unit.consensus.mutants import MUTANTS, Mutant
from unit.consensus.soup import found_after
from unit.consensus.world import World


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.__name__)
def test_42_every_mutant_is_found(mutant: Mutant, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        assert found_after(MUTANTS[mutant], lambda soup: mutant(patch, soup)) is not None


@pytest.mark.parametrize("forgets", [False, True])
def test_42_a_forgotten_promise_makes_two_histories(forgets: bool) -> None:
    """B promises C's ballot, starts again, and is asked for a vote in A's older one. The soup sees at once that a promise was
    forgotten; that it leads to two histories takes a plan, as nobody decides what he does not hold."""
    a, b, d, c, e = range(1, 6)
    world = World(1, a, b, d, c, e)
    world.laws.watches_disks = False
    allowed: set[tuple[int, int]] = set()

    def passes(source: int, target: int, message: Message) -> bool:
        if not isinstance(message, Propose):
            return target != b or world.now < 2.9
        is_first = message.proposal.phase is Phase.PREPARE
        return (is_first and (message.proposal.ballot.node == a or target not in (a, d))) or (source, target) in allowed

    def accept(origin: int, target: int) -> Propose:
        found = [
            message
            for _, source, to, message in world.packets
            if isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT and (source, to) == (origin, target)
        ]
        return found[0]

    world.filter = passes
    world.ask(a, "by A")
    world.run(1.0, lambda: world.nodes[a].disk.slot.accepted is not None)
    world.crash(a)
    world.ask(c, "by C")
    world.run(2.9 - world.now, lambda: world.nodes[c].disk.slot.accepted is not None)
    world.run(2.9 - world.now)
    world.crash(b)
    if forgets:
        world.forgets = lambda slot: replace(slot, promised=slot.accepted_ballot)
    world.start(b)
    allowed |= {(b, d)}
    world.deliver(a, b, accept(a, b))
    world.run(0.05)
    assert (world.nodes[b].disk.slot.accepted is not None) is forgets
    world.deliver(c, e, accept(c, e))
    world.deliver(c, b, accept(c, e))
    if forgets:
        with pytest.raises(Broken, match="two values"):
            world.run(0.05)
        return
    world.run(0.05)
    world.filter = lambda source, target, message: True
    world.start(a)
    world.keep_in_step()
    world.run(60.0)
    assert len(world.agree()) == 1
