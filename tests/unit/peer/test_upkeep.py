"""If this fails, anybody can stop a node's repair, a pause is forgotten at a restart, or nobody is told of it."""

from __future__ import annotations

from typing import Any, cast

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import Handlers
from scenefold.peer.line.budget import Budget
from scenefold.peer.line.resting import Resting
from scenefold.peer.scrub import Pace, Scrub
from scenefold.peer.upkeep import NOTE, Orders, OwnUpkeep, decode_orders, encode_orders
from scenefold.wire import ChangeUpkeep, UpkeepChanged, pack_value
from scenefold.wire.upkeep_packets import ALL_DUTIES, BALANCE, REPAIR, SCRUB
from unit.peer.logs_made import folded, found, node
from unit.peer.scrub.test_scrub import TrioTime
from unit.peer.test_blacklist import ADMINISTRATOR, Notes

TRANSFER, SPEED = 1_000_000, 50_000


class House:
    """One life of a node."""

    def __init__(self, notes: Notes) -> None:
        self.resting = Resting()
        self.budget = Budget(TrioTime(), TRANSFER)
        self.scrub = Scrub(TrioTime(), cast(Any, notes), Pace(30.0, SPEED))
        self.upkeep = OwnUpkeep(notes, self.resting, self.budget, self.scrub, may_order=lambda user: user == ADMINISTRATOR)
        registry = folded(found(1))
        self.handlers = Handlers(lambda: registry, lambda: None, lambda _mini: None)
        self.upkeep.register(self.handlers)

    async def tell(self, user: str = ADMINISTRATOR, **order: Any) -> UpkeepChanged:
        reply = await self.handlers.handle(ChangeUpkeep(**order), user)
        assert isinstance(reply, UpkeepChanged)
        return reply

    @property
    def rests(self) -> tuple[bool, bool, bool]:
        return self.resting.repair, self.scrub.is_paused, self.resting.balance


async def started(notes: Notes) -> House:
    house = House(notes)
    await house.upkeep.load()
    return house


async def test_a_node_that_was_told_nothing_rests_from_nothing() -> None:
    house = await started(Notes())
    assert house.rests == (False, False, False)
    assert house.upkeep.document() == {"paused": [], "transfer_bytes_per_s": TRANSFER, "scrub_bytes_per_s": SPEED}


async def test_what_is_paused_stays_so_over_a_restart_until_it_is_resumed() -> None:
    notes = Notes()
    assert await (await started(notes)).tell(of=REPAIR, paused=REPAIR) == UpkeepChanged(REPAIR, TRANSFER, SPEED)
    house = await started(notes)
    assert house.rests == (True, False, False)
    await house.tell(of=SCRUB, paused=SCRUB)
    await house.tell(of=BALANCE, paused=BALANCE)
    assert house.rests == (True, True, True)
    assert house.upkeep.document()["paused"] == ["repair", "scrub", "balance"]
    await house.tell(of=REPAIR | BALANCE, paused=BALANCE)
    assert house.rests == (await started(notes)).rests == (False, True, True)


async def test_rates_count_at_once_and_over_a_restart_and_0_is_what_it_was_started_with() -> None:
    notes = Notes()
    house = await started(notes)
    assert await house.tell(transfer_bytes_per_s=10) == UpkeepChanged(0, 10, SPEED)
    assert await house.tell(scrub_bytes_per_s=20) == UpkeepChanged(0, 10, 20)
    house = await started(notes)
    assert (house.budget.bytes_per_s, house.scrub.bytes_per_s_max) == (10, 20)
    assert await house.tell(transfer_bytes_per_s=0, scrub_bytes_per_s=0) == UpkeepChanged(0, TRANSFER, SPEED)
    assert decode_orders(notes.kept[NOTE]) == Orders()


async def test_only_administrators_change_anything_and_every_user_may_look() -> None:
    notes = Notes()
    house = await started(notes)
    for order in ({"of": REPAIR, "paused": REPAIR}, {"transfer_bytes_per_s": 7}, {"scrub_bytes_per_s": 7}):
        with pytest.raises(Refused, match="user:eve is no administrator") as refused:
            await house.tell("user:eve", **order)
        assert refused.value.reason is RejectReason.NOT_AUTHORISED
    assert await house.tell("user:eve") == UpkeepChanged(0, TRANSFER, SPEED)
    with pytest.raises(Refused):
        await house.tell(f"node:{node(0)}")
    assert (house.rests, notes.writes) == ((False, False, False), 0)


async def test_a_full_disk_changes_nothing() -> None:
    notes = Notes()
    house = await started(notes)
    notes.is_full = True
    with pytest.raises(Refused, match="full"):
        await house.tell(of=ALL_DUTIES, paused=ALL_DUTIES)
    assert house.rests == (False, False, False) and house.upkeep.document()["paused"] == []


async def test_two_orders_at_once_are_both_carried_out() -> None:
    notes = Notes()
    house = await started(notes)
    async with trio.open_nursery() as nursery:
        for duty in (REPAIR, BALANCE):
            nursery.start_soon(lambda bit: house.tell(of=bit, paused=bit), duty)
    assert house.rests == (await started(notes)).rests == (True, False, True)


DUTIES = st.integers(0, ALL_DUTIES)
RATES = st.none() | st.integers(0, (1 << 63) - 1)


@given(st.lists(st.builds(ChangeUpkeep, of=DUTIES, paused=DUTIES, transfer_bytes_per_s=RATES, scrub_bytes_per_s=RATES), max_size=6))
def test_of_each_duty_and_rate_the_last_word_counts(orders: list[ChangeUpkeep]) -> None:
    found = Orders()
    for order in orders:
        found = found.changed(order)
    assert decode_orders(encode_orders(found)) == found
    for bit in (REPAIR, SCRUB, BALANCE):
        words = [bool(order.paused & bit) for order in orders if order.of & bit]
        assert bool(found.paused & bit) == (words[-1] if words else False)
    for name in ("transfer", "scrub"):
        rates = [rate for rate in (getattr(order, f"{name}_bytes_per_s") for order in orders) if rate is not None]
        assert getattr(found, name) == (rates[-1] if rates else 0)


@pytest.mark.parametrize(
    "note",
    [
        b"",
        pack_value({"v": 2, "paused": 0, "transfer": 0, "scrub": 0}),
        pack_value({"v": 1, "paused": 8, "transfer": 0, "scrub": 0}),
        pack_value({"v": 1, "paused": True, "transfer": 0, "scrub": 0}),
        pack_value({"v": 1, "paused": 0, "transfer": -1, "scrub": 0}),
        pack_value({"v": 1, "paused": 0, "transfer": 0}),
    ],
)
async def test_a_damaged_note_is_no_order_to_go_on(note: bytes) -> None:
    notes = Notes()
    notes.kept[NOTE] = note
    with pytest.raises(DamagedData, match="upkeep"):
        await started(notes)
