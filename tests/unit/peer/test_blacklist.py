"""If this fails, a node forgets whom it wants no copies on, lets anybody say so, or two administrators undo each other's work."""

from __future__ import annotations

from typing import Any

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, Refused, UsageFault
from scenefold.base.ids import address_of
from scenefold.base.limits import BLACKLIST_MAX
from scenefold.base.prefixes import AddressPrefix, Blacklist, address_prefix
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import Handlers
from scenefold.peer.membership.blacklist import OwnBlacklist, changed, decode_blacklist, encode_blacklist
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import BlacklistChanged, ChangeBlacklist, pack_value
from unit.peer.logs_made import folded, found, node, secrets_of

ME = node(0)
ADMINISTRATOR = "user:ada"
RACK, HOST, OTHER = map(address_prefix, ("10.1.2.0/24", "10.9.9.9", "10.9.9.8"))


class Notes:
    """A disk of notes, which takes its time."""

    def __init__(self) -> None:
        self.kept: dict[str, bytes] = {}
        self.writes = 0
        self.is_full = False

    async def get_note(self, name: str) -> bytes | None:
        return self.kept.get(name)

    async def put_note(self, name: str, value: bytes) -> None:
        await trio.lowlevel.checkpoint()
        if self.is_full:
            raise Refused(RejectReason.STORAGE_FULL, "the disk is full")
        self.kept[name] = value
        self.writes += 1


class House:
    """One life of a node."""

    def __init__(self, notes: Notes, *settings: AddressPrefix) -> None:
        self.own = OwnStatus(ME, address_of(ME), bytes(16), 1, secrets_of(0))
        self.blacklist = OwnBlacklist(notes, self.own, settings, may_order=lambda user: user == ADMINISTRATOR)
        registry = folded(found(1))
        self.handlers = Handlers(lambda: registry, self.own.mini, lambda _mini: None)
        self.blacklist.register(self.handlers)

    async def tell(self, user: str = ADMINISTRATOR, **order: Any) -> Blacklist:
        reply = await self.handlers.handle(ChangeBlacklist(**order), user)
        assert isinstance(reply, BlacklistChanged)
        return Blacklist(reply.version, reply.prefixes)


async def started(notes: Notes, *settings: AddressPrefix) -> House:
    house = House(notes, *settings)
    await house.blacklist.load()
    return house


async def test_what_is_ordered_is_durable_and_in_the_status() -> None:
    notes = Notes()
    house = await started(notes)
    assert house.own.blacklist == Blacklist(0, ()) and notes.writes == 0
    assert await house.tell(add=(RACK, HOST)) == Blacklist(1, (RACK, HOST))
    assert await house.tell(add=(OTHER,), remove=(HOST,)) == Blacklist(2, (RACK, OTHER))
    status = house.own.signed()
    assert (status.blacklist, status.blacklist_version) == ((RACK, OTHER), 2)
    assert (await started(notes)).own.blacklist == Blacklist(2, (RACK, OTHER))


async def test_what_changes_nothing_has_no_new_version_and_costs_no_write() -> None:
    notes = Notes()
    house = await started(notes)
    await house.tell(add=(RACK,))
    assert await house.tell(add=(RACK,)) == await house.tell() == Blacklist(1, (RACK,))
    assert notes.writes == 1


async def test_settings_are_added_at_each_start_and_take_nothing_off() -> None:
    notes = Notes()
    assert (await started(notes, HOST)).own.blacklist == Blacklist(1, (HOST,))
    house = await started(notes, HOST, RACK)
    assert house.own.blacklist == Blacklist(2, (RACK, HOST))
    assert (await started(notes)).own.blacklist == Blacklist(2, (RACK, HOST))
    await house.tell(remove=(HOST,))
    assert (await started(notes, HOST)).own.blacklist == Blacklist(4, (RACK, HOST)), "it was started so again"


async def test_settings_that_all_nodes_share_may_name_the_node_itself() -> None:
    assert (await started(Notes(), AddressPrefix(ME, 32), HOST)).own.blacklist.prefixes == (HOST,)


async def test_a_node_whose_settings_add_too_much_does_not_start() -> None:
    notes = Notes()
    await started(notes, *(AddressPrefix(number, 32) for number in range(BLACKLIST_MAX)))
    with pytest.raises(UsageFault, match=f"a blacklist of {BLACKLIST_MAX + 1} entries: {BLACKLIST_MAX} stand there"):
        await started(notes, HOST)
    assert notes.writes == 1


@pytest.mark.parametrize("order", [{"add": (RACK,)}, {"remove": (HOST,)}])
async def test_only_administrators_change_anything_and_every_user_may_look(order: dict[str, Any]) -> None:
    notes = Notes()
    house = await started(notes, HOST)
    with pytest.raises(Refused, match="user:eve is no administrator") as refused:
        await house.tell("user:eve", **order)
    assert refused.value.reason is RejectReason.NOT_AUTHORISED
    assert await house.tell("user:eve") == house.own.blacklist == Blacklist(1, (HOST,))
    with pytest.raises(Refused):
        await house.tell(f"node:{node(0)}")


