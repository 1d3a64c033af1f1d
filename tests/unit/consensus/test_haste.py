"""If one fails, a position's first ballot, which goes without promises, is somebody else's too, or is used where somebody has to be heard; or it takes longer than it must."""

from __future__ import annotations

import pytest

from scenefold.base.reasons import RejectReason
from scenefold.consensus import Learn, Message, Outcome, Propose
from scenefold.consensus.ballots import is_first
from scenefold.wire import Phase
from unit.consensus.logs_made import Change, member
from unit.consensus.world import World

A, B, C, D, E = range(1, 6)
AT_ONCE = 1_000_000
HOP_S = 0.01


def phases(world: World) -> list[Phase]:
    return [message.proposal.phase for _, _, _, message in world.packets if isinstance(message, Propose)]


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 33])
def test_the_first_needs_one_way_out_and_home(n: int) -> None:
    """To all at once: the votes, out and home, and the news. By the arms: as many packets, one hop after the other."""
    first = (n + 1) // 2
    for at_once, arm in ((AT_ONCE, min(1, n - 1)), (0, n - first)):
        world = World(1, *range(1, n + 1))
        world.at_once_bytes = at_once
        value = world.ask(first, "it", needs_consent=False)
        world.run()
        [reply] = world.nodes[first].replies
        assert (reply.outcome, reply.position, reply.digest) == (Outcome.COMMITTED, 1, value.digest)
        assert world.agree() == ["it"]
        assert len(world.packets) == 3 * (n - 1)
        if n > 1:
            assert round((max(at for at, *_ in world.packets) + HOP_S) / HOP_S) == 2 * arm + 1


def test_everybody_else_asks_for_promises() -> None:
    """The one in the middle of the ids is the first, wherever it stands in the line."""
    for asked in (A, B, C, D, E):
        world = World(1, E, C, A, B, D)
        world.ask(asked, "it", needs_consent=False)
        world.run()
        assert (Phase.PREPARE in phases(world)) is (asked != C)
        assert world.agree() == ["it"]


def test_what_others_may_have_something_against_is_shown_to_them_first() -> None:
    """So are a barrier, and what is for all."""
    for plain, for_all in ((False, False), (True, True)):
        world = World(1, A, B, C)
        world.nodes[A].veto = RejectReason.BUSY
        world.ask(B, "it", needs_consent=not plain, is_for_all=for_all)
        world.run(5.0)
        [reply] = world.nodes[B].replies
        assert (reply.outcome, reply.reason, reply.by) == (Outcome.REJECTED, RejectReason.BUSY, A)
    world = World(1, A, B, C)
    world.ask_again(B, None, needs_consent=False)
    world.run(5.0)
    assert world.nodes[B].replies[-1].outcome is Outcome.OPEN


def test_who_cannot_reach_a_majority_does_not_begin() -> None:
    """Whoever asked there is told that it will never be, and not that nobody knows."""
    world = World(1, A, B, C)
    world.part({B}, {A, C})
    world.ask(B, "it", needs_consent=False, within=2.0)
    world.run(20.0)
    [reply] = world.nodes[B].replies
    assert (reply.outcome, reply.reason) == (Outcome.REJECTED, RejectReason.NO_MAJORITY)


def test_the_first_ballot_is_used_once() -> None:
    """It dies with its vote, comes back, and is asked for something else: it brings to an end what it had begun."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not isinstance(message, Propose)
    world.ask(B, "it", needs_consent=False)
    world.crash(B)
    world.filter = lambda source, target, message: True
    world.start(B)
    world.ask(B, "other", needs_consent=False)
    world.run(30.0)
    assert [reply.outcome for reply in world.nodes[B].replies] == [Outcome.UNKNOWN, Outcome.COMMITTED, Outcome.REJECTED]
    assert world.agree() == ["it"]
    begun = [message.proposal.ballot for _, _, _, message in world.packets if isinstance(message, Propose)]
    assert [is_first(ballot) for ballot in begun][:2] == [True, True] and not any(map(is_first, begun[2:]))


def test_who_has_promised_another_ballot_does_not_begin() -> None:
    """A's PREPARE has come; so B may be no lower than that."""
    world = World(1, A, B, C)
    world.ask(A, "by A")
    world.run(60.0, lambda: bool(world.nodes[B].disk.slot.promised.counter))
    world.crash(A)
    world.ask(B, "by B", needs_consent=False)
    world.run(30.0)
    assert world.agree(B, C) == ["by B"]
    assert not any(is_first(message.proposal.ballot) for _, _, _, message in world.packets if isinstance(message, Propose))


def test_another_ballot_overtakes_the_first() -> None:
    """Nothing of B comes to anybody, and A and C decide without it. Then B is told that its own never will be."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: source != B
    value = world.ask(B, "by B", needs_consent=False)
    world.ask(A, "by A")
    world.run(20.0)
    assert world.agree() == ["by A"]
    [reply] = world.nodes[B].replies
    assert (reply.digest, reply.outcome, reply.reason) == (value.digest, Outcome.REJECTED, RejectReason.POSITION_BEHIND)


def test_what_was_chosen_in_the_first_ballot_stays() -> None:
    """B and C have voted, and nobody hears of it before B is gone: A's later ballot is for the same."""
    world = World(1, A, B, C)

    def passes(source: int, target: int, message: Message) -> bool:
        return source == B and target == C

    world.filter = passes
    world.ask(B, "by B", needs_consent=False)
    world.run(1.0, lambda: bool(world.laws.chosen))
    world.crash(B)
    world.filter = lambda source, target, message: True
    world.ask(A, "by A")
    world.run(30.0)
    assert world.agree(A, C)[:1] == ["by B"]


def test_who_comes_or_goes_changes_who_is_first() -> None:
    """It follows from what was decided, at all alike."""
    world = World(1, A, B, C, D, first=(A, B, C))
    world.ask(B, "with D", Change(joins=member(D)), needs_consent=False)
    world.run(5.0)
    world.ask(B, "one", needs_consent=False)
    world.run(5.0)
    world.ask(B, "without A", Change(leaves=member(A)), needs_consent=False)
    world.run(5.0)
    world.ask(C, "two", needs_consent=False)
    world.run(5.0)
    assert world.agree(B, C, D) == ["with D", "one", "without A", "two"]
    assert Phase.PREPARE not in phases(world)


def test_a_majority_of_promises_is_enough_where_nobody_has_to_be_heard() -> None:
    """E hears and cannot speak: who needs its consent waits for it."""
    for plain in (True, False):
        world = World(1, A, B, C, D, E)
        world.at_once_bytes = AT_ONCE
        world.filter = lambda source, target, message: source != E
        world.ask(A, "it", needs_consent=not plain)
        world.run(0.1)
        assert bool(world.log(A)) is plain
        world.run(10.0)
        assert world.log(A) == ["it"]


def test_who_has_voted_is_told_without_the_body() -> None:
    world = World(1, A, B, C)
    world.ask(B, "it", needs_consent=False)
    world.filter = lambda source, target, message: target != C or isinstance(message, Learn)
    world.run(5.0)
    assert world.agree() == ["it"]
