"""If one fails, whoever has asked is told what is not so, or is left without an answer (design §14, 36 to 38)."""

from __future__ import annotations

import pytest

from scenefold.base.reasons import RejectReason
from scenefold.consensus import (
    Ask,
    Learn,
    Message,
    Outcome,
    Propose,
    Refusal,
    Rejected,
    Reply,
    Setting,
    Slot,
    Stage,
    State,
    TimeOver,
    Timer,
    View,
    Waits,
    take,
)
from scenefold.consensus.ballots import COUNTER_MAX
from scenefold.consensus.facts import signed
from scenefold.wire import Ballot, Phase
from unit.consensus.logs_made import GENESIS, Book, Change, key_of, member, participants
from unit.consensus.soup import Soup
from unit.consensus.world import World

A, B, C, D, E = range(1, 6)


@pytest.mark.parametrize("is_voted", [False, True])
def test_36_the_node_is_lost(is_voted: bool) -> None:
    """After its ACCEPT, which one other has heard, or nobody: unknown there. Asked at another node, a barrier tells what the log then says."""
    world = World(1, A, B, C, D, E)

    def until_b(source: int, target: int, message: Message) -> bool:
        return not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT) or (is_voted and target == B)

    world.filter = until_b
    world.ask(A, "it", within=2.0)
    world.run(10.0, lambda: world.nodes[B if is_voted else A].disk.slot.accepted is not None)
    world.crash(A)
    world.filter = lambda source, target, message: True
    world.ask_again(E, None)
    world.run(30.0)
    assert world.nodes[E].replies[-1].outcome is (Outcome.COMMITTED if is_voted else Outcome.OPEN)
    assert world.agree(B, C, D, E) == (["it"] if is_voted else [])
    world.start(A)
    world.run(30.0)
    replies = [reply.outcome for reply in world.nodes[A].replies]
    assert replies == [Outcome.UNKNOWN, Outcome.COMMITTED], "what nobody else knew is brought to an end by whoever had begun it"
    assert world.agree() == ["it"]


def test_36_unknown_becomes_rejected() -> None:
    """Once another value is decided there, it is known that this one never will be."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT)
    value = world.ask(A, "it", within=2.0)
    world.run(10.0)
    assert world.nodes[A].replies[-1].outcome is Outcome.UNKNOWN
    world.filter = lambda source, target, message: True
    world.part({A}, {B, C})
    world.ask(B, "other")
    world.run(5.0)
    world.heal()
    world.sync(A, B)
    world.run(5.0)
    last = world.nodes[A].replies[-1]
    assert (last.digest, last.outcome, last.reason) == (value.digest, Outcome.REJECTED, RejectReason.POSITION_BEHIND)
    assert world.agree() == ["other"]


def test_37_the_same_request_twice() -> None:
    """At two nodes at once, and again when it is there: one entry, and the others are told where it is."""
    world = World(1, A, B, C, D, E)
    world.keep_in_step()
    world.ask(A, "it")
    world.ask(E, "it")
    world.run(60.0)
    assert world.agree() == ["it"]
    for node in (A, C, E):
        world.ask(node, "it")
        assert (world.nodes[node].replies[-1].outcome, world.nodes[node].replies[-1].position) == (Outcome.COMMITTED, 1)
    world.run(10.0)
    assert world.agree() == ["it"]


@pytest.mark.parametrize("seed", range(20))
def test_38_rejected_is_for_ever(seed: int) -> None:
    """A minority's request is rejected; whatever happens then for five minutes, it is never decided (the laws look after that)."""
    soup = Soup(seed)
    world = soup.world
    minority = len(world.nodes) // 2
    world.part(list(world.nodes)[:minority], list(world.nodes)[minority:])
    value = world.ask(A, "never", within=1.0)
    world.run(20.0)
    assert world.nodes[A].replies[-1].outcome is Outcome.REJECTED
    assert value.digest in world.laws.rejected
    soup.run()
    world.run(180.0)
    assert "never" not in world.agree()