@pytest.mark.parametrize(
    ("order", "reason", "words"),
    [
        ({"remove": (RACK, OTHER)}, RejectReason.OUTSIDE_BOUNDS, f"10.1.2.0/24, 10.9.9.8: not on the blacklist of {address_of(ME)}"),
        ({"add": (AddressPrefix(ME, 32),)}, RejectReason.OUTSIDE_BOUNDS, "own address, which is on its blacklist always"),
        ({"add": tuple(AddressPrefix(n, 32) for n in range(BLACKLIST_MAX))}, RejectReason.OUTSIDE_BOUNDS, "a blacklist of 33 entries"),
        ({"add": (RACK,), "expected": 2}, RejectReason.STALE_VERSION, "the blacklist has version 1, not 2"),
        ({"expected": 0}, RejectReason.STALE_VERSION, "the blacklist has version 1, not 0"),
    ],
)
async def test_what_cannot_be_meant_changes_nothing(order: dict[str, Any], reason: RejectReason, words: str) -> None:
    notes = Notes()
    house = await started(notes, HOST)
    with pytest.raises(Refused) as refused:
        await house.tell(**order)
    assert refused.value.reason is reason and words in refused.value.what
    assert house.own.blacklist == Blacklist(1, (HOST,)) and notes.writes == 1


async def test_the_own_rack_may_be_named_though_the_node_stands_in_it() -> None:
    house = await started(Notes())
    rack = AddressPrefix(ME >> 8 << 8, 24)
    assert (await house.tell(add=(rack,))).prefixes == (rack,)


async def test_a_full_disk_changes_nothing() -> None:
    notes = Notes()
    house = await started(notes, HOST)
    notes.is_full = True
    with pytest.raises(Refused, match="full"):
        await house.tell(add=(RACK,))
    assert house.own.signed().blacklist == (HOST,)


@pytest.mark.expect_log("followed, and not kept yet")
async def test_a_node_starts_on_a_full_disk_and_follows_its_settings() -> None:
    notes = Notes()
    await started(notes, HOST)
    notes.is_full = True
    house = await started(notes, RACK)
    assert house.own.signed().blacklist == (RACK, HOST)
    notes.is_full = False
    await house.tell(add=(OTHER,))
    assert (await started(notes)).own.signed().blacklist == (RACK, OTHER, HOST)


async def test_two_orders_at_once_are_both_carried_out() -> None:
    house = await started(Notes())
    async with trio.open_nursery() as nursery:
        for prefix in (RACK, HOST, OTHER):
            nursery.start_soon(lambda added: house.tell(add=(added,)), prefix)
    assert house.own.blacklist == Blacklist(3, (RACK, OTHER, HOST))


async def test_of_two_who_expect_the_same_version_one_is_refused() -> None:
    house = await started(Notes())
    refused = []

    async def order(prefix: AddressPrefix) -> None:
        try:
            await house.tell(add=(prefix,), expected=0)
        except Refused:
            refused.append(prefix)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(order, RACK)
        nursery.start_soon(order, HOST)
    assert len(refused) == 1 and house.own.blacklist.version == 1


PREFIXES = st.integers(0, 32).flatmap(lambda bits: st.integers(0, 2**bits - 1).map(lambda top: AddressPrefix(top << (32 - bits), bits)))
LISTS = st.lists(PREFIXES, max_size=8)


@given(LISTS, LISTS, LISTS)
def test_a_change_is_a_change_of_sets(there: list[AddressPrefix], add: list[AddressPrefix], remove: list[AddressPrefix]) -> None:
    known = changed(Blacklist(), there, ())
    now = changed(known, add, remove)
    assert set(now.prefixes) == set(there) - set(remove) | set(add)
    assert list(now.prefixes) == sorted(now.prefixes)
    assert (now.version > known.version) == (now.prefixes != known.prefixes)
    assert decode_blacklist(encode_blacklist(now)) == now


@pytest.mark.parametrize(
    "note",
    [
        b"",
        pack_value({"v": 2, "version": 1, "prefixes": []}),
        pack_value({"v": 1, "version": 1}),
        pack_value({"v": 1, "version": -1, "prefixes": []}),
        pack_value({"v": 1, "version": True, "prefixes": []}),
        pack_value({"v": 1, "version": 1, "prefixes": [[1, 31]]}),
        pack_value({"v": 1, "version": 1, "prefixes": [[0, 33]]}),
        pack_value({"v": 1, "version": 1, "prefixes": [[1 << 32, 32]]}),
        pack_value({"v": 1, "version": 1, "prefixes": [[2, 32], [1, 32]]}),
        pack_value({"v": 1, "version": 1, "prefixes": [[2, 32], [2, 32]]}),
        pack_value({"v": 1, "version": 1, "prefixes": [2]}),
        pack_value({"v": 1, "version": 1, "prefixes": None}),
    ],
)
async def test_a_damaged_note_is_no_empty_blacklist(note: bytes) -> None:
    notes = Notes()
    notes.kept["blacklist"] = note
    with pytest.raises(DamagedData, match="blacklist"):
        await started(notes)
