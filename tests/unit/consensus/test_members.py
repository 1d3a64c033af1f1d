"""If one fails, who decides is not the same for all who decide, or a log cannot be caught up with (design §14, 19 and 22 to 26)."""

from __future__ import annotations

import pytest

from scenefold.base.reasons import RejectReason
from scenefold.consensus import Outcome, Propose, Rejected
from unit.consensus.logs_made import Change, member
from unit.consensus.world import World

A, B, C, D, E = range(1, 6)


def test_19_ten_positions_behind() -> None:
    """A node that was away is asked for its vote: it asks for what it lacks, and then votes, for without it there is no majority."""
    world = World(1, A, B, C)
    world.crash(C)
    for number in range(10):
        world.ask(A, f"r{number}")
        world.run(5.0)
    assert len(world.log(B)) == 10
    world.crash(B)
    world.start(C)
    world.ask(A, "with C")
    world.run(30.0)
    assert world.agree(A, C)[-1] == "with C"
    assert {vote.member.node for vote in world.nodes[A].disk.log[-1][1].votes} == {A, C}


@pytest.mark.parametrize("seed", range(20))
def test_22_removed_while_it_proposes(seed: int) -> None:
    """One order. If it was removed first, it is told that it takes no part."""
    world = World(seed, A, B, C)
    world.keep_in_step()
    first, second = ((A, C), (C, A))[seed % 2]
    for node in (first, second):
        world.ask(node, f"by {node}", Change(leaves=member(C)) if node == A else Change())
        world.run(world.random.uniform(0, 0.05))
    world.run(60.0)
    if world.agree() == ["by 1"]:
        world.ask(C, "again")
        world.run(30.0)
        assert (world.nodes[C].replies[-1].outcome, world.nodes[C].replies[-1].reason) == (Outcome.REJECTED, RejectReason.NOT_AUTHORISED)
        assert world.agree() == ["by 1"]
    else:
        assert world.agree() == [f"by {C}"]


def test_22_what_the_removed_proposes_is_refused() -> None:
    """It has not heard of its removal, and proposes for the position after one that it thinks open: nobody votes for that."""
    world = World(1, A, B, C)
    world.part({A, B}, {C})
    world.ask(A, "without C", Change(leaves=member(C)))
    world.run(5.0)
    world.heal()
    world.ask(C, "mine")
    world.run(30.0)
    assert world.agree() == ["without C"]
    assert world.nodes[C].replies[-1].reason is RejectReason.POSITION_BEHIND


def test_23_one_joins_and_dies() -> None:
    """It is added, and dies before it learns that; one that has not heard of it either proposes as if nothing had been: 9 with reason 2,
    and then the new participants decide."""
    world = World(1, A, B, C, D, first=(A, B, C))
    world.part({A, B, D}, {C})
    world.crash(D)
    world.ask(A, "with D", Change(joins=member(D)))
    world.run(5.0)
    world.heal()
    old = world.ask(C, "by C")
    world.run(10.0)
    refused = [message.refusal.reason for *_, message in world.packets if isinstance(message, Rejected)]
    assert RejectReason.POSITION_BEHIND in refused
    assert (world.nodes[C].replies[-1].digest, world.nodes[C].replies[-1].outcome) == (old.digest, Outcome.REJECTED)
    world.ask(C, "by C")
    world.run(10.0)
    assert world.agree(A, B, C) == ["with D", "by C"]
    last = next(message for *_, message in reversed(world.packets) if isinstance(message, Propose))
    assert set(last.route) == {A, B, C, D}
    world.crash(C)
    world.ask(A, "too few", within=5.0)
    world.run(20.0)
    assert world.log(A) == ["with D", "by C"], "two of four are no majority"
    world.start(D)
    world.ask(A, "with D's vote")
    world.run(30.0)
    assert world.agree(A, B, D)[-1] == "with D's vote"


@pytest.mark.parametrize("effects", range(0, 12, 2))
@pytest.mark.parametrize("who", [A, B, C])
def test_24_three_two_one_two_three(who: int, effects: int) -> None:
    """One member less at a time, then one more, and somebody dies and comes back at each step: nothing without a majority of its time."""
    world = World(effects, A, B, C)
    world.keep_in_step()
    changes = [Change(leaves=member(C)), Change(leaves=member(B)), Change(joins=member(B)), Change(joins=member(C))]
    for number, change in enumerate(changes):
        world.crash_in[who] = effects
        for _ in range(20):
            if f"r{number}" in world.log(A):
                break
            if world.up(A):
                world.ask(A, f"r{number}", change)
            world.run(40.0)
            if not world.up(who):
                world.start(who)
                world.run(1.0)
        world.crash_in.clear()
    world.run(30.0)
    assert world.agree() == ["r0", "r1", "r2", "r3"]


def test_25_two_removals_at_once() -> None:
    """At different positions, one after the other."""
    world = World(1, A, B, C, D)
    world.keep_in_step()
    world.ask(A, "without C", Change(leaves=member(C)))
    world.ask(B, "without D", Change(leaves=member(D)))
    world.run(60.0)
    [first] = world.agree()
    node, change = (B, Change(leaves=member(D))) if first == "without C" else (A, Change(leaves=member(C)))
    world.ask(node, "the other", change)
    world.run(30.0)
    assert world.agree() == [first, "the other"]
    assert {one.member.node for one in world.nodes[A].book.participants.everyone} == {A, B}


def test_26_removed_and_wiped() -> None:
    """A node that was removed, and has lost its disk, is asked by one that knows nothing of it for a vote where it once had one."""
    world = World(1, A, B, C)
    world.crash(C)
    world.ask(A, "without B", Change(leaves=member(B)))
    world.run(5.0)
    assert world.agree(A, B) == ["without B"]
    world.crash(B)
    world.crash(A)
    world.wipe(B)
    world.start(B)
    world.start(C)
    world.ask(C, "behind", within=5.0)
    world.run(20.0)
    assert not world.log(B) and not world.log(C), "a wiped node votes for nothing, and so nothing is decided twice"
    world.start(A)
    world.keep_in_step()
    world.run(60.0)
    assert world.agree() == ["without B"]
