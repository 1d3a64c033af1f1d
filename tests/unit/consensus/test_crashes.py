"""If one fails, a crash at the wrong moment makes two histories of one log, or none (design of the consensus §14, scenarios 2 to 5, 11 to 14 and 39)."""

from __future__ import annotations

import pytest

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Accepted, Learn, Lost, Message, Outcome, Propose, Rejected
from scenefold.wire import Phase
from unit.consensus.logs_made import Change, member
from unit.consensus.world import World

A, B, C, D, E = range(1, 6)


def five(seed: int = 1) -> World:
    return World(seed, A, B, C, D, E)


def is_accept(message: Message) -> bool:
    return isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT


def voters(world: World) -> set[int]:
    """Who has something tentative, or has decided."""
    return {node for node, known in world.nodes.items() if known.disk.slot.accepted or known.disk.log}


@pytest.mark.parametrize("origin", [A, C, E])
def test_02_originator_dies_after_the_last_vote(origin: int) -> None:
    """Before it has decided, and for ever: others take over, and decide the same."""
    world = five()
    world.filter = lambda source, target, message: not (isinstance(message, Accepted) and message.proposal.phase is Phase.ACCEPT)
    world.ask(origin, "it")
    world.run(10.0, lambda: len(voters(world)) == 5)
    world.crash(origin)
    world.filter = lambda source, target, message: not isinstance(message, Learn) or source != origin
    world.run(30.0)
    rest = {A, B, C, D, E} - {origin}
    assert world.agree(*rest) == ["it"]
    world.start(origin)
    world.run(30.0)
    assert world.agree() == ["it"], "whoever comes back takes over what it has voted for itself, and is told"


def test_03_originator_dies_after_the_first_phase() -> None:
    """Nothing is left of it, and the next proposal takes the position."""
    world = five()
    world.ask(C, "lost")
    world.run(10.0, lambda: all(known.disk.slot.promised.counter for known in world.nodes.values()))
    world.crash(C)
    world.run(20.0)
    assert voters(world) == set()
    world.ask(A, "next")
    world.run(20.0)
    assert world.agree(A, B, D, E) == ["next"]


@pytest.mark.parametrize("effects", range(14))
@pytest.mark.parametrize("origin", [A, C])
@pytest.mark.parametrize("with_it", [False, True])
def test_04_originator_dies_after_each_effect(effects: int, origin: int, with_it: bool) -> None:
    """Wherever it dies: nothing, or that request; one outcome everywhere, with it or without it."""
    world = five()
    world.keep_in_step()
    world.crash_in[origin] = effects
    world.ask(origin, "it")
    world.run(30.0)
    if with_it and not world.up(origin):
        world.start(origin)
    world.run(60.0)
    rest = [node for node in world.nodes if world.up(node)]
    log = world.agree(*rest)
    assert log in ([], ["it"])
    world.crash_in.clear()
    world.ask(D, "next")
    world.run(30.0)
    assert world.agree(*rest) == [*log, "next"]


@pytest.mark.parametrize("hop", [B, C, D, E])
@pytest.mark.parametrize("voter_lives", [False, True])
def test_04_originator_dies_after_one_vote(hop: int, voter_lives: bool) -> None:
    """A vote of its own and one more, at each of the others in turn; then whoever has cast that one is up, or is not."""
    world = five()
    # Only this one hears the second phase.
    world.filter = lambda source, target, message: not is_accept(message) or target == hop
    world.ask(A, "it")
    world.run(10.0, lambda: world.nodes[hop].disk.slot.accepted is not None)
    world.crash(A)
    if not voter_lives:
        world.crash(hop)
    world.filter = lambda source, target, message: True
    world.run(30.0)
    rest = [node for node in world.nodes if world.up(node)]
    assert world.agree(*rest) == (["it"] if voter_lives else [])
    world.ask(rest[-1], "next")
    world.run(30.0)
    for node in set(world.nodes) - set(rest):
        world.start(node)
    for node in (A, hop):
        world.sync(node, rest[-1])
    world.run(30.0)
    assert world.agree() == (["it", "next"] if voter_lives else ["next"])


@pytest.mark.parametrize("n", [3, 5, 7, 9, 33])
def test_04_nobody_waits_for_an_originator_whose_connections_have_ended(n: int) -> None:
    """Though it seems alive for long: who has voted for what it began lets others go on at once, however many decide."""
    world = World(1, *range(1, n + 1))
    world.at_once_bytes = 1 << 20
    origin = int(world.nodes[A].book.participants.first)
    rest = [node for node in world.nodes if node != origin]
    world.filter = lambda source, target, message: not isinstance(message, Accepted) or target != origin
    world.ask(origin, "it", needs_consent=False)
    world.run(10.0, lambda: len(voters(world)) == n)
    world.believed = {origin}
    world.crash(origin)
    for node in rest:
        world.happen(node, Lost(NodeId(origin)))
    died = world.now
    world.ask(rest[-1], "next", needs_consent=False)
    world.run(30.0, lambda: bool(world.log(rest[-1])))
    assert world.log(rest[-1]) == ["it"]
    assert world.now - died < 1.5


