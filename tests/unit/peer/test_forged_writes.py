"""If this fails, who forges records has a node verify them for nothing, or honest records pay for forged ones beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import pytest
import trio

from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.records import writes
from scenefold.peer.records.writes import FORGED_MAX, VERIFY_BATCH
from scenefold.wire import AcceptData, GetMany, GetManyReply, ProposeData, PutItem, PutMany, PutManyReply, RecordKey, RejectData
from scenefold.world.metering import FORGED_S, Bill
from unit.peer.data_nodes import LEFT, MIDDLE, RIGHT, SCENE, Neighbours, Node, arc, item, with_nodes
from unit.peer.scenes_made import SPACE, STRANGER, offered, sealed

ALL = arc(0, 10_000)
FORGED, CUT = RejectReason.SIGNATURE_INVALID, RejectReason.LIMIT_EXCEEDED


@dataclass
class Written:
    """What was said of a write, and what it has cost beside time."""

    reasons: Sequence[int] = ()
    paid_s: float = 0.0
    accused: int = 0

    def pay(self, seconds: float) -> None:
        self.paid_s += seconds

    def accuse(self) -> None:
        self.accused += 1

    @property
    def forged(self) -> float:
        """As how many forged records it was charged."""
        return self.paid_s / FORGED_S


async def write(node: Node, items: Sequence[PutItem], written: Written) -> None:
    bill = Bill(written.pay, None, 0.0, written.accuse)
    reply = await bill.metered(node.ask(PutMany(tuple(items))))
    bill.close()
    assert isinstance(reply, PutManyReply)
    written.reasons = [outcome.reason for outcome in reply.outcomes]


async def written(node: Node, items: Sequence[PutItem]) -> Written:
    """A write in a task of its own, as each request has one."""
    one = Written()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(write, node, items, one)
    return one


async def kept(node: Node, *numbers: int) -> list[bool]:
    keys = tuple(RecordKey(SPACE, Location.from_number(number)) for number in numbers)
    reply = await node.ask(GetMany(SCENE.scene, 1, keys))
    assert isinstance(reply, GetManyReply)
    return [record is not None for record in reply.records]


def forged(number: int) -> PutItem:
    return replace(item(number), signature=bytes(64))


def mixed(first: int, count: int, bad: int) -> list[PutItem]:
    """Records of neighbouring places, the first `bad` of them forged."""
    return [(forged if number < first + bad else item)(number) for number in range(first, first + count)]


def test_each_forged_record_is_charged_and_the_honest_ones_beside_it_are_stored() -> None:
    async def test(_: Neighbours, node: Node) -> None:
        one = await written(node, [item(1), forged(2), item(3), forged(4), forged(5)])
        assert one.reasons == [0, FORGED, 0, FORGED, FORGED]
        assert one.forged == pytest.approx(3) and one.accused
        assert await kept(node, 1, 2, 3, 4, 5) == [True, False, True, False, False]

    with_nodes(test, ALL)


@pytest.mark.parametrize(
    "bend",
    [
        lambda good: replace(good, header=good.header[:-1]),
        lambda good: replace(good, ciphertext=good.ciphertext[:-1] + b"?"),
        lambda good: replace(good, location=Location.from_number(9)),
    ],
    ids=["no header", "another ciphertext", "another place"],
)
def test_what_no_honest_program_sends_is_charged_whatever_is_wrong_with_it(bend: object) -> None:
    async def test(_: Neighbours, node: Node) -> None:
        assert callable(bend)
        one = await written(node, [bend(item(1))])
        assert one.reasons[0] in (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED)
        assert one.forged == pytest.approx(1) and one.accused

    with_nodes(test, ALL)


def test_a_record_offered_alone_is_charged_alike() -> None:
    async def test(_: Neighbours, node: Node) -> None:
        for offer, answer, count in ((item(1), AcceptData, 0), (forged(2), RejectData, 1)):
            one = Written()
            packet = ProposeData(offer.scene, offer.space, offer.location, offer.signature, offer.header, offer.ciphertext)
            async with trio.open_nursery() as nursery:
                nursery.start_soon(propose, node, packet, one, answer)
            assert one.forged == pytest.approx(count)

    async def propose(node: Node, packet: ProposeData, one: Written, answer: type) -> None:
        assert isinstance(await Bill(one.pay, None).metered(node.ask(packet)), answer)

    with_nodes(test, ALL)


def test_what_an_honest_program_may_be_refused_for_costs_nothing_and_cuts_nothing() -> None:
    def stranger(number: int) -> PutItem:
        return offered(sealed(SCENE, STRANGER, location=Location.from_number(number)))

    def early(number: int) -> PutItem:
        return offered(sealed(SCENE, location=Location.from_number(number), epoch=SCENE.position + 1))

    async def test(_: Neighbours, node: Node, _other: Node) -> None:
        many = FORGED_MAX + 1
        items = [*map(stranger, range(many)), *map(early, range(many, 2 * many)), *map(item, range(MIDDLE, MIDDLE + many)), item(999)]
        one = await written(node, items)
        reasons = (RejectReason.NOT_AUTHORISED, RejectReason.NOT_READY, RejectReason.NOT_MY_LOCATION)
        assert one.reasons == [reason for reason in reasons for _ in range(many)] + [0]
        assert one.paid_s == 0

    with_nodes(test, LEFT, RIGHT)


def test_after_too_many_forged_ones_the_rest_is_neither_looked_at_nor_stored_nor_charged(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at: list[int] = []
    verify_all = writes.verify_all

    def counted(claims: Sequence[object]) -> object:
        looked_at.append(len(claims))
        return verify_all(claims)  # type: ignore[arg-type]

    monkeypatch.setattr(writes, "verify_all", counted)

    async def test(_: Neighbours, node: Node) -> None:
        bad = FORGED_MAX + 1
        rest = [*map(item, range(1000, 1000 + VERIFY_BATCH)), *map(forged, range(2000, 2000 + VERIFY_BATCH)), item(3000)]
        one = await written(node, [*mixed(0, VERIFY_BATCH, bad), *rest])
        assert looked_at == [VERIFY_BATCH]
        assert one.reasons == [FORGED] * bad + [0] * (VERIFY_BATCH - bad) + [CUT] * len(rest)
        assert one.forged == pytest.approx(bad)
        assert await kept(node, bad - 1, bad, VERIFY_BATCH - 1, 1000, 3000) == [False, True, True, False, False]

    with_nodes(test, ALL)


def test_forged_records_of_all_parts_of_a_write_are_counted_together() -> None:
    async def test(_: Neighbours, node: Node) -> None:
        half = FORGED_MAX // 2 + 1
        parts = [*mixed(0, VERIFY_BATCH, half), *mixed(1000, VERIFY_BATCH, half), *mixed(2000, VERIFY_BATCH, half)]
        one = await written(node, parts)
        judged = [FORGED] * half + [0] * (VERIFY_BATCH - half)
        assert one.reasons == [*judged, *judged, *[CUT] * VERIFY_BATCH]
        assert one.forged == pytest.approx(2 * half)

    with_nodes(test, ALL)


def test_as_many_as_a_write_may_hold_cut_nothing() -> None:
    async def test(_: Neighbours, node: Node) -> None:
        one = await written(node, [*mixed(0, VERIFY_BATCH, FORGED_MAX), *mixed(1000, VERIFY_BATCH, 0), forged(2000)])
        honest = 2 * VERIFY_BATCH - FORGED_MAX
        assert one.reasons == [FORGED] * FORGED_MAX + [0] * honest + [FORGED]
        assert one.forged == pytest.approx(FORGED_MAX + 1)

    with_nodes(test, ALL)


def test_what_is_refused_unseen_says_why_even_after_the_cut() -> None:
    async def test(_: Neighbours, node: Node, _other: Node) -> None:
        others = item(MIDDLE + 1)
        unknown = replace(item(1), scene=SCENE.scene + 1)
        one = await written(node, [*mixed(0, VERIFY_BATCH, VERIFY_BATCH), item(5000), others, unknown])
        assert one.reasons[VERIFY_BATCH:] == [CUT, RejectReason.NOT_MY_LOCATION, RejectReason.UNKNOWN_SCENE_OR_SPACE]

    with_nodes(test, LEFT, RIGHT)


def test_other_writes_are_judged_and_charged_for_themselves_at_the_same_time_and_after() -> None:
    async def test(_: Neighbours, node: Node) -> None:
        forger, honest = Written(), Written()
        async with trio.open_nursery() as nursery:
            nursery.start_soon(write, node, mixed(0, 3 * VERIFY_BATCH, 3 * VERIFY_BATCH), forger)
            nursery.start_soon(write, node, mixed(1000, 2 * VERIFY_BATCH, 0), honest)
        assert honest.reasons == [0] * 2 * VERIFY_BATCH and honest.paid_s == 0
        assert forger.reasons == [FORGED] * VERIFY_BATCH + [CUT] * 2 * VERIFY_BATCH
        assert forger.forged == pytest.approx(VERIFY_BATCH)
        again = await written(node, mixed(2000, VERIFY_BATCH + 1, 1))
        assert again.reasons == [FORGED] + [0] * VERIFY_BATCH and again.forged == pytest.approx(1)

    with_nodes(test, ALL)


def test_who_hangs_up_pays_for_what_was_found_forged_until_then(monkeypatch: pytest.MonkeyPatch) -> None:
    verify_all = writes.verify_all
    hung_up = trio.CancelScope()

    def last(claims: Sequence[object]) -> object:
        hung_up.cancel()
        return verify_all(claims)  # type: ignore[arg-type]

    monkeypatch.setattr(writes, "verify_all", last)

    async def test(_: Neighbours, node: Node) -> None:
        one = Written()
        with hung_up:
            await write(node, mixed(0, 2 * VERIFY_BATCH, FORGED_MAX), one)
        assert not one.reasons and one.forged == pytest.approx(FORGED_MAX)

    with_nodes(test, ALL)
