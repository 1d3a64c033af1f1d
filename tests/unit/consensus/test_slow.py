"""If one fails, nothing is ever decided where answers take longer than a ballot is waited for: links that are slow, disks that are, or large bodies."""

from __future__ import annotations

import pytest

from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide, Effect, Event, Outcome, Persist, Propose, State
from scenefold.consensus.state import Proposal, Stage
from scenefold.wire import Phase
from unit.consensus.world import Weather, World

A, B, C, D, E = range(1, 6)
AT_ONCE = 1_000_000
WITHIN_S = 120.0


class SlowDisks(World):
    """A write takes a while, and what comes to a node meanwhile waits."""

    sync_s = 0.0

    def __init__(self, seed: int, *nodes: int, weather: Weather | None = None) -> None:
        self.free_at = dict.fromkeys(nodes, 0.0)
        super().__init__(seed, *nodes, weather=weather)

    def happen(self, node: int, event: Event) -> None:
        if self.now < self.free_at[node]:
            self.after(self.free_at[node] - self.now, lambda: self.happen(node, event))
            return
        super().happen(node, event)

    def _carry_out(self, node: int, before: State, effect: Effect) -> None:
        if isinstance(effect, Persist | Decide):
            self.free_at[node] = self.now + self.sync_s
        late_s = self.free_at[node] - self.now
        if late_s > 0 and not isinstance(effect, Persist | Decide):
            self.after(late_s, lambda: super(SlowDisks, self)._carry_out(node, before, effect))
            return
        super()._carry_out(node, before, effect)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("way_s", "sync_s"), [(4.0, 0.0), (5.0, 0.0), (7.5, 0.0), (0.01, 8.0)])
@pytest.mark.parametrize("is_for_all", [False, True])
def test_what_is_slow_is_decided(way_s: float, sync_s: float, is_for_all: bool, seed: int) -> None:
    """A is not the first, or asks everybody, so it needs promises; they come while it pauses, if not before."""
    world = SlowDisks(seed, B, A, C, weather=Weather(delay_s=(way_s, way_s)))
    world.at_once_bytes, world.sync_s = AT_ONCE, sync_s
    value = world.ask(A, "it", within=WITHIN_S, is_for_all=is_for_all)
    world.run(WITHIN_S, lambda: bool(world.nodes[A].replies))
    [reply] = world.nodes[A].replies
    assert (reply.digest, reply.outcome) == (value.digest, Outcome.COMMITTED)
    world.run(WITHIN_S)
    assert world.agree() == ["it"]


@pytest.mark.parametrize("way_s", [4.0, 7.5])
@pytest.mark.parametrize("seed", range(3))
def test_a_look_where_all_is_slow_has_an_answer(way_s: float, seed: int) -> None:
    world = World(seed, B, A, C, weather=Weather(delay_s=(way_s, way_s)))
    world.ask_again(A, None, within=WITHIN_S)
    world.run(WITHIN_S)
    assert [reply.outcome for reply in world.nodes[A].replies] == [Outcome.OPEN]


def proposal_of(world: World, node: int) -> Proposal:
    state = world.nodes[node].state
    assert state is not None
    return state.proposal


def in_its_pause(*nodes: int, way_s: float = 4.0) -> World:
    """Nothing has come home to A yet, and it cannot begin another ballot."""
    world = World(1, *nodes, weather=Weather(delay_s=(way_s, way_s)))
    world.at_once_bytes = AT_ONCE
    world.ask(A, "it", within=WITHIN_S)
    world.run(10.0, lambda: proposal_of(world, A).stage is Stage.RESTING)
    world.nodes[A].disk.is_full = True
    world.run(5.5)
    assert proposal_of(world, A).stage is Stage.RESTING and world.now < 2 * way_s
    return world


def accepts(world: World) -> list[Propose]:
    return [message for _, _, _, message in world.packets if isinstance(message, Propose) and message.proposal.phase is Phase.ACCEPT]


def test_promises_that_come_in_the_pause_count() -> None:
    world = in_its_pause(B, A, C)
    world.nodes[A].disk.is_full = False
    before = proposal_of(world, A).id
    world.run(4.0, lambda: bool(accepts(world)))
    assert before is not None and accepts(world)[0].proposal.ballot == before.ballot
    assert proposal_of(world, A).stage is Stage.ACCEPTING
    world.run(WITHIN_S)
    assert world.agree() == ["it"]


def test_promises_that_come_in_the_pause_do_not_count_once_a_higher_ballot_is_promised() -> None:
    """A then must not vote in its own, though B has promised that, too."""
    world = World(1, B, A, C, weather=Weather(delay_s=(4.0, 4.0)))
    world.at_once_bytes = AT_ONCE
    world.after(3.9, lambda: world.ask(C, "by C"))
    world.ask(A, "it", within=WITHIN_S)
    world.run(3.95, lambda: proposal_of(world, A).stage is Stage.RESTING)
    world.nodes[A].disk.is_full = True
    world.run(7.85 - world.now)
    world.nodes[A].disk.is_full = False
    mine = proposal_of(world, A).id
    assert mine is not None and proposal_of(world, A).stage is Stage.RESTING
    world.run(8.05 - world.now)
    promised = world.nodes[A].disk.slot.promised
    assert {fact.member.node for fact in proposal_of(world, A).facts} == {A, B} and promised > mine.ballot
    assert proposal_of(world, A).stage is Stage.RESTING and world.nodes[A].disk.slot.accepted is None
    world.run(2 * WITHIN_S)
    assert all(message.proposal.ballot != mine.ballot for message in accepts(world))


def test_the_disk_takes_no_vote_when_the_promises_come() -> None:
    """Then it votes in a later ballot."""
    world = in_its_pause(B, A, C)
    before = proposal_of(world, A).id
    world.run(3.0)
    assert len(proposal_of(world, A).facts) == 3 and proposal_of(world, A).id == before and not accepts(world)
    world.nodes[A].disk.is_full = False
    world.run(WITHIN_S)
    assert world.agree() == ["it"]


def test_a_refusal_that_comes_in_the_pause_is_told() -> None:
    """B has something against it, and says so late: nobody votes for it, though A, C, D and E would be a majority."""
    world = World(1, B, A, C, D, E, weather=Weather(delay_s=(5.0, 5.0)))
    world.at_once_bytes = AT_ONCE
    world.nodes[B].veto = RejectReason.BUSY
    world.ask(A, "it", within=WITHIN_S)
    world.run(WITHIN_S)
    [reply] = world.nodes[A].replies
    assert (reply.outcome, reply.reason, reply.by) == (Outcome.REJECTED, RejectReason.BUSY, B)
    assert not accepts(world)


@pytest.mark.parametrize("is_cut", [False, True])
def test_who_reaches_no_majority_waits_no_longer_for_that(is_cut: bool) -> None:
    """Of many ballots all came to nothing: for want of links, which may be there again at once, or of answers, which may come late."""
    world = World(1, B, A, C)
    world.at_once_bytes = AT_ONCE
    world.filter = lambda source, target, message: False
    if is_cut:
        world.part({A}, {B, C})
    world.ask(A, "it", within=WITHIN_S)
    world.run(60.0, lambda: _tries(world) >= 5 and proposal_of(world, A).stage is Stage.SEEKING)
    began = world.now
    world.run(60.0, lambda: proposal_of(world, A).stage is not Stage.SEEKING)
    assert round(world.now - began, 3) == (3.6 if is_cut else 14.4)


def _tries(world: World) -> int:
    state = world.nodes[A].state
    assert state is not None
    return state.tries
