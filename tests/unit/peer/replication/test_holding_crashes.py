"""If one fails, a holder that crashes has confirmed, taken or promised something that it does not know any more."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

import pytest
import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.numbers import first_number
from scenefold.store import Put
from scenefold.wire import HeldListed
from scenefold.world.sim import Point, run_simulated
from unit.peer.replication.holders import arc_of, ask, entry, listing, send, settle_in, some_places, tell
from unit.peer.replication.terrace import Terrace, record_at

T = TypeVar("T")
TIMES = 3
"""Custody is set, records are stored, and all is promised, one after the other."""

pytestmark = pytest.mark.usefixtures("only_errors")


async def insist(question: Callable[[], Awaitable[T]], is_good: Callable[[T], bool]) -> T:
    """Ask until the answer is good."""
    while True:
        try:
            answer = await question()
            if is_good(answer):
                return answer
        except (Refused, Unreachable, PeerFault):
            pass
        await trio.sleep(0.5)


async def tell_all(terrace: Terrace) -> None:
    """Each answer is good only for what is on the disk when it comes."""
    owner, holder, other = terrace.homes
    arc, spots = arc_of(owner), some_places(owner, TIMES)
    members = owner.member, holder.member, other.member

    def holds(number: int) -> bool:
        return [(found.number, found.whole) for found in holder.durable_copies().custody.entries] == [(number, number > 1)]

    for number, spot in enumerate(spots, 1):
        said = entry(number, arc, members, whole=number > 1)
        await insist(lambda said=said, number=number: tell(owner, holder, number, said), lambda answer: answer.reason == 0)  # type: ignore[misc]
        assert holds(number)
        await insist(lambda spot=spot: send(owner, holder, record_at(spot)), lambda reasons: reasons == (0,))  # type: ignore[misc]
        assert spot in holder.places()
    asked = await insist(lambda: ask(owner, holder, listing(owner, holder, arc), HeldListed), lambda page: page.reason == 0)
    assert [held.location for held in asked.records] == spots
    bound = first_number(terrace.log.registry.position)
    kept = holder.durable_copies().custody
    assert kept.highest(arc) == bound - 1 and all(found.fenced for found in kept.entries)
    refused = await insist(lambda: send(owner, holder, record_at(spots[0], 2)), lambda _: True)
    assert refused == (RejectReason.NOT_MY_LOCATION,)


def crashing(story: Callable[[Terrace], Awaitable[None]], number: int, point: Point, count: int) -> bool:
    """A crash of a house at its n-th passing of a point. False if it did not come so far."""

    async def main() -> bool:
        terrace = Terrace(3, is_quiet=True)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await settle_in(terrace)
            sprung = False

            def spring() -> None:
                nonlocal sprung
                sprung = True
                terrace.homes[number].crash()

            terrace.net.trap(terrace.homes[number].address, point, count, spring)
            with trio.fail_after(400.0):
                await story(terrace)
            nursery.cancel_scope.cancel()
        return sprung

    return run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


@pytest.mark.parametrize("point", list(Point))
def test_a_crash_of_a_holder_at_every_step(point: Point) -> None:
    count = 1
    while crashing(tell_all, 1, point, count):
        count += 1
    assert count > 2 * TIMES


async def bring_home(terrace: Terrace) -> None:
    """A copy that is held no more comes home; it is somewhere at every moment."""
    owner, holder, _ = terrace.homes
    spots = some_places(owner, 4)
    while holder.line is None or holder.store is None:  # noqa: ASYNC110 - it may be down
        await trio.sleep(0.1)
    await insist(lambda: holder.store.merge([Put(record_at(place)) for place in spots]), lambda _: True)
    broken: list[str] = []

    def look() -> None:
        if not set(spots) <= owner.places() | holder.places():
            broken.append("a record is nowhere")

    for home in (owner, holder):
        terrace.net.observe(home.address, Point.AFTER_COMMIT, look)

    def is_home() -> bool:
        return holder.places() == set() and owner.places() == set(spots)

    while not is_home():  # noqa: ASYNC110 - the disks are the truth, and tell nobody when they change
        await trio.sleep(1.0)
    assert not broken


@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, Point.AFTER_COMMIT])
@pytest.mark.parametrize("number", [0, 1])
def test_a_crash_while_a_stray_of_a_space_with_copies_comes_home(number: int, point: Point) -> None:
    for count in (1, 2, 3):
        crashing(bring_home, number, point, count)