def test_36_what_may_come_yet_is_not_rejected() -> None:
    """Asked for once more where it was in an ACCEPT: while that is being brought to an end, with a full disk, and without ballots."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT)
    value = world.ask(A, "it", within=1.0)
    known = world.nodes[A]
    world.ask_again(A, value)
    assert known.replies[-1].outcome is Outcome.UNKNOWN, "it is being proposed"
    world.run(60.0, lambda: known.replies[-1].outcome is Outcome.UNKNOWN and known.state.proposal.stage is Stage.IDLE)  # type: ignore[union-attr]
    known.disk.is_full = True
    world.ask_again(A, value)
    known.disk.is_full = False
    world.run(60.0, lambda: known.state is not None and known.state.proposal.stage is not Stage.IDLE)
    world.ask_again(A, value)
    world.ask(A, "another")
    *before, last = known.replies
    assert {reply.outcome for reply in before} == {Outcome.UNKNOWN} and len(before) == 4
    assert (last.outcome, last.reason) == (Outcome.REJECTED, RejectReason.BUSY)
    world.filter = lambda source, target, message: True
    world.run(60.0)
    assert world.agree() == ["it"]


def test_36_without_a_ballot_left_what_was_exposed_is_unknown() -> None:
    book = Book(participants(A, B, C))
    it, other = book.value("it", A), book.value("other", A)
    last = Ballot(COUNTER_MAX, member(A).node)
    slot = Slot(last, None, frozenset({it.digest}))
    view = View(0.0, (), frozenset(), frozenset())
    for value, expected in ((it, Outcome.UNKNOWN), (other, Outcome.REJECTED)):
        step = take(Setting(GENESIS, member(A), key_of(member(A))), State(book, 0, slot), Ask(value, 30.0), view)
        [reply] = step.effects
        assert isinstance(reply, Reply) and (reply.digest, reply.outcome) == (value.digest, expected)


def test_only_a_decision_shows_that_a_position_is_taken() -> None:
    """B says that it is decided, and what it tells is lost: it may have been decided as it was asked for, by whoever was asked before."""
    world = World(1, A, B, C)
    value = world.ask(B, "it")
    world.filter = lambda source, target, message: not isinstance(message, Learn) and target != A
    world.run(1.0)
    assert world.log(B) == ["it"] and not world.log(A)
    world.filter = lambda source, target, message: not isinstance(message, Learn)
    world.ask_again(A, value, within=2.0)
    world.run(20.0)
    assert [reply.outcome for reply in world.nodes[A].replies] == [Outcome.UNKNOWN]
    world.filter = lambda source, target, message: True
    world.sync(A, B)
    world.run(5.0)
    assert world.agree() == ["it"]


def test_a_takeover_that_finds_nobody_begins_anew() -> None:
    """It is given up after a while, waits, and is tried again: when the others are back, what was begun is brought to an end."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT)
    world.ask(A, "it", within=1.0)
    world.run(10.0)
    assert world.nodes[A].replies[-1].outcome is Outcome.UNKNOWN
    world.crash(B)
    world.crash(C)
    world.run(200.0)
    state = world.nodes[A].state
    assert state is not None and state.slot.promised.counter > 10, "it has gone on trying"
    world.filter = lambda source, target, message: True
    world.start(B)
    world.run(60.0)
    assert world.agree(A, B) == ["it"]


def test_what_suits_nobody_is_refused_before_anybody_votes() -> None:
    """A veto counts in the first phase, and only as long as nothing has begun; later the same request gets through."""
    world = World(1, A, B, C)
    world.nodes[B].veto = RejectReason.BUSY
    value = world.ask(A, "it")
    world.run(5.0)
    [reply] = world.nodes[A].replies
    assert (reply.outcome, reply.reason, reply.by) == (Outcome.REJECTED, RejectReason.BUSY, B)
    assert all(known.disk.slot.accepted is None for known in world.nodes.values())
    world.nodes[B].veto = None
    world.ask_again(A, value)
    world.run(5.0)
    assert world.agree() == ["it"]


def test_whoever_abstains_hands_on() -> None:
    """It says nothing, and the others decide; if they are too few, it waits until that one votes."""
    world = World(1, A, B, C)
    world.nodes[B].abstains = True
    world.ask(A, "one")
    world.run(0.2)
    assert B not in {vote.member.node for vote in world.nodes[A].disk.log[0][1].votes}
    world.run(5.0)
    world.crash(C)
    world.ask(A, "two")
    world.run(5.0)
    assert world.log(A) == ["one"]
    world.nodes[B].abstains = False
    world.run(25.0)
    assert world.agree(A, B) == ["one", "two"]


