"""If this fails, a client says of a space or a scene that it was refused, and it is there; or a change is made twice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, NotReached, Refused, Unreachable
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.limits import CLIENT_LOG_TRIES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.client.space import Space
from scenefold.wire import Packet, ProposeSceneLog, RejectSceneProposal, RespondTable
from scenefold.world import Priority
from scenefold.world.keyring import Keyring
from unit.client.fake_nodes import FakeNodes
from unit.client.test_spaces import BOX, scene_of, scenes_of

KEEPER = "127.0.0.2"
STEP = (1.0, 0.0, 0.0)
Offer = Callable[[str, ProposeSceneLog], Packet | None]


class Nodes(FakeNodes):
    """`offered`: what becomes of a proposal in place of what is usual; None is no answer."""

    offered: Offer | None = None
    count = 0

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, ProposeSceneLog) and self.offered is not None:
            self.count += 1
            answer = self.offered(address, packet)
            if answer is None:
                raise Unreachable("no answer in time", where=address)
            return answer
        return await super().request(address, priority, packet, timeout)

    def keeper_dies(self, address: str, packet: ProposeSceneLog) -> Packet:
        """It decides, and is gone before it answers; who relays says so."""
        if address == KEEPER and address not in self.away:
            self._propose(packet)
            self.away.add(address)
        if address == KEEPER:
            raise Unreachable("no answer", where=address)
        raise Refused(RejectReason.NOT_READY, "the node does not answer", where=address)


def no(packet: ProposeSceneLog, reason: RejectReason) -> Packet:
    return RejectSceneProposal(reason, NodeId(0))


async def hall_of(nodes: FakeNodes, folder: Path) -> tuple[Scene, Space]:
    scene = await scene_of(nodes, folder)
    return scene, await scene.create_space("hall", BOX)


async def where(hall: Space) -> float:
    return (await hall.info()).transform.offset[0]


async def test_a_keeper_that_dies_behind_its_decision_has_not_refused(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = Nodes()
    _, hall = await hall_of(nodes, tmp_path)
    nodes.offered = nodes.keeper_dies
    with pytest.raises(Unreachable, match=r"answer to a change was lost.*may have happened.*scene status kitchen [0-9a-f]{32}@3` tells"):
        await hall.translate(STEP)
    nodes.offered = None
    nodes.away.clear()
    assert await where(hall) == 1.0


async def test_a_keeper_that_comes_back_in_time_is_found_to_have_done_it(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = Nodes()
    _, hall = await hall_of(nodes, tmp_path)
    nodes.offered = nodes.keeper_dies

    async def restart() -> None:
        await trio.sleep(1.0)
        nodes.away.clear()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(restart)
        await hall.translate(STEP)
    assert (await where(hall), nodes.headers[hall._access.identity.scene].position) == (1.0, 3)


@pytest.mark.parametrize(
    "later",
    [
        lambda packet: no(packet, RejectReason.STORAGE_FULL),
        lambda packet: no(packet, RejectReason.NOT_READY),
        lambda packet: no(packet, RejectReason.BUSY),
        lambda packet: RespondTable(()),
        lambda packet: None,
    ],
    ids=["full", "not ready", "busy", "nonsense", "silence"],
)
async def test_what_is_answered_after_a_lost_offer_speaks_of_a_later_one(
    autojump_clock: MockClock, tmp_path: Path, later: Callable[[ProposeSceneLog], Packet | None]
) -> None:
    nodes = Nodes()
    _, hall = await hall_of(nodes, tmp_path)
    late: list[ProposeSceneLog] = []

    def offered(_address: str, packet: ProposeSceneLog) -> Packet | None:
        if len(late) == len(nodes.addresses):
            return later(packet)
        late.append(packet)
        return None

    nodes.offered = offered
    with pytest.raises(Unreachable, match="may have happened"):
        await hall.translate(STEP)
    assert nodes.count <= len(nodes.addresses) * CLIENT_LOG_TRIES_MAX
    nodes.offered = None
    nodes._propose(late[0])
    assert await where(hall) == 1.0


async def test_who_comes_back_when_the_log_has_forgotten_the_request_does_not_offer_it_again(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenefold.scene.log.book.LOG_REQUESTS_KEPT", 2)
    nodes = Nodes()
    scene, hall = await hall_of(nodes, tmp_path)
    lost = trio.Event()

    def once(_address: str, packet: ProposeSceneLog) -> Packet:
        nodes.offered = None
        nodes._propose(packet)
        lost.set()
        raise Refused(RejectReason.NOT_READY, "the relay lost the answer")

    async def others() -> None:
        await lost.wait()
        for name in ("attic", "cellar"):
            await scene.create_space(name, BOX)

    nodes.offered = once
    async with trio.open_nursery() as nursery:
        nursery.start_soon(others)
        with pytest.raises(Unreachable, match="may have happened"):
            await hall.translate(STEP)
    assert await where(hall) == 1.0


@pytest.mark.parametrize("reason", [RejectReason.NOT_READY, RejectReason.ILL_FORMED, RejectReason.TOO_LARGE_FOR_PACKET])
async def test_a_fault_may_come_from_behind_the_decision(autojump_clock: MockClock, tmp_path: Path, reason: RejectReason) -> None:
    nodes = Nodes()
    _, hall = await hall_of(nodes, tmp_path)

    def once(_address: str, packet: ProposeSceneLog) -> Packet:
        nodes.offered = None
        nodes._propose(packet)
        raise Refused(reason, "the relay understood nothing")

    nodes.offered = once
    await hall.translate(STEP)
    assert await where(hall) == 1.0


async def test_a_refusal_of_a_relay_is_none_while_the_keeper_is_thinking(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = Nodes()
    _, hall = await hall_of(nodes, tmp_path)
    plain = nodes.request

    async def request(address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, ProposeSceneLog):
            if address != KEEPER:
                return no(packet, RejectReason.STORAGE_FULL)
            nodes._propose(packet)
            await trio.sleep(timeout)
        return await plain(address, priority, packet, timeout)

    nodes.request = request  # type: ignore[method-assign]
    await hall.translate(STEP)
    assert (await where(hall), nodes.headers[hall._access.identity.scene].position) == (1.0, 3)


async def test_an_offer_whose_position_is_taken_is_in_doubt_no_more(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = Nodes()
    scene, _ = await hall_of(nodes, tmp_path)
    other = await scene_of(nodes, tmp_path)
    before = dict(nodes.headers), dict(nodes.logs)
    await other.create_space("attic", BOX)
    after = dict(nodes.headers), dict(nodes.logs)
    nodes.headers, nodes.logs = before

    def overtaken(_address: str, _packet: ProposeSceneLog) -> None:
        nodes.headers, nodes.logs = after

    nodes.offered = overtaken
    with pytest.raises(LocalFault, match="a space 'attic' already"):
        await scene.create_space("attic", BOX)
    nodes.offered = lambda _address, packet: no(packet, RejectReason.STORAGE_FULL)
    with pytest.raises(Refused, match="storage full"):
        await scene.create_space("cellar", BOX)


async def test_who_is_overtaken_every_time_is_told_that_nothing_went_in(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = Nodes()
    scene, _ = await hall_of(nodes, tmp_path)
    other = await scene_of(nodes, tmp_path)
    first, later = (dict(nodes.headers), dict(nodes.logs)), []
    for number in range(CLIENT_LOG_TRIES_MAX):
        await other.create_space(f"space {number}", BOX)
        later.append((dict(nodes.headers), dict(nodes.logs)))

    def overtaken(_address: str, packet: ProposeSceneLog) -> None:
        nodes.headers, nodes.logs = later[packet.public.position - 3]

    nodes.headers, nodes.logs = first
    nodes.offered = overtaken
    with pytest.raises(Refused, match="others change the scene"):
        await scene.create_space("attic", BOX)


@pytest.mark.parametrize("reason", [RejectReason.STORAGE_FULL, RejectReason.NOT_AUTHORISED, RejectReason.BUSY])
async def test_without_a_lost_answer_a_refusal_is_one(autojump_clock: MockClock, tmp_path: Path, reason: RejectReason) -> None:
    nodes = Nodes()
    _, hall = await hall_of(nodes, tmp_path)
    nodes.offered = lambda _address, packet: no(packet, reason)
    with pytest.raises(Refused) as refused:
        await hall.translate(STEP)
    assert refused.value.reason is reason


async def test_the_keys_of_a_scene_that_may_be_there_are_kept(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = Nodes()
    nodes.offered = nodes.keeper_dies
    with pytest.raises(Unreachable, match=r"creation of the scene was lost.*may have happened.*create it again"):
        await scenes_of(nodes, tmp_path).create("kitchen")
    nodes.offered = None
    nodes.away.clear()
    assert [scene.name for scene in await scenes_of(nodes, tmp_path).list()] == ["kitchen"]
    assert (await scenes_of(nodes, tmp_path).open("kitchen")).name == "kitchen"
    with pytest.raises(LocalFault, match="exists already"):
        await scenes_of(nodes, tmp_path).create("kitchen")


@pytest.mark.parametrize("was_sent", [False, True])
async def test_while_the_first_voter_is_away_no_scene_is_made_and_nobody_doubts_that(
    autojump_clock: MockClock, tmp_path: Path, was_sent: bool
) -> None:
    nodes, left = Nodes(), [was_sent]

    def away(address: str, packet: ProposeSceneLog) -> Packet:
        if address == KEEPER and left.pop() if left else False:
            raise Unreachable("no answer in time", where=address)
        if address == KEEPER:
            raise NotReached("Connection refused", where=address)
        return RejectSceneProposal(RejectReason.PEER_MISSED, node_id_of(KEEPER))

    nodes.offered = away
    began = autojump_clock.current_time()
    words = "may have happened.*first voter is away" if was_sent else "^no scene can be made while the cluster's first voter is away"
    with pytest.raises(Unreachable, match=words) as told:
        await scenes_of(nodes, tmp_path).create("kitchen")
    assert (told.value.where == KEEPER) is not was_sent and autojump_clock.current_time() - began < 15.0
    nodes.offered = None
    assert (await scenes_of(nodes, tmp_path).create("kitchen")).name == "kitchen"


@pytest.mark.parametrize("comes_back", [True, False])
async def test_a_keeper_that_goes_before_anything_is_sent_to_it_is_waited_for_and_has_refused_nothing(
    autojump_clock: MockClock, tmp_path: Path, comes_back: bool
) -> None:
    """Who hands on says at once that nothing came to it; that is silence of the one that decides, and no refusal."""
    nodes = Nodes()
    scene, hall = await hall_of(nodes, tmp_path)
    offers = 0

    def away(address: str, packet: ProposeSceneLog) -> Packet:
        nonlocal offers
        offers += 1
        if comes_back and offers > 3:
            nodes.offered = None
            return nodes._propose(packet)
        if address == KEEPER:
            raise NotReached("Connection refused", where=address)
        return RejectSceneProposal(RejectReason.PEER_MISSED, node_id_of(KEEPER))

    nodes.offered = away
    if comes_back:
        await hall.translate(STEP)
        assert await where(hall) == 1.0
        return
    with pytest.raises(Unreachable, match=r"^the node that decides the scene's log does not answer: nothing was changed") as told:
        await hall.translate(STEP)
    assert told.value.where == f"scene {scene.name}, {KEEPER}" and told.value.remedy
    nodes.offered = None
    assert await where(hall) == 0.0


@pytest.mark.parametrize(
    ("reason", "kept"), [(RejectReason.BUSY, True), (RejectReason.NOT_READY, True), (RejectReason.STORAGE_FULL, False)]
)
async def test_the_keys_of_a_scene_that_cannot_be_are_not(
    autojump_clock: MockClock, tmp_path: Path, reason: RejectReason, kept: bool
) -> None:
    nodes = Nodes()
    nodes.offered = lambda _address, packet: no(packet, reason)
    with pytest.raises((Refused, Unreachable)):
        await scenes_of(nodes, tmp_path).create("kitchen")
    assert Keyring(tmp_path).names() == (["kitchen"] if kept else [])
    nodes.offered = None
    assert (await scenes_of(nodes, tmp_path).create("kitchen")).name == "kitchen"
