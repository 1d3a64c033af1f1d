"""If this fails, who joins over a bad network is let in twice or not at all, certificates run out, or a revoked member goes on."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
import trio

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client.enrolling import enrol
from scenefold.crypto import Card
from scenefold.wire import RequestTable, RespondTable
from scenefold.wire.enrol_entries import ANY_NODE, RevokeUser
from scenefold.world import Links, Priority, open_links
from scenefold.world.roll import InvitationState
from scenefold.world.sim import Delay, SimNet, Weather, run_simulated
from simulation.studio import DAY, Studio

SEEDS = range(3)
BAD = Weather(Delay(0.001, 0.02, 0.5), loss=0.3, duplication=0.1, reordering=0.2)
NEWCOMER = "newcomer"
COMING = "10.0.0.9"

pytestmark = pytest.mark.usefixtures("silent")


def simulate(seed: int, weather: Weather, count: int, play: Callable[[Studio], Awaitable[None]], **how: object) -> None:
    async def run() -> None:
        async with trio.open_nursery() as nursery:
            studio = Studio(SimNet(seed, weather=weather), count, nursery, **how)  # type: ignore[arg-type]
            await studio.start(*range(count))
            await studio.joined()
            await play(studio)
            for number in range(count):
                studio.stop(number)
            nursery.cancel_scope.cancel()

    run_simulated(seed, run, virtual_s_max=1e5, wall_s_max=100)


async def until(happened: Callable[[], bool]) -> None:
    """Virtual time is bounded for the whole run."""
    while not happened():  # noqa: ASYNC110  what it waits for has no event
        await trio.sleep(1.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_whose_answer_was_lost_joins_once_over_a_bad_network(seed: int, tmp_path: Path) -> None:
    async def play(studio: Studio) -> None:
        net, log = studio.net, studio.of(0).cluster_log
        token = await studio.invite("user:ada", ("10.0.0.2", "10.0.0.3"))
        world = net.world(NEWCOMER)

        async def cut_off_once_issued() -> None:
            while (registry := log.registry).roll.invitations[token.key.public.raw].state is InvitationState.OPEN:
                await log.changed_after(registry.position)
            for node in studio.nodes:
                net.cut(NEWCOMER, node.address)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(cut_off_once_issued)
            with pytest.raises(Unreachable):
                await enrol(tmp_path / "ada", token, world=world)
        position = log.registry.position
        for node in studio.nodes:
            net.mend(NEWCOMER, node.address)
        profile = await enrol(tmp_path / "ada", token, world=world)
        card = log.registry.roll.card_of("user:ada")
        assert card is not None and card == Card.read(profile.user_certificate())
        assert log.registry.position == position, "nothing was issued anew"
        with pytest.raises(Refused, match="used already"):
            await enrol(tmp_path / "eve", token, world=world)

    simulate(seed, BAD, 3, play)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_node_finds_the_cluster_by_broadcast_and_becomes_a_member(seed: int, tmp_path: Path) -> None:
    async def play(studio: Studio) -> None:
        token = await studio.invite(ANY_NODE)
        await studio.all_know(studio.of(0).cluster_log.registry.position)
        profile = await enrol(tmp_path / "node", token, node_id_of(COMING), world=studio.net.world(NEWCOMER))
        assert set(profile.seeds) & {node.address for node in studio.nodes}
        coming = await studio.start_newcomer(profile, COMING)
        assert coming.context is not None
        await coming.context.joined.wait()
        await until(lambda: coming.context is not None and coming.context.line.arc is not None)
        for number in range(3):
            assert studio.of(number).cluster_log.registry.stands(node_id_of(COMING))
        studio.net.crash(COMING)
        assert coming.scope is not None
        coming.scope.cancel()

    simulate(seed, BAD, 3, play)


async def table_of(links: Links, address: str) -> ScenefoldError | None:
    """What keeps a node from answering; None if nothing does."""
    try:
        assert isinstance(await links.request(address, Priority.HIGH, RequestTable(), 10.0), RespondTable)
    except (Refused, Unreachable) as problem:
        return problem
    return None


@pytest.mark.parametrize("seed", SEEDS)
def test_certificates_are_renewed_before_they_run_out_though_the_trusted_node_was_away(seed: int) -> None:
    async def play(studio: Studio) -> None:
        old = [Card.read(node.certificate) for node in studio.nodes]
        await until(lambda: all(node.kept for node in studio.nodes[1:]))
        newer = [Card.read(node.kept[-1]) for node in studio.nodes[1:]]
        for before, after in zip(old[1:], newer, strict=True):
            assert (after.name, after.keys, after.tls_key) == (before.name, before.keys, before.tls_key)
            assert after.not_after > before.not_after + 200 * DAY
        await studio.all_know(studio.of(0).cluster_log.registry.position)
        for number in range(3):
            roll = studio.of(number).cluster_log.registry.roll
            assert [roll.cards[card.name] for card in newer] == newer
        # When the old ones have run out, nodes go on without a restart, for they show the newer ones.
        for node in studio.nodes:
            studio.net.machine(node.address).clock.step_wall((old[0].not_after - old[0].not_before).total_seconds() / 3)
        for one in studio.nodes:
            for other in studio.nodes:
                studio.net.reset(one.address, other.address)
        await trio.sleep(30.0)
        assert all(studio.of(number).lease.holds() for number in range(3))

    async def begin_without_the_voter() -> None:
        async with trio.open_nursery() as nursery:
            studio = Studio(SimNet(seed), 3, nursery, age=300 * DAY)
            await studio.start(1, 2)
            await trio.sleep(100.0)
            assert not any(node.kept for node in studio.nodes)
            await studio.start(0)
            await studio.joined()
            await play(studio)
            for number in range(3):
                studio.stop(number)
            nursery.cancel_scope.cancel()

    run_simulated(seed, begin_without_the_voter, virtual_s_max=1e5, wall_s_max=100)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_certificate_that_ran_out_opens_no_connection(seed: int) -> None:
    async def play(studio: Studio) -> None:
        world = studio.net.world("user:owner", certificate=studio.certified("user:owner", admin=True).certificate)
        async with open_links(world) as links:
            assert await table_of(links, "10.0.0.1") is None
        studio.net.machine("user:owner").clock.step_wall(400 * DAY.total_seconds())
        async with open_links(world) as links:
            problem = await table_of(links, "10.0.0.1")
        assert isinstance(problem, Unreachable) and "certificate has expired" in str(problem)

    simulate(seed, Weather(), 1, play)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_revocation_reaches_every_node_once_a_partition_ends(seed: int, tmp_path: Path) -> None:
    async def play(studio: Studio) -> None:
        net, log = studio.net, studio.of(0).cluster_log
        token = await studio.invite("user:ada", ("10.0.0.1",))
        profile = await enrol(tmp_path / "ada", token, world=net.world(NEWCOMER))
        await studio.all_know(log.registry.position)
        card = Card.read(profile.user_certificate())
        addresses = [node.address for node in studio.nodes]
        async with open_links(net.world("user:ada", certificate=profile.user_certificate())) as links:
            assert [await table_of(links, address) for address in addresses] == [None] * 4
            parted = net.partition(addresses[:2], addresses[2:])
            await log.propose(RevokeUser("user:ada", card.signing_id))
            await studio.of(1).cluster_log.changed_after(log.registry.position - 1)
            await trio.sleep(5.0)
            for address, is_told in zip(addresses, (True, True, False, False), strict=True):
                problem = await table_of(links, address)
                assert (problem is not None) == is_told, address
            net.unite(parted)
            await studio.all_know(log.registry.position)
            await trio.sleep(5.0)
            for address in addresses:
                problem = await table_of(links, address)
                assert isinstance(problem, Refused) and problem.reason is RejectReason.KEY_REVOKED, address
        back = await studio.invite("user:bob", ("10.0.0.4",))
        assert (await enrol(tmp_path / "bob", back, world=net.world("another"))).user == "bob"

    simulate(seed, Weather(), 4, play)
