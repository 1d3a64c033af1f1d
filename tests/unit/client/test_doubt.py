"""If this fails, a client says of a record that it was refused, and the record is there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, node_id_of
from scenefold.base.limits import CLIENT_BUSY_TRIES_MAX, CLIENT_FRAME_RECORDS, CLIENT_FRAMES_PER_NODE
from scenefold.base.location import FIRST
from scenefold.base.reasons import RejectReason
from scenefold.client.delivery import deliver
from scenefold.client.doubt import Doubt
from scenefold.client.space import ABSENT
from scenefold.wire import Fault, Packet, PutItem, PutMany, PutManyReply, PutOutcome, RespondTable, SceneMode, SetMode
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene
from unit.client.test_spaces import scene_of

LASTING = [RejectReason.STORAGE_FULL, RejectReason.MODE_FORBIDS, RejectReason.KEY_REVOKED, RejectReason.NOT_AUTHORISED]
Put = Callable[[str, PutItem], PutOutcome]


def refusing(reason: int) -> Put:
    return lambda _address, item: PutOutcome(reason, item.location, NodeId(0))


class Faulty(FakeNodes):
    """Carry out writes, and answer the first `faults` of them with a Fault for the whole packet."""

    faults = 0
    reason = RejectReason.NOT_READY
    carries_out = True

    def _answer(self, address: str, packet: Packet) -> Packet:
        if self.faults and isinstance(packet, PutMany):
            self.faults -= 1
            if self.carries_out:
                super()._answer(address, packet)
            return Fault(self.reason, "not now")
        return super()._answer(address, packet)


@pytest.mark.parametrize("reason", LASTING)
async def test_no_refusal_is_believed_after_a_lost_answer(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch, reason: int) -> None:
    nodes = FakeNodes(lost_replies=0)
    space = _scene(nodes).space(FILES)
    await space.put(FIRST, b"before")
    with monkeypatch.context() as patched:
        nodes.lost_replies, nodes.ill_timed = 1, lambda: patched.setattr(nodes, "_put", refusing(reason))
        with pytest.raises(Unreachable, match="may have happened"):
            await space.put(FIRST, b"mine")
    assert await space.get(FIRST) == b"mine"


@pytest.mark.parametrize("reason", LASTING)
async def test_without_a_lost_answer_a_refusal_is_one(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch, reason: int) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    monkeypatch.setattr(nodes, "_put", refusing(reason))
    with pytest.raises(Refused, match=r"127\.0\.0\.2 refused the record") as refused:
        await space.put(FIRST, b"mine")
    assert refused.value.reason == reason


async def test_an_answer_that_was_found_again_ends_the_doubt(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = FakeNodes(addresses=("127.0.0.2",))
    space = _scene(nodes).space(FILES)
    await space.put(FIRST, b"before")
    put = nodes._put
    refuse = refusing(RejectReason.STORAGE_FULL)
    busy = {PLACES[1]}

    def choosy(address: str, item: PutItem) -> PutOutcome:
        """One place is busy once, and full then; so its neighbour has its answer before it is refused."""
        if item.location != PLACES[1]:
            return put(address, item)
        if item.location in busy:
            busy.remove(item.location)
            return PutOutcome(RejectReason.BUSY, item.location, NodeId(0))
        return refuse(address, item)

    nodes.lost_replies, nodes.ill_timed = 1, lambda: monkeypatch.setattr(nodes, "_put", choosy)
    with pytest.raises(Unreachable, match=PLACES[1].hex()):
        await space.put_many(ITEMS[:2])


async def test_doubt_outlives_a_new_signature(autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The exchange of one version for another happened, the scene went on, and the record that is signed anew meets the first one."""
    nodes = FakeNodes()
    scene, other = await scene_of(nodes, tmp_path), await scene_of(nodes, tmp_path)
    space = scene.space(10)
    digest = await space.put(FIRST, b"before", expect=ABSENT)
    put, revoked = nodes._put, iter([True])

    def once_revoked(address: str, item: PutItem) -> PutOutcome:
        return refusing(RejectReason.KEY_REVOKED)(address, item) if next(revoked, False) else put(address, item)

    await other.create_space("hall", ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
    nodes.lost_replies, nodes.ill_timed = 1, lambda: monkeypatch.setattr(nodes, "_put", once_revoked)
    with pytest.raises(Unreachable, match="may have happened"):
        await space.put(FIRST, b"exchanged", expect=digest)
    assert next(revoked, None) is None, "it was signed anew"
    assert await space.get(FIRST) == b"exchanged"


async def test_a_scene_that_is_frozen_meanwhile_refuses_nothing_that_is_there(autojump_clock: MockClock, tmp_path: Path) -> None:
    """What the client finds by itself, in the newer log, is no surer than what a node says."""
    nodes = FakeNodes()
    scene, other = await scene_of(nodes, tmp_path), await scene_of(nodes, tmp_path)
    await other.create_space("hall", ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), render_output=True)
    space = scene.space(10)
    assert await space.get(FIRST) is None
    header = dict(nodes.headers), dict(nodes.logs)
    await other.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    frozen = dict(nodes.headers), dict(nodes.logs)
    nodes.headers, nodes.logs = header

    def freeze() -> None:
        nodes.headers, nodes.logs = frozen

    nodes.lost_replies, nodes.ill_timed = 1, freeze
    with pytest.raises(Unreachable, match=r"may have happened.*render mode"):
        await space.put(FIRST, b"edit")
    assert (10, FIRST) in nodes.records