def test_what_is_for_all_waits_for_whoever_seems_alive() -> None:
    """One that cannot answer though it seems alive holds it up, and is named; one that is dead does not."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: source != C
    world.ask(A, "it", is_for_all=True, within=3.0)
    world.run(20.0)
    last = world.nodes[A].replies[-1]
    assert (last.outcome, last.reason, last.by) == (Outcome.REJECTED, RejectReason.PEER_MISSED, C)
    world.crash(C)
    world.ask(A, "it", is_for_all=True)
    world.run(20.0)
    assert world.agree(A, B) == ["it"]


def test_who_was_overtaken_does_not_say_that_nobody_answers() -> None:
    """A higher ballot held the position when time was over: others can be reached, and asking once more may do."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: isinstance(message, Propose)
    world.ask(A, "it", within=0.5)
    world.ask(B, "other", within=0.5)
    world.run(5.0)
    said = world.nodes[A].replies[-1]
    assert (said.outcome, said.reason, said.by) == (Outcome.REJECTED, RejectReason.POSITION_TAKEN, B)


@pytest.mark.parametrize("seed", range(10))
def test_a_few_who_overtake_each_other_say_that_there_is_no_majority(seed: int) -> None:
    world = World(seed, A, B, C, D, E)
    world.part({A, B}, {C, D, E})
    for node in (A, B):
        world.ask(node, f"by {node}", within=6.0)
    world.run(20.0)
    for node in (A, B):
        said = world.nodes[node].replies[-1]
        assert (said.outcome, said.reason) == (Outcome.REJECTED, RejectReason.NO_MAJORITY)


@pytest.mark.parametrize("others", ["dead", "silent"])
@pytest.mark.parametrize("is_barrier", [True, False])
def test_without_a_majority_whoever_asks_is_told_so_at_the_deadline(others: str, is_barrier: bool) -> None:
    """A barrier, too: that nobody knows what became of something is said only by who has met it."""
    world = World(1, A, B, C)
    for node in (B, C):
        if others == "dead":
            world.crash(node)
    if others == "silent":
        world.filter = lambda source, target, message: False
    if is_barrier:
        world.ask_again(A, None, within=6.0)
    else:
        world.ask(A, "it", within=6.0)
    world.run(6.01)
    [said] = world.nodes[A].replies
    assert (said.outcome, said.reason) == (Outcome.REJECTED, RejectReason.NO_MAJORITY)
    state = world.nodes[A].state
    assert state is not None and state.proposal.stage is Stage.IDLE


@pytest.mark.parametrize("reason", [RejectReason.BUSY, RejectReason.MODE_FORBIDS])
def test_a_barrier_is_not_refused_for_what_one_has_against_a_change(reason: RejectReason) -> None:
    """It proposes nothing that could be refused for good: as soon as a majority promises, it says what that knows of."""
    world = World(1, A, B, C)
    world.crash(C)
    refused: list[Refusal] = []

    def b_refuses(source: int, target: int, message: Message) -> bool:
        if target == B and isinstance(message, Propose) and message.proposal.phase is Phase.PREPARE:
            refused.append(signed(Refusal(message.proposal, reason, message.proposal.ballot, member(B)), GENESIS, key_of(member(B))))
            world.deliver(B, source, Rejected(GENESIS, message.proposal, message.digest, refused[-1]))
            return False
        return True

    world.filter = b_refuses
    world.ask_again(A, None, within=30.0)
    world.run(1.0)
    assert refused and not world.nodes[A].replies
    world.filter = lambda source, target, message: True
    world.run(29.0)
    assert [said.outcome for said in world.nodes[A].replies] == [Outcome.OPEN]


