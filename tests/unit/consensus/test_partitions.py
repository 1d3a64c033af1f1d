"""If one fails, nodes that hear only some of the others decide what they must not, or never come to an end (design §14, 6 to 10, 16 to 18)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Accepted, Message, Outcome, Propose, Rejected, Timing
from scenefold.wire import Phase
from unit.consensus.world import Weather, World

A, B, C, D, E = range(1, 6)


@pytest.mark.parametrize("seed", range(200))
def test_06_two_at_once(seed: int) -> None:
    """Both end committed, at different positions: whoever comes second is rejected there, and asks for the next one."""
    world = World(seed, A, B, C, D, E, weather=Weather(delay_s=(0.01, 0.2)))
    world.keep_in_step()
    world.ask(A, "a")
    world.ask(E, "e")
    for _ in range(6):
        world.run(60.0)
        for node, request in ((A, "a"), (E, "e")):
            last = world.nodes[node].replies[-1]
            if last.outcome is not Outcome.COMMITTED:
                assert last.reason is RejectReason.POSITION_BEHIND, last
                world.ask(node, request)
    assert sorted(world.agree()) == ["a", "e"]


@pytest.mark.parametrize("delay_s", [0.05, 0.14, 0.29, 0.9])
def test_07_three_duel(delay_s: float) -> None:
    """With delays that let each preempt the others, and timers that fit: it ends within ten pauses."""
    world = World(3, A, B, C, weather=Weather(delay_s=(delay_s, delay_s)))
    world.timing = Timing(hop_s=max(0.3, 2 * delay_s))
    values = {node: world.ask(node, f"r{node}", within=300.0) for node in (A, B, C)}
    tries = dict.fromkeys(values, 0)

    def ended() -> bool:
        for node in values:
            state = world.nodes[node].state
            tries[node] = max(tries[node], 0 if state is None else state.tries)
        return all(known.disk.log for known in world.nodes.values())

    world.run(300.0, ended)
    assert len(world.agree()) == 1
    assert max(tries.values()) <= 10, tries


def test_08_three_and_two() -> None:
    """Each side believes the other dead: three decide; two say that they do not know, or reject; then all have one log."""
    world = World(1, A, B, C, D, E)
    world.part({A, B, C}, {D, E})
    world.ask(A, "three", within=5.0)
    world.ask(E, "two", within=5.0)
    world.run(20.0)
    assert world.nodes[A].replies[-1].outcome is Outcome.COMMITTED
    assert (world.nodes[E].replies[-1].outcome, world.nodes[E].replies[-1].reason) == (Outcome.REJECTED, RejectReason.NO_MAJORITY)
    world.heal()
    world.keep_in_step()
    world.run(60.0)
    assert world.agree() == ["three"]


def test_08_the_next_request_waits_as_long_as_the_one_before() -> None:
    """Where many want the same position, each of them asks again and again: if all began anew with short pauses, none would ever get it."""
    world = World(1, A, B, C)
    world.part({A}, {B, C})
    for request in ("one", "two"):
        before = tries_of(world, A)
        world.ask(A, request, within=5.0)
        world.run(20.0)
        assert world.nodes[A].replies[-1].outcome is Outcome.REJECTED and tries_of(world, A) > before
    world.heal()
    world.ask(A, "three", within=5.0)
    world.run(20.0)
    assert world.agree() == ["three"] and tries_of(world, A) == 0


def tries_of(world: World, node: int) -> int:
    state = world.nodes[node].state
    assert state is not None
    return state.tries


def test_09_two_and_two() -> None:
    """Half is no majority."""
    world = World(1, A, B, C, D)
    world.part({A, B}, {C, D})
    world.ask(A, "left", within=5.0)
    world.ask(D, "right", within=5.0)
    world.run(20.0)
    assert all(not known.disk.log for known in world.nodes.values())
    world.heal()
    world.ask(B, "whole")
    world.run(30.0)
    assert world.agree() == ["whole"]


def test_10_one_hears_and_cannot_speak() -> None:
    """Decided without its vote, and it learns that."""
    world = World(1, A, B, C, D, E)
    world.blocked = {(C, other) for other in (A, B, D, E)}
    world.ask(A, "it")
    world.run(30.0)
    assert world.agree() == ["it"]
    votes = world.nodes[A].disk.log[0][1].votes
    assert C not in {vote.member.node for vote in votes}


def test_16_the_order_changes_on_the_way() -> None:
    """Two nodes change places while 7 is on its way, and one is visited twice: each counts once."""
    world = World(1, A, B, C, D, E)
    world.ask(A, "it")
    world.run(0.015)
    world.line = tuple(NodeId(node) for node in (A, B, D, C, E))
    again = [message for *_, message in world.packets if isinstance(message, Propose)]
    for message in again:
        world.deliver(A, D, message)
    world.run(30.0)
    assert world.agree() == ["it"]
    votes = world.nodes[A].disk.log[0][1].votes
    assert len({vote.member for vote in votes}) == len(votes) >= 3


@pytest.mark.parametrize("phase", list(Phase))
def test_17_a_hop_dies_after_handing_on(phase: Phase) -> None:
    """The one before it answers with what it knows when its time is over; what comes late, by another way, is counted with that."""
    world = World(1, A, B, C, D, E)

    def dies(source: int, target: int, message: Message) -> bool:
        is_it = isinstance(message, Propose) and message.proposal.phase is phase and (source, target) == (C, D)
        if is_it:
            world.after(0.001, lambda: world.crash(C))
        return True

    world.filter = dies
    world.ask(A, "it")
    world.run(20.0)
    rest = (A, B, D, E)
    assert world.agree(*rest) == ["it"]
    answers = [(source, target) for _, source, target, message in world.packets if isinstance(message, Accepted)]
    assert (B, A) in answers
    world.start(C)
    world.keep_in_step()
    world.run(30.0)
    assert world.agree() == ["it"]


def test_17_a_late_answer_is_merged() -> None:
    """It comes when the arm has been answered for already. Whoever has voted knows of three votes of seven at most, and it is the fourth."""
    world = World(1, *range(1, 8))
    held: list[tuple[int, int, Message]] = []

    def is_accept(message: Message) -> bool:
        return isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT

    def two_and_one(source: int, target: int, message: Message) -> bool:
        """3 and 2 vote by one arm, 5 by the other; what 2 answers is late."""
        if isinstance(message, Accepted) and message.proposal.phase is Phase.ACCEPT and (source, target) == (2, 3):
            held.append((source, target, message))
            return False
        return not is_accept(message) or (source, target) in ((4, 3), (3, 2), (4, 5))

    world.filter = two_and_one
    world.ask(4, "it")
    world.run(5.0, lambda: any(is_accept(message) and (source, target) == (4, 2) for _, source, target, message in world.packets))
    assert {node for node, known in world.nodes.items() if known.disk.slot.accepted} == {2, 3, 4, 5}
    assert not any(known.disk.log for known in world.nodes.values()), "both arms are answered for, and nobody knows of four votes"
    [late] = held
    world.deliver(*late)
    world.run(0.1)
    assert world.log(4) == ["it"], "what is late is passed home, and counted"


def test_18_a_route_without_one() -> None:
    """9 with reason 3, and no vote is cast."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not isinstance(message, Propose)
    world.ask(A, "it")
    proposal = next(message for *_, message in world.packets if isinstance(message, Propose))
    world.filter = lambda source, target, message: True
    before = len(world.packets)
    world.deliver(A, B, replace(proposal, route=(NodeId(A), NodeId(B))))
    world.run(0.05)
    refused = [message for _, source, _, message in world.packets[before:] if source == B and isinstance(message, Rejected)]
    assert [message.refusal.reason for message in refused] == [RejectReason.PEER_MISSED]
    assert world.nodes[B].disk.slot.promised.counter == 0
