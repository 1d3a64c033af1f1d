"""If this fails, one silent node holds up the view of all others, or disappears from it with all that it said."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.location import LAST
from scenefold.base.prefixes import address_prefix
from scenefold.client.cluster import Cluster
from scenefold.client.moving import rates
from scenefold.client.watching import Watch
from scenefold.crypto import SigningKey
from scenefold.simulation.clients import secrets_of
from scenefold.wire import NodeReport, Packet, RequestReport, RequestTable, RespondTable, Status, pack_value
from scenefold.world import Priority
from unit.client.fake_nodes import make_world
from unit.client.test_health import report

ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")


@dataclass
class Street:
    """The `Links` to nodes that report; those that hang take every request and answer none."""

    hung: set[str] = field(default_factory=set)
    records: int = 10

    def watch(self) -> Watch:
        members = [SimpleNamespace(node_id=node_id_of(address), address=address) for address in ADDRESSES]
        ids = [member.node_id for member in members]
        profile: Any = SimpleNamespace(
            members=members,
            founders=ids,
            voters=ids[:1],
            voter=SimpleNamespace(node_id=ids[0], public_key=SigningKey(bytes(32)).public),
            name="studio",
            cluster_id=bytes(32),
            keyring=None,
            user="owner",
            folder=Path(),
            genesis_header=None,
            seeds=(),
            log_key=None,
        )
        links: Any = self
        return Watch(Cluster(profile, make_world(), links, secrets_of(SigningKey(bytes(32)))))

    def check_again(self) -> None:
        raise AssertionError("nothing was learnt of the log")

    async def request(self, address: str, _priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address in self.hung:
            await trio.sleep(timeout)
            raise Unreachable("timed out", where=address)
        if isinstance(packet, RequestTable):
            bounds = [LAST if other == ADDRESSES[-1] else None for other in ADDRESSES]
            known = zip(ADDRESSES, bounds, strict=True)
            return RespondTable(
                tuple(
                    Status(
                        1,
                        node_id_of(other),
                        b"i" * 16,
                        1,
                        other,
                        None,
                        bound,
                        blacklist=(address_prefix(ADDRESSES[1]),),
                        blacklist_version=3,
                    )
                    for other, bound in known
                )
            )
        assert isinstance(packet, RequestReport)
        said = report(address, None, records=self.records, bytes=100 * self.records, blacklist=["127.0.0.9"], blacklist_version=4)
        return NodeReport(pack_value(dict(said.document)))


@pytest.mark.parametrize("silent", ADDRESSES)
async def test_a_silent_node_delays_no_look(autojump_clock: MockClock, silent: str) -> None:
    street = Street()
    watch = street.watch()
    first = await watch.look()
    assert [node.alive for node in first.nodes] == [True] * 3
    street.hung.add(silent)
    before = first
    for second in range(1, 5):
        begun = trio.current_time()
        await trio.sleep(0.2)
        street.records += 5
        found = await watch.look()
        assert trio.current_time() - begun <= 1.0
        assert [node.address for node in found.nodes if not node.alive] == [silent]
        assert "missing" in [warning.kind for warning in found.warnings if warning.address == silent]
        for rate in rates(before.nodes, found.nodes, 1.0):
            document = rate.document()
            if rate.node.address == silent:
                assert (document["records"], document["records_per_second"], document["lease_s"]) == (10, None, None)
                assert document["said_s"] == pytest.approx(second)
            else:
                assert (document["records"], document["said_s"]) == (street.records, 0)
        before = found
    street.hung.clear()
    assert [node.alive for node in (await watch.look()).nodes] == [True] * 3


async def test_who_was_silent_from_the_start_said_nothing(autojump_clock: MockClock) -> None:
    street = Street(hung={ADDRESSES[0], ADDRESSES[2]})
    begun = trio.current_time()
    found = await street.watch().look()
    assert trio.current_time() - begun < 2
    assert [(node.alive, node.last) for node in found.nodes] == [(False, None), (True, found.nodes[1].last), (False, None)]
    assert rates([], found.nodes, 1.0)[0].document()["said_s"] is None


async def test_a_cluster_that_falls_silent_as_a_whole_is_still_shown(autojump_clock: MockClock) -> None:
    street = Street()
    watch = street.watch()
    await watch.look()
    street.hung.update(ADDRESSES)
    found = await watch.look()
    assert not any(node.alive for node in found.nodes) and found.degraded
    assert all(node.last is not None and node.last.records == 10 for node in found.nodes)


async def test_nothing_can_be_shown_of_a_cluster_that_never_answered(autojump_clock: MockClock) -> None:
    with pytest.raises(Unreachable, match="no node of the cluster answers"):
        await Street(hung=set(ADDRESSES)).watch().look()


async def test_a_blacklist_is_shown_by_a_nodes_own_word_or_as_it_was_told(autojump_clock: MockClock) -> None:
    found = await Street(hung={ADDRESSES[2]}).watch().look()
    shown = [node.document()["blacklist"] for node in found.nodes]
    assert shown == [["127.0.0.9"], ["127.0.0.9"], [ADDRESSES[1]]]
    assert [node.document()["blacklist_version"] for node in found.nodes] == [4, 4, 3]