def test_a_barrier_that_cannot_bring_to_an_end_what_it_met_does_not_know() -> None:
    """B has voted for it, and says so; then nobody hears of it any more."""
    world = World(1, A, B, C, D, E)

    def until_b(source: int, target: int, message: Message) -> bool:
        return not isinstance(message, Propose) or message.proposal.phase is Phase.PREPARE or target == B

    world.filter = until_b
    world.ask(C, "it", within=1.0)
    world.run(10.0, lambda: world.nodes[B].disk.slot.accepted is not None)
    world.crash(C)
    world.filter = lambda source, target, message: not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT)
    world.ask_again(A, None, within=6.0)
    world.run(6.01)
    assert [said.outcome for said in world.nodes[A].replies] == [Outcome.UNKNOWN]
    world.filter = lambda source, target, message: True
    world.run(60.0)
    assert world.agree(A, B, D, E) == ["it"]


def test_whoever_asks_waits_no_longer_than_to_the_deadline_and_what_is_under_way_goes_on() -> None:
    """The votes come late: it is unknown then, and decided all the same, once."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT)
    value = world.ask(A, "it", within=1.0)
    world.run(1.01)
    state = world.nodes[A].state
    assert [said.outcome for said in world.nodes[A].replies] == [Outcome.UNKNOWN]
    assert state is not None and state.proposal.stage in (Stage.ACCEPTING, Stage.REPEATING), "at the deadline itself"
    world.filter = lambda source, target, message: True
    world.run(60.0)
    assert [(said.digest, said.outcome) for said in world.nodes[A].replies[1:]] == [(value.digest, Outcome.COMMITTED)]
    assert world.agree() == ["it"]


def test_what_nobody_waits_for_any_more_ends_with_the_ballot_that_is_under_way() -> None:
    """Else it would go on for ever, and nobody could ask this node for anything."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT)
    world.ask(A, "it", within=1.0)
    world.run(1.01)
    state = world.nodes[A].state
    assert state is not None and state.proposal.id is not None and not state.proposal.is_asked
    ballot = state.proposal.id.ballot

    def is_idle() -> bool:
        state = world.nodes[A].state
        return state is not None and state.proposal.stage is Stage.IDLE

    timing = world.timing
    world.run(2 * timing.pass_s(2, ballot.counter) + timing.rest_s(1)[1], is_idle)
    assert is_idle() and world.nodes[A].disk.slot.promised == ballot, "no other ballot follows"


def test_the_deadline_of_who_was_answered_ends_nothing_of_what_follows() -> None:
    """It had been answered before; what is taken over when its time comes goes on."""
    world = World(1, A, B, C)
    world.ask(A, "one", within=30.0)
    world.run(1.0)
    world.filter = lambda source, target, message: not (isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT)
    world.ask(B, "two", within=1.0)
    world.run(5.0, lambda: world.nodes[B].disk.slot.accepted is not None)
    world.part({B}, {A, C})
    world.run(24.0, lambda: _is_taking_over(world, B) and world.now > 20)
    before = world.nodes[B].replies[:]
    world.happen(B, TimeOver(Timer(Waits.DEADLINE)))
    assert _is_taking_over(world, B) and world.nodes[B].replies == before
    world.heal()
    world.filter = lambda source, target, message: True
    world.run(60.0)
    assert world.agree() == ["one", "two"]


def _is_taking_over(world: World, node: int) -> bool:
    state = world.nodes[node].state
    return state is not None and state.proposal.stage is not Stage.IDLE and not state.proposal.is_asked


def test_one_at_a_time() -> None:
    """A second request meanwhile is turned away at once; a value that does not fit, and the last one's leaving, are refused."""
    world = World(1, A, B, C)
    world.ask(A, "one")
    world.ask(A, "two")
    assert (world.nodes[A].replies[-1].outcome, world.nodes[A].replies[-1].reason) == (Outcome.REJECTED, RejectReason.BUSY)
    world.run(5.0)
    old = world.first.value("three", A)
    world.ask_again(A, old)
    assert world.nodes[A].replies[-1].reason is RejectReason.ILL_FORMED
    alone = World(1, A)
    alone.ask(A, "nobody", Change(leaves=member(A)))
    assert alone.nodes[A].replies[-1].reason is RejectReason.ILL_FORMED
    state = alone.nodes[A].state
    assert state is not None and state.proposal.stage is Stage.IDLE
