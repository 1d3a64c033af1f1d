"""If this fails, a member whose access was revoked, and one node that helps, deceive or overhear those who had the scene open before."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, Refused, Unreachable
from scenefold.base.ids import SceneId, address_of
from scenefold.base.location import FIRST
from scenefold.base.reasons import RejectReason
from scenefold.client.known_log import LOOK_S
from scenefold.client.scene import Scene
from scenefold.client.sealing import Draft, Opened, SceneIdentity, open_all, seal_all
from scenefold.client.verifying import NewerThanKnown, WriterKey
from scenefold.crypto import NONCE_BYTES, RecordHeader, SigningKey
from scenefold.scene.layout import GEOMETRY
from scenefold.scene.log import EpochKeys
from scenefold.wire import Packet, PutMany, RecordBytes, RequestSceneLog, Role
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.test_grants import PLACES, Studio, card_of
from unit.client.test_old_headers import Liars

WRITER = SigningKey(bytes(31) + b"\1")
EPOCHS = st.integers(0, 2**64 - 1)


@given(position=EPOCHS, epoch=EPOCHS)
def test_no_record_is_believed_of_an_epoch_above_the_header_that_is_known(position: int, epoch: int) -> None:
    writers = {WRITER.key_id: WriterKey.always(WRITER.public)}
    signer = SceneIdentity(SceneId(9), bytes(32), epoch, writers, EpochKeys.only(bytes(24)))
    (item,) = seal_all(signer, WRITER, 1, [Draft(GEOMETRY, FIRST, b"late", None, 1, bytes(NONCE_BYTES))])
    reader, record = replace(signer, position=position), RecordBytes(item.signature, item.header, item.ciphertext)
    if epoch <= position:
        (found,) = open_all(reader, [(GEOMETRY, FIRST)], [record])
        assert isinstance(found, Opened) and found.payload == b"late"
    else:
        with pytest.raises(NewerThanKnown) as newer:
            open_all(reader, [(GEOMETRY, FIRST)], [record])
        assert (newer.value.epoch, newer.value.key_epoch) == (epoch, None)


class Kitchen:
    """A scene of the owner's; Ada and Ben have had it open as writers since before Ada's access is revoked."""

    def __init__(self, folder: Path) -> None:
        self.studio = Studio(folder)

    @property
    def nodes(self) -> FakeNodes:
        return self.studio.nodes

    async def open(self) -> None:
        self.owner = await self.studio.scenes(1).create("kitchen")
        await self.owner.grant(card_of(2), Role.WRITER)
        await self.owner.grant(card_of(3), Role.WRITER)
        self.ada, self.ben = await self.studio.kitchen(2), await self.studio.kitchen(3)

    @property
    def position(self) -> int:
        (header,) = self.nodes.headers.values()
        return header.position

    async def forge(self, epoch: int) -> None:
        """Ada signs once more, and the owner of the place takes it."""
        access = self.ada.access
        access.check_writer = lambda: None  # type: ignore[method-assign]
        access.log = None
        access.identity = replace(access.identity, position=epoch)
        self.nodes.helpers = {self.nodes.table.owner_of(PLACES[0]).address}
        await self.ada.space(GEOMETRY).put(PLACES[0], b"forged")

    def asked_for_headers(self) -> list[str]:
        return [address for address, packet in self.nodes.asked if isinstance(packet, RequestSceneLog)]

    def key_epochs(self) -> list[int]:
        return [RecordHeader.decode(item.header).key_epoch for item in self.nodes.records.values()]


@pytest.fixture
async def kitchen(tmp_path: Path) -> Kitchen:
    kitchen = Kitchen(tmp_path)
    await kitchen.open()
    return kitchen


@pytest.mark.parametrize("later", [0, 1, None])
@pytest.mark.parametrize("hidden", [False, True])
async def test_what_a_former_writer_dates_after_his_end_nobody_believes(
    autojump_clock: MockClock, kitchen: Kitchen, later: int | None, hidden: bool
) -> None:
    """`later`: so many positions after the revocation; None: the last that there is. `hidden`: no node shows the new header."""
    (before,) = kitchen.nodes.headers.values()
    await kitchen.owner.revoke("user:ada")
    await kitchen.forge(2**64 - 1 if later is None else kitchen.position + later)
    if hidden:
        Liars(kitchen.studio, dict.fromkeys(kitchen.nodes.addresses, before))
    with pytest.raises(DamagedData, match=r"no writer of the scene at position|the scene has not come to"):
        await kitchen.ben.space(GEOMETRY).get(PLACES[0])


async def test_what_is_written_after_the_reader_last_looked_is_read(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    await kitchen.owner.create_space("hall")
    await kitchen.owner.space(GEOMETRY).put(PLACES[0], b"of a later position")
    assert await kitchen.ben.space(GEOMETRY).get(PLACES[0]) == b"of a later position"
    assert kitchen.ben.access.identity.position == kitchen.position


@pytest.mark.parametrize("waits_s", [LOOK_S + 1, 8 * 3600])
async def test_a_minute_after_a_revocation_nothing_is_sealed_under_the_former_key(
    autojump_clock: MockClock, kitchen: Kitchen, waits_s: float
) -> None:
    await kitchen.owner.revoke("user:ada")
    # Whoever owns the places says nothing of the former key.
    kitchen.nodes.helpers = set(kitchen.nodes.addresses)
    await trio.sleep(waits_s)
    await kitchen.ben.space(GEOMETRY).put_many([(place, b"secret") for place in PLACES])
    assert set(kitchen.key_epochs()) == {1}
    with pytest.raises(Refused, match="not sealed to you"):
        await kitchen.ada.space(GEOMETRY).get(PLACES[0])


async def test_who_writes_all_the_time_hears_of_it_too(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    await kitchen.owner.revoke("user:ada")
    kitchen.nodes.helpers = set(kitchen.nodes.addresses)
    for number in range(int(LOOK_S) + 2):
        await kitchen.ben.space(GEOMETRY).put(PLACES[0], b"%d" % number)
        await trio.sleep(1)
    assert kitchen.key_epochs() == [1]


@pytest.mark.parametrize("honest", ["127.0.0.2", "127.0.0.3", "127.0.0.4"])
async def test_one_honest_node_of_those_that_are_asked_is_enough(autojump_clock: MockClock, kitchen: Kitchen, honest: str) -> None:
    (before,) = kitchen.nodes.headers.values()
    await kitchen.owner.revoke("user:ada")
    kitchen.nodes.helpers = set(kitchen.nodes.addresses)
    Liars(kitchen.studio, dict.fromkeys(set(kitchen.nodes.addresses) - {honest}, before))
    await trio.sleep(LOOK_S + 1)
    await kitchen.ben.space(GEOMETRY).put(PLACES[0], b"secret")
    assert kitchen.key_epochs() == [1]


async def test_the_node_that_decides_the_scene_is_among_those_that_are_asked(tmp_path: Path, autojump_clock: MockClock) -> None:
    kitchen = Kitchen(tmp_path)
    kitchen.studio.nodes = FakeNodes(tuple(f"127.0.0.{number}" for number in range(2, 42)))
    await kitchen.open()
    (header,) = kitchen.nodes.headers.values()
    for _ in range(10):
        kitchen.nodes.asked.clear()
        await trio.sleep(LOOK_S + 1)
        await kitchen.ben.space(GEOMETRY).put(PLACES[0], b"again")
        asked = kitchen.asked_for_headers()
        assert len(asked) == 3 and address_of(header.origin) in asked


async def test_who_was_revoked_is_told_before_anything_is_sent(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    await kitchen.owner.revoke("user:ada")
    await trio.sleep(LOOK_S + 1)
    kitchen.nodes.asked.clear()
    with pytest.raises(Refused, match="your access to this scene was revoked") as refused:
        await kitchen.ada.space(GEOMETRY).put(PLACES[0], b"late")
    assert refused.value.reason is RejectReason.KEY_REVOKED
    assert not any(isinstance(packet, PutMany) for _, packet in kitchen.nodes.asked)


async def test_nobody_is_asked_for_a_header_twice_a_minute_nor_for_reading(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    async def put(scene: Scene, number: int) -> None:
        await scene.space(GEOMETRY).put(PLACES[number], b"new")

    for make in (partial(kitchen.studio.kitchen, 3), partial(kitchen.studio.scenes(3).create, "hall")):
        scene = await make()
        kitchen.nodes.records.clear()
        kitchen.nodes.asked.clear()
        await put(scene, 0)
        assert not kitchen.asked_for_headers(), "it was just opened, or made"
        for look in (1, 2):
            await trio.sleep(LOOK_S + 1)
            await scene.space(GEOMETRY).get(PLACES[0])
            assert len(kitchen.asked_for_headers()) == 3 * (look - 1)
            async with trio.open_nursery() as nursery:
                for number in range(len(PLACES)):
                    nursery.start_soon(put, scene, number)
            for number in range(5):
                await put(scene, number)
            assert len(kitchen.asked_for_headers()) == 3 * look


async def test_a_node_that_decides_and_hangs_holds_a_write_up_for_a_moment_only(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    (header,) = kitchen.nodes.headers.values()
    honest, origin = kitchen.nodes.request, address_of(header.origin)

    async def request(address: str, priority: Priority, packet: object, timeout: float) -> object:
        if address == origin and isinstance(packet, RequestSceneLog):
            await trio.sleep(timeout)
        return await honest(address, priority, packet, timeout)  # type: ignore[arg-type]

    kitchen.nodes.request = request  # type: ignore[method-assign,assignment]
    await trio.sleep(LOOK_S + 1)
    write = partial(kitchen.ben.space(GEOMETRY).put, PLACES[0], b"soon")
    with trio.fail_after(1.0):
        await write()


async def _all_write(scene: Scene, ends: list[BaseException | None]) -> None:
    async def put(number: int) -> None:
        try:
            await scene.space(GEOMETRY).put(PLACES[number], b"new")
        except Unreachable as error:
            ends.append(error)
        else:
            ends.append(None)

    async with trio.open_nursery() as nursery:
        for number in range(len(PLACES)):
            nursery.start_soon(put, number)


async def test_who_waits_for_a_look_that_fails_fails_with_it_and_writes_nothing(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    await trio.sleep(LOOK_S + 1)
    kitchen.nodes.away = set(kitchen.nodes.addresses)
    kitchen.nodes.asked.clear()
    with pytest.raises(Unreachable):
        await kitchen.ben.space(GEOMETRY).put(PLACES[0], b"alone")
    alone, ends = len(kitchen.asked_for_headers()), list[BaseException | None]()
    assert len(kitchen.nodes.asked) == alone
    kitchen.nodes.asked.clear()
    await _all_write(kitchen.ben, ends)
    assert len(ends) == len(PLACES) and None not in ends
    assert len(kitchen.nodes.asked) == len(kitchen.asked_for_headers()) == alone, "they failed together, not one after the other"
    kitchen.nodes.away.clear()
    await _all_write(kitchen.ben, ends)
    assert ends[len(PLACES) :] == [None] * len(PLACES), "a look that failed is not remembered against later ones"


async def test_who_gives_up_while_he_looks_lets_those_who_wait_look_themselves(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    await trio.sleep(LOOK_S + 1)
    kitchen.nodes.hung = set(kitchen.nodes.addresses)
    ends = list[BaseException | None]()
    async with trio.open_nursery() as nursery:
        with trio.move_on_after(1) as given_up:
            nursery.start_soon(_after, 0.5, partial(_all_write, kitchen.ben, ends))
            await kitchen.ben.space(GEOMETRY).put(PLACES[0], b"given up")
        assert given_up.cancelled_caught
        kitchen.nodes.hung.clear()
    assert ends == [None] * len(PLACES)


async def _after(seconds: float, function: Callable[[], Awaitable[None]]) -> None:
    await trio.sleep(seconds)
    await function()


@pytest.mark.parametrize("wiped", [{"127.0.0.2"}, {"127.0.0.3"}, {"127.0.0.4"}, {"127.0.0.3", "127.0.0.4"}])
async def test_that_the_scene_is_unknown_is_no_look_at_it(autojump_clock: MockClock, kitchen: Kitchen, wiped: set[str]) -> None:
    """Who has lost the scene's header answers first; the others a moment too late to be waited for."""
    await kitchen.owner.revoke("user:ada")
    kitchen.nodes.helpers = set(kitchen.nodes.addresses)
    Liars(kitchen.studio, dict.fromkeys(wiped, None))
    as_before = kitchen.nodes.request

    async def request(address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, RequestSceneLog) and address not in wiped:
            await trio.sleep(1)
        return await as_before(address, priority, packet, timeout)

    kitchen.nodes.request = request  # type: ignore[method-assign]
    await trio.sleep(LOOK_S + 1)
    await kitchen.ben.space(GEOMETRY).put(PLACES[0], b"secret")
    assert kitchen.key_epochs() == [1]


async def test_nothing_is_written_while_nobody_knows_the_scene(autojump_clock: MockClock, kitchen: Kitchen) -> None:
    Liars(kitchen.studio, dict.fromkeys(kitchen.nodes.addresses, None))
    await trio.sleep(LOOK_S + 1)
    with pytest.raises(Refused, match="does not know the scene") as refused:
        await kitchen.ben.space(GEOMETRY).put(PLACES[0], b"secret")
    assert refused.value.reason is RejectReason.NOT_READY
    assert not kitchen.nodes.records