@pytest.mark.parametrize("deaf", [{B, C, D, E}, {B}, {C, D, E}])
def test_05_the_news_is_lost(deaf: set[int]) -> None:
    """To all, to one, to a majority: healed by those who have voted."""
    world = five()
    world.filter = lambda source, target, message: (
        not (
            (isinstance(message, Learn) or (isinstance(message, Accepted) and message.proposal.phase is Phase.ACCEPT and target != A))
            and target in deaf
        )
    )
    world.ask(A, "it")
    world.run(1.0, lambda: bool(world.nodes[A].disk.log))
    world.run(0.5)
    world.filter = lambda source, target, message: True
    world.run(60.0)
    for node in deaf:
        world.sync(node, A)
    world.run(1.0)
    assert world.agree() == ["it"]


@pytest.mark.parametrize("effects", [0, 1])
def test_11_voter_dies_around_its_write(effects: int) -> None:
    """Between receiving and writing: it has never voted. Between writing and sending: its vote counts when it is asked again."""
    world = World(1, A, B)
    world.filter = lambda source, target, message: True
    world.ask(A, "it")
    world.run(10.0, lambda: any(is_accept(message) for *_, message in world.packets))
    world.crash_in[B] = effects
    world.run(10.0, lambda: not world.up(B))
    assert (world.nodes[B].disk.slot.accepted is not None or bool(world.nodes[B].disk.log)) is (effects == 1)
    assert not world.nodes[A].disk.log
    world.start(B)
    world.run(30.0)
    assert world.agree() == ["it"]


def test_12_an_older_ballot_comes_again() -> None:
    """After a restart: 9 with reason 1, and nothing changes."""
    world = World(1, A, B, C)
    world.filter = lambda source, target, message: not is_accept(message) or source != A
    world.ask(A, "first", within=3.0)
    world.run(10.0)
    world.part({A}, {B, C})
    world.ask(B, "second")
    world.filter = lambda source, target, message: not is_accept(message) and not isinstance(message, Accepted)
    world.run(5.0)
    kept = world.nodes[C].disk.slot
    world.crash(C)
    world.start(C)
    world.heal()
    old = next(message for *_, message in world.packets if isinstance(message, Propose) and message.proposal.ballot.node == A)
    before = len(world.packets)
    world.deliver(A, C, old)
    world.run(0.02)
    refused = [message for _, source, _, message in world.packets[before:] if source == C and isinstance(message, Rejected)]
    assert [message.refusal.reason for message in refused] == [RejectReason.POSITION_TAKEN]
    assert refused[0].refusal.hint == kept.promised
    assert world.nodes[C].disk.slot == kept


def test_13_a_wiped_node_comes_back() -> None:
    """Under another incarnation: it takes no part, and nobody counts it, until it is added."""
    world = World(1, A, B, C)
    world.ask(A, "one")
    world.run()
    world.crash(C)
    was = world.nodes[C].disk.member
    world.wipe(C)
    world.start(C)
    world.part({A, C}, {B})
    world.ask(A, "two", within=5.0)
    world.run(20.0)
    assert world.log(A) == ["one"], "one of three, and a stranger, are no majority"
    assert world.nodes[C].disk.slot.promised.counter == 0
    world.sync(C, A)
    world.run(1.0)
    world.ask(C, "mine")
    assert (world.nodes[C].replies[-1].outcome, world.nodes[C].replies[-1].reason) == (Outcome.REJECTED, RejectReason.NOT_AUTHORISED)
    world.heal()
    world.run(60.0)
    world.ask(A, "without", Change(leaves=was))
    world.run(60.0)
    world.ask(B, "with", Change(joins=member(C, 1)))
    world.run(30.0)
    assert world.agree()[-2:] == ["without", "with"]
    world.part({A}, {B, C})
    world.ask(C, "mine again")
    world.run(10.0)
    assert world.agree(B, C)[-1] == "mine again"


def test_14_everything_again() -> None:
    """All packets of a finished run, in any order, twice: nobody's state changes."""
    world = five()
    for number, node in enumerate((A, C, E, A)):
        world.ask(node, f"r{number}")
        world.run(5.0)
    before = {node: (known.disk.slot, list(known.disk.log)) for node, known in world.nodes.items()}
    again = [*world.packets, *world.packets]
    world.random.shuffle(again)
    for _, source, target, message in again:
        world.deliver(source, target, message)
    world.run(60.0)
    assert {node: (known.disk.slot, list(known.disk.log)) for node, known in world.nodes.items()} == before


def test_39_full_disks() -> None:
    """One whose disk is full hands on what others say. While a majority's are, nothing is decided; then it is."""
    world = five()
    world.nodes[B].disk.is_full = True
    world.ask(A, "one")
    world.run(5.0)
    assert world.agree(A, C, D, E) == ["one"] and world.log(B) == []
    world.nodes[C].disk.is_full = world.nodes[D].disk.is_full = True
    value = world.ask(A, "two", within=5.0)
    world.run(20.0)
    assert world.log(A) == ["one"] and world.nodes[A].replies[-1].outcome is Outcome.REJECTED
    world.ask(B, "three")
    assert world.nodes[B].replies[-1].reason is RejectReason.STORAGE_FULL
    for node in world.nodes.values():
        node.disk.is_full = False
    world.sync(B, A)
    world.run(5.0)
    world.ask_again(A, value)
    world.run(20.0)
    assert world.agree() == ["one", "two"], "what is asked for again was in no ACCEPT, or is decided: it may be decided now"
