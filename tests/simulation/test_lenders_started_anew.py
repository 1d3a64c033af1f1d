"""If this fails, a polite change of the mode cuts off who edits by a lease that a participant lent before it was killed and started again, or never comes.

Nor does it when one of them is killed for good."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.client.modes import set_mode
from scenefold.client.scene import Scene
from scenefold.peer.timing import T_LEASE_S, T_WAIT_S
from scenefold.simulation.clients import MemoryKeyring, open_client
from scenefold.simulation.cluster import key_of
from scenefold.wire import SceneMode
from simulation.test_client_participants import Court, held
from simulation.test_editing import modes, place

DECIDERS = (1, 2, 3)
"""The cluster's voter is none of them, so that nobody waits for another lease than that of the scene."""
CHANGE_S_MAX = 5.0
"""Of one that asks nobody, as of all others behind a death (specs/25-consensus.md, Where it may die)."""


@asynccontextmanager
async def another(court: Court) -> AsyncIterator[Scene]:
    """The scene as another program has it."""
    world, writer = court.cluster.net.world("user:editor"), key_of(1, "the writer")
    async with open_client("editor", world, court.cluster.facts, MemoryKeyring(), writer, court.cluster.watch.recorder) as client:
        yield await client.scenes.open("kitchen")


def lender(court: Court) -> int | None:
    for slot in DECIDERS:
        context = court.cluster.nodes[slot].context
        assert context is not None
        if modes(court, slot).standing.lender.borrowers(context.world.clock.now()):
            return slot
    return None


async def started_anew(court: Court, slot: int) -> float:
    """Killed, and up and deciding again; gives when it died."""
    died_at = trio.current_time()
    court.crash(slot)
    await court.start(slot)

    def decides() -> bool:
        context = court.cluster.nodes[slot].context
        one = None if context is None else context.participation.of(court.scene.id)
        return one is not None and one.takes_part

    await court.until(decides)
    return died_at


def test_who_edits_goes_on_until_the_lease_is_over_and_then_the_mode_changes() -> None:
    async def main(court: Court) -> None:
        await court.create(*DECIDERS)
        await trio.sleep(T_WAIT_S)
        stored, refused, decided = list[float](), list[tuple[float, Refused]](), list[float]()
        async with another(court) as scene, trio.open_nursery() as nursery:
            hall = scene.space(court.hall.id)

            async def edit() -> None:
                for number in range(10_000):
                    try:
                        await hall.put_at(((number + 0.5) / 10_000, 0.5, 0.5), b"%d" % number)
                    except Refused as refusal:
                        refused.append((trio.current_time(), refusal))
                        return
                    stored.append(trio.current_time())
                    await trio.sleep(0.2)

            nursery.start_soon(edit)
            await court.until(lambda: lender(court) is not None)
            slot = lender(court)
            assert slot is not None
            died_at = await started_anew(court, slot)
            assert lender(court) is None, "nobody knows of it any more"
            shown = await set_mode(court.scene.access, SceneMode.RENDER, lambda _: decided.append(trio.current_time()))
            assert shown.is_active, "whoever changes the mode has patience for that"
            assert decided and decided[0] - died_at >= T_LEASE_S, "what it lent was live until then"
            await court.until(lambda: bool(refused))
        assert sum(died_at < at < decided[0] for at in stored) > T_LEASE_S, "it went on writing"
        assert max(stored) < decided[0] <= refused[0][0], "and was refused nothing that it had signed"
        assert refused[0][1].reason is RejectReason.MODE_FORBIDS and "render mode" in str(refused[0][1])

    held(4, main)


def test_who_insists_asks_it_no_more_than_others() -> None:
    async def main(court: Court) -> None:
        await court.create(*DECIDERS)
        await court.hall.put_at(place(0), b"a chair")
        slot = lender(court)
        assert slot is not None
        await started_anew(court, slot)
        began, decided = trio.current_time(), list[float]()
        shown = await set_mode(court.scene.access, SceneMode.RENDER, lambda _: decided.append(trio.current_time()), force=True)
        assert shown.is_active and decided and decided[0] - began < CHANGE_S_MAX
        assert trio.current_time() - began >= T_LEASE_S, "and what it lent was over before anybody could act by that"

    held(4, main)


def test_behind_a_death_the_mode_changes_soon_and_is_active_when_what_the_dead_one_lent_is_over() -> None:
    async def main(court: Court) -> None:
        await court.create(*DECIDERS)
        await trio.sleep(T_WAIT_S)
        court.crash(DECIDERS[-1])
        began, decided = trio.current_time(), list[float]()
        shown = await set_mode(court.scene.access, SceneMode.RENDER, lambda _: decided.append(trio.current_time()))
        assert shown.is_active and decided and decided[0] - began < CHANGE_S_MAX
        assert T_LEASE_S <= trio.current_time() - decided[0] < T_WAIT_S + 2.0

    held(4, main)