@pytest.mark.parametrize("reason", LASTING)
async def test_a_fault_of_the_whole_packet_leaves_doubt_too(
    autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch, reason: int
) -> None:
    nodes = Faulty(addresses=("127.0.0.2",))
    space = _scene(nodes).space(FILES)
    await space.put(FIRST, b"before")
    put, nodes.faults = nodes._put, 1

    def then_refuse(address: str, item: PutItem) -> PutOutcome:
        monkeypatch.setattr(nodes, "_put", refusing(reason))
        return put(address, item)

    with monkeypatch.context() as patched:
        patched.setattr(nodes, "_put", then_refuse)
        with pytest.raises(Unreachable, match="may have happened"):
            await space.put(FIRST, b"mine")
    assert await space.get(FIRST) == b"mine"


async def test_a_fault_that_says_busy_leaves_none(autojump_clock: MockClock) -> None:
    nodes = Faulty(addresses=("127.0.0.2",))
    space = _scene(nodes).space(FILES)
    await space.put(FIRST, b"before")
    nodes.faults, nodes.reason, nodes.carries_out = 1, RejectReason.BUSY, False
    with pytest.raises(Refused, match="there is a record already"):
        await space.put(FIRST, b"mine", expect=ABSENT)


async def test_faults_without_end_are_no_refusal(autojump_clock: MockClock) -> None:
    nodes = Faulty()
    space = _scene(nodes).space(FILES)
    nodes.faults = 1000
    with pytest.raises(Unreachable, match="may have happened"):
        await space.put(FIRST, b"mine")
    nodes.faults = 0
    assert await space.get(FIRST) == b"mine"


