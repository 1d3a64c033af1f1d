"""If this fails, a node asks, and believes, whoever sits at a member's address with keys that count no longer."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
import trio
import trio.testing

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import KeyId, NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Propose, Value
from scenefold.consensus.packets import packet_of
from scenefold.wire import Ballot, ListScenes, Phase, ProposalId
from scenefold.world import Priority, open_links
from scenefold.world.outbox import PIECE_BYTES
from scenefold.world.ports import Connection

ADDRESS = "127.0.0.9"
OLD, NEW = KeyId(1), KeyId(2)


@dataclass(eq=False)
class Answering:
    """A peer that answers every packet with itself, until it is closed."""

    peer_key: KeyId
    peer: str = "node:2130706441"
    version: int = 1
    heard: list[bytes] = field(default_factory=list)
    closed: trio.Event = field(default_factory=trio.Event)

    def __post_init__(self) -> None:
        self._send, self._receive = trio.open_memory_channel[bytes](10)

    async def send(self, data: bytes | memoryview) -> None:
        self.heard.append(bytes(data))
        await self._send.send(bytes(data))

    async def receive(self, _count_max: int) -> bytes:
        try:
            return await self._receive.receive()
        except trio.EndOfChannel:
            return b""

    async def aclose(self) -> None:
        self.closed.set()
        await self._send.aclose()


class World:
    """A network with one node, whose keys the test chooses."""

    def __init__(self, key: KeyId) -> None:
        self.key = key
        self.network = self
        self.opened: list[Answering] = []

    async def connect(self, _address: str, _priority: Priority) -> Answering:
        await trio.lowlevel.checkpoint()
        self.opened.append(Answering(self.key))
        return self.opened[-1]


def under_old_keys(connection: Connection) -> Refused | None:
    return Refused(RejectReason.KEY_REVOKED, "the key of node:2130706441 is revoked") if connection.peer_key == OLD else None


async def test_who_answers_under_a_key_that_counts_no_longer_is_asked_nothing() -> None:
    world = World(OLD)
    async with open_links(world) as links:  # type: ignore[arg-type]
        links.refusal_of = under_old_keys
        with pytest.raises(Unreachable, match="is revoked"):
            await links.request(ADDRESS, Priority.HIGH, ListScenes(), 5)
        assert world.opened[0].closed.is_set() and world.opened[0].heard == []
        world.key = NEW
        assert isinstance(await links.request(ADDRESS, Priority.HIGH, ListScenes(), 5), ListScenes)


async def test_a_channel_ends_once_its_peers_key_counts_no_longer() -> None:
    world = World(OLD)
    async with open_links(world) as links:  # type: ignore[arg-type]
        await links.request(ADDRESS, Priority.HIGH, ListScenes(), 5)
        links.check_again()
        await links.request(ADDRESS, Priority.HIGH, ListScenes(), 5)
        assert len(world.opened) == 1 and not world.opened[0].closed.is_set(), "nothing has changed"
        links.refusal_of = under_old_keys
        links.check_again()
        await world.opened[0].closed.wait()
        with pytest.raises(Unreachable, match="is revoked"):
            await links.request(ADDRESS, Priority.HIGH, ListScenes(), 5)


class Slow(Answering):
    """It takes a piece a second, and answers nothing."""

    stalls = False

    async def send(self, data: bytes | memoryview) -> None:
        await trio.sleep(float("inf") if self.stalls and self.heard else 1.0)
        self.heard.append(bytes(data))


@pytest.mark.parametrize("stalls", [False, True])
@pytest.mark.parametrize("while_it_moves", [False, True])
async def test_what_waits_behind_something_large_is_not_lost_while_that_leaves(
    while_it_moves: bool, stalls: bool, autojump_clock: trio.testing.MockClock
) -> None:
    """Else whoever is on a slow link counts as gone whenever something large is sent to it."""
    world = World(NEW)
    slow = Slow(NEW)
    slow.stalls = stalls

    async def connect(_address: str, _priority: Priority) -> Slow:
        return slow

    world.connect = connect  # type: ignore[method-assign, assignment]
    large = packet_of(
        Propose(bytes(32), ProposalId(1, Ballot(1, NodeId(1)), Phase.ACCEPT), (), (), value=Value(b"data", bytes(7 * PIECE_BYTES)))
    )
    async with open_links(world) as links:  # type: ignore[arg-type]
        await links.send(ADDRESS, Priority.HIGH, large, 2.0, while_it_moves=while_it_moves)
        began = trio.current_time()
        if while_it_moves and not stalls:
            await links.send(ADDRESS, Priority.HIGH, ListScenes(), 2.0, while_it_moves=True)
            assert trio.current_time() - began >= 6.0
        else:
            with pytest.raises(Unreachable, match="within 2 s"):
                await links.send(ADDRESS, Priority.HIGH, ListScenes(), 2.0, while_it_moves=while_it_moves)
            assert trio.current_time() - began <= 4.0
