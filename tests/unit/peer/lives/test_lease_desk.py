"""If this fails, a voter forgets what it granted, grants while it votes, or grants without knowing what those before it granted."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.held_notes import READY, changed_notes, load_held, pack_page, unpack_page, unpack_ready
from scenefold.peer.cluster_log.lease_desk import LeaseDesk
from scenefold.peer.cluster_log.lease_grants import KEPT_S, Held, Question
from scenefold.peer.cluster_log.lives import note_of, pack_granted
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.peer.cluster_log.registry import Registry
from scenefold.store import Store, open_store
from scenefold.world.sim import SimNet, run_simulated
from unit.peer.logs_made import incarnation, member, node, remove
from unit.peer.voters_made import Senate, dismissed, named

FOLDER = Path("/data")
PAGES = st.dictionaries(st.binary(min_size=16, max_size=16), st.builds(Life, st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1)))


class Voter:
    """A desk, and all that it looks at."""

    def __init__(self, net: SimNet, store: Store, number: int, registry: Registry) -> None:
        self.registry, self.has_accepted, self.store = registry, False, store
        world = net.world(f"node:{number}", "127.0.0.2")
        self.desk = LeaseDesk(world, store, member(number), lambda: self.registry, lambda: self.has_accepted)

    async def goes_on(self, registry: Registry | None = None) -> None:
        self.registry = self.registry if registry is None else registry
        await self.desk.look()

    async def refusal(self, question: Question) -> RejectReason:
        with pytest.raises(Refused) as caught:
            await self.desk.grant(question)
        return caught.value.reason

    def asked(self, number: int, life: Life, nonce: int = 1) -> Question:
        return Question(member(number), self.registry.position, life, nonce)


@asynccontextmanager
async def voter(net: SimNet, number: int, registry: Registry) -> AsyncIterator[Voter]:
    """A life of a voter, on the disk that it had."""
    async with open_store(net.world(f"node:{number}", f"127.0.0.{number + 2}"), FOLDER, node(number), reserve_bytes=0) as store:
        one = Voter(net, store, number, registry)
        await one.desk.load()
        yield one


def simulate(scenario: Callable[[SimNet], Awaitable[None]]) -> None:
    async def main() -> None:
        await scenario(SimNet(1))

    run_simulated(1, main, virtual_s_max=600, wall_s_max=60)


# --------------------------------------------------------------------------------------------------------- notes


@given(PAGES)
def test_a_page_of_lives_is_kept_as_it_was(lives: dict[bytes, Life]) -> None:
    assert unpack_page(pack_page(lives)) == lives


@pytest.mark.parametrize("data", [b"?", pack_page({bytes(16): Life(1, 1)})[1:], 2 * pack_page({bytes(16): Life(1, 1)})])
def test_a_page_that_is_none_is_damaged(data: bytes) -> None:
    with pytest.raises(DamagedData):
        unpack_page(data)
    with pytest.raises(DamagedData):
        unpack_ready(data)


@given(PAGES, PAGES, st.integers(0, 9), st.integers(0, 9))
def test_what_has_changed_is_written_and_nothing_else(before: dict[bytes, Life], more: dict[bytes, Life], was: int, ready: int) -> None:
    one, other = Held(before, was), Held({**before, **more}, ready)
    notes = changed_notes(one, other, lambda _: False)
    assert (READY in notes) is (was != ready)
    touched = {name[0] for name, life in more.items() if before.get(name) != life}
    assert len(notes) - (READY in notes) == len(touched)
    read: dict[bytes, Life] = {name: life for name, life in before.items() if name[0] not in touched}
    for name, data in notes.items():
        read |= {} if name == READY else unpack_page(data)
    assert read == other.lives
    assert all(not unpack_page(data) for name, data in changed_notes(one, other, lambda _: True).items() if name != READY)


# ------------------------------------------------------------------------------------------------------ the desk


def test_what_was_granted_is_on_the_disk_and_counts_after_a_start() -> None:
    async def scenario(net: SimNet) -> None:
        senate = Senate(voters=1)
        async with voter(net, 0, senate.registry) as one:
            assert one.desk.is_awake and one.desk.held.ready_at == senate.registry.position, "it has granted alone until now"
            assert await one.desk.grant(one.asked(3, Life(2, 7)))
            assert await load_held(one.store) == one.desk.held
        async with voter(net, 0, senate.registry) as one:
            assert await one.desk.grant(one.asked(3, Life(2, 7)))
            for older in (Life(2, 8), Life(1, 7)):
                assert await one.refusal(one.asked(3, older)) is RejectReason.WRONG_INCARNATION
            assert await one.refusal(one.asked(3, Life(9, 0))) is RejectReason.ILL_FORMED
            assert await one.refusal(Question(member(3, life=1), one.registry.position, Life(9, 1), 1)) is RejectReason.NOT_AUTHORISED
            assert not await one.desk.grant(replace(one.asked(3, Life(3, 7)), have=one.registry.position - 1))

    simulate(scenario)


def test_what_one_voter_granted_without_numbers_counts_on() -> None:
    async def scenario(net: SimNet) -> None:
        senate = Senate(voters=1)
        async with voter(net, 0, senate.registry) as one:
            await one.store.put_note(note_of(node(3)), pack_granted(incarnation(3), 77))
        async with voter(net, 0, senate.registry) as one:
            assert await one.refusal(one.asked(3, Life(0, 78))) is RejectReason.WRONG_INCARNATION
            assert await one.desk.grant(one.asked(3, Life(0, 77))) and await one.desk.grant(one.asked(3, Life(1, 5)))
            assert await one.refusal(one.asked(3, Life(0, 77))) is RejectReason.WRONG_INCARNATION
        async with voter(net, 0, senate.registry) as one:
            assert await one.refusal(one.asked(3, Life(0, 77))) is RejectReason.WRONG_INCARNATION

    simulate(scenario)


def test_a_question_waits_while_something_is_accepted_and_no_longer_than_a_second() -> None:
    async def scenario(net: SimNet) -> None:
        senate = Senate(voters=1)
        async with voter(net, 0, senate.registry) as one:
            one.has_accepted = True
            before = trio.current_time()
            assert not await one.desk.grant(one.asked(3, Life(1, 1)))
            assert trio.current_time() - before == pytest.approx(KEPT_S)
            said: list[bool] = []

            async def ask(question: Question) -> None:
                said.append(await one.desk.grant(question))

            async with trio.open_nursery() as nursery:
                question = one.asked(3, Life(1, 1))
                nursery.start_soon(ask, question)
                await trio.sleep(0.5)
                await one.goes_on()
                assert said == [], "nothing is decided yet"
                senate.decide(remove(4))
                one.has_accepted = False
                await one.goes_on(senate.registry)
            assert said == [True], "who votes is the same as what the asker knows"
            one.has_accepted = True
            said.clear()
            async with trio.open_nursery() as nursery:
                nursery.start_soon(ask, one.asked(3, Life(2, 1)))
                await trio.sleep(0.5)
                senate.decide(named(1))
                one.has_accepted = False
                await one.goes_on(senate.registry)
            assert said == [False], "others vote now"

    simulate(scenario)


def test_who_comes_hears_of_a_majority_before_it_grants_or_votes_for_another() -> None:
    async def scenario(net: SimNet) -> None:
        senate = Senate(voters=1)
        async with voter(net, 0, senate.registry) as first:
            assert await first.desk.grant(first.asked(3, Life(4, 4)))
            senate.decide(named(1))
            async with voter(net, 1, senate.registry) as second:
                assert not second.desk.is_awake and not second.desk.may_vote(changes_voters=False)
                second.desk.heard(member(0), is_refused=False)
                assert second.desk.may_vote(changes_voters=False) and not second.desk.may_vote(changes_voters=True)
                at, ask = second.desk.to_ask()
                assert (at, ask) == (senate.registry.position, (member(0),))
                with pytest.raises(Refused):
                    first.desk.tell(at)
                await first.goes_on(senate.registry)
                assert first.desk.may_vote(changes_voters=True), "it was ready, and is a majority of those before"
                await second.desk.told(member(0), at, first.desk.tell(at))
                assert second.desk.may_vote(changes_voters=True) and second.desk.to_ask()[1] == ()
                assert await second.refusal(second.asked(3, Life(3, 9))) is RejectReason.WRONG_INCARNATION
                assert await second.desk.grant(second.asked(3, Life(4, 4)))
            senate.decide(dismissed(1))
        async with voter(net, 1, senate.registry) as gone:
            assert not gone.desk.may_vote(changes_voters=False) and gone.desk.tell(senate.registry.position)[incarnation(3)] == Life(4, 4)
            assert not await gone.desk.grant(gone.asked(3, Life(5, 5)))

    simulate(scenario)


def test_lives_of_those_who_are_over_are_neither_told_nor_kept() -> None:
    async def scenario(net: SimNet) -> None:
        senate = Senate(voters=1)
        async with voter(net, 0, senate.registry) as one:
            assert await one.desk.grant(one.asked(4, Life(1, 1))) and await one.desk.grant(one.asked(3, Life(1, 1)))
            for entry in (remove(4), named(1)):
                senate.decide(entry)
            await one.goes_on(senate.registry)
            assert set(one.desk.tell(senate.registry.position)) == {incarnation(3)}

    simulate(scenario)


def test_a_voter_whose_life_is_an_older_one_begins_anew() -> None:
    async def scenario(net: SimNet) -> None:
        senate = Senate(voters=3)
        async with voter(net, 1, senate.registry) as one:
            one.desk.heard(member(2), is_refused=True)
            one.desk.heard(member(0), is_refused=False)
            assert one.desk.is_restored and not one.desk.is_awake and not one.desk.may_vote(changes_voters=False)

    simulate(scenario)