async def test_who_had_no_lease_when_the_write_came_leaves_no_doubt(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    nodes.without_lease = set(nodes.addresses)
    with pytest.raises(Refused, match=r"^127.0.0.[234] has no lease.*until the cluster.s voter answers.*records wait") as refused:
        await space.put_many(ITEMS)
    assert refused.value.reason is RejectReason.NOT_READY
    assert not nodes.records


async def test_where_too_few_that_may_hold_copies_are_there_it_is_tried_on_and_said_so(
    autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    put, missing, tries = nodes._put, node_id_of("127.0.0.9"), 0

    def short(address: str, item: PutItem) -> PutOutcome:
        nonlocal tries
        tries += 1
        return PutOutcome(RejectReason.TOO_FEW_COPIES, item.location, missing)

    with monkeypatch.context() as patched:
        patched.setattr(nodes, "_put", short)
        with pytest.raises(Refused, match=r"too few of the nodes that may hold copies answer, 127\.0\.0\.9 among") as refused:
            await space.put(FIRST, b"mine")
    assert refused.value.reason is RejectReason.NOT_READY, "others take it for what passes, as it was before"
    assert "lease" not in str(refused.value)
    assert "start the nodes that do not answer" in refused.value.remedy
    assert tries == CLIENT_BUSY_TRIES_MAX
    begun = iter([True, True])
    monkeypatch.setattr(nodes, "_put", lambda address, item: short(address, item) if next(begun, False) else put(address, item))
    await space.put(FIRST, b"mine", expect=ABSENT)
    assert await space.get(FIRST) == b"mine"


async def test_where_too_few_may_hold_copies_at_all_nobody_waits(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    monkeypatch.setattr(nodes, "_put", lambda address, item: PutOutcome(RejectReason.TOO_FEW_COPIES, item.location, node_id_of(address)))
    begin = trio.current_time()
    with pytest.raises(Refused) as refused:
        await space.put(FIRST, b"mine")
    assert (refused.value.reason, trio.current_time() - begin) == (RejectReason.TOO_FEW_COPIES, 0.0)


async def test_whose_lease_ends_in_the_midst_of_a_write_leaves_doubt_and_it_says_so(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(addresses=("127.0.0.2",))
    space = _scene(nodes).space(FILES)
    await space.put(FIRST, b"before")
    nodes.losing_lease = {"127.0.0.2"}
    with pytest.raises(Unreachable) as told:
        await space.put(FIRST, b"mine")
    assert "a write may have happened: 127.0.0.2 was not ready to say" in str(told.value)
    assert "a later try: 127.0.0.2 has no lease" in str(told.value)
    assert await space.get(FIRST, stale_ok=True) == b"mine"


async def test_new_records_are_looked_for_where_they_may_be(autojump_clock: MockClock) -> None:
    """Whoever wants free places looks himself at what lies in taken ones, so a lost answer is no doubt for him."""
    nodes = Faulty(addresses=("127.0.0.2",))
    space = _scene(nodes).space(FILES)
    nodes.faults = 1
    assert await space.put_fresh([(FIRST, b"atom")]) == [FIRST]
    assert len(nodes.records) == 1


class OneRefuses(FakeNodes):
    """The first node refuses every packet of writes for good, a second after the others have stored theirs."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, PutMany) and address == self.addresses[0]:
            await trio.sleep(1.0)
            raise Refused(RejectReason.NOT_AUTHORISED, "not you", where=address)
        reply = await super().request(address, priority, packet, timeout)
        if isinstance(packet, PutMany):
            await trio.sleep(2.0)
        return reply


async def test_what_is_cancelled_because_another_frame_failed_may_be_stored(autojump_clock: MockClock) -> None:
    nodes = OneRefuses()
    with pytest.raises(Unreachable, match=r"may have happened.*not you"):
        await _scene(nodes).space(FILES).put_many(ITEMS)
    assert nodes.records


async def test_what_has_not_left_is_not_in_doubt(autojump_clock: MockClock) -> None:
    """Frames that wait for their turn are no tries yet."""
    nodes = OneRefuses(addresses=("127.0.0.2",))
    at_once = CLIENT_FRAME_RECORDS * CLIENT_FRAMES_PER_NODE
    items = {number: PutItem(SceneId(9), FILES, FIRST, bytes(64), b"header", b"text") for number in range(5 * at_once)}
    doubt = Doubt("a write", str, "")
    with pytest.raises(Refused, match="not you"):
        await deliver(nodes.calls(), items, [FIRST] * len(items), doubt)
    # Those whose turn came when the first ones ended may be among them.
    assert sum(number in doubt for number in items) <= 2 * at_once


@pytest.mark.parametrize("wrong", [RespondTable(()), PutManyReply(())])
async def test_a_write_that_is_answered_with_nonsense_may_have_happened(autojump_clock: MockClock, wrong: Packet) -> None:
    nodes = FakeNodes()
    honest = nodes._answer

    def answer(address: str, packet: Packet) -> Packet:
        reply = honest(address, packet)
        return wrong if isinstance(packet, PutMany) else reply

    nodes._answer = answer  # type: ignore[method-assign]
    space = _scene(nodes).space(FILES)
    with pytest.raises(Unreachable, match="may have happened"):
        await space.put(FIRST, b"mine")
    assert await space.get(FIRST) == b"mine"
