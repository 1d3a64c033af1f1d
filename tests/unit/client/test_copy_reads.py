"""If one fails, a dead or slow owner makes readers wait for what others hold, or they are given what is older."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import KeyId, NodeId, address_of, node_id_of
from scenefold.base.limits import CLIENT_HEDGE_S, CLIENT_HEDGE_S_MIN, CLIENT_REQUEST_S, CLIENT_STATUS_S
from scenefold.base.location import LINE_LENGTH, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.adopters import LEFT_ALONE_S
from scenefold.client.asked_holders import NAMED_MAX
from scenefold.client.bad_copies import AGAIN_S
from scenefold.client.former_tables import FORMER_S
from scenefold.client.scene import Scene
from scenefold.client.table import Owner, RoutingTable
from scenefold.crypto import RecordHeader, version_of
from scenefold.scene.log import Layouts
from scenefold.wire import (
    Configuration,
    CopiesFound,
    CopiesLookedAt,
    Copy,
    CopyState,
    Fault,
    GetCopies,
    GetMany,
    GetManyReply,
    LookAtCopies,
    Member,
    Packet,
    RecordBytes,
    SpaceEntry,
)
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene

THIRDS = tuple(Location.from_number(LINE_LENGTH * third // 3) for third in (1, 2))
SHADOWS = [SpaceEntry(11 + index, FILES, offset, 1, 1, False, False) for index, offset in enumerate(THIRDS)]
LAYOUTS = Layouts.of([SpaceEntry(FILES, 0, Location(bytes(20)), 3, 2, False, False), *SHADOWS])


@dataclass
class HoldingNodes(FakeNodes):
    """Three nodes, of which each holds copies of what the others own, of all that was put before `keep` was called."""

    kept: dict[str, dict[Location, RecordBytes]] = field(default_factory=dict)
    claimed: dict[str, Configuration] = field(default_factory=dict)
    """What a node says instead of the configuration that there is."""

    before: RoutingTable | None = None
    """By which line custody was given, if that is another one by now."""
    not_ready: set[str] = field(default_factory=set)
    """They own what they cannot speak for yet."""
    without_custody: set[str] = field(default_factory=set)
    """They hold no copies of anything."""
    untold: set[Location] = field(default_factory=set)
    """Of these an owner says nothing for longer than anybody waits."""

    def keep(self) -> None:
        for address in self.addresses:
            self.kept[address] = {
                place: RecordBytes(item.signature, item.header, item.ciphertext) for (_, place), item in self.records.items()
            }

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, GetMany) and self.untold.intersection(key.location for key in packet.keys):
            self.asked.append((address, packet))
            await trio.sleep(timeout)
        return await super().request(address, priority, packet, timeout)

    def _answer(self, address: str, packet: Packet) -> Packet:
        if isinstance(packet, LookAtCopies):
            return CopiesLookedAt(len(packet.keys))
        if isinstance(packet, GetMany) and address in self.not_ready:
            return Fault(RejectReason.NOT_READY, "the place is changing hands")
        if not isinstance(packet, GetCopies):
            return super()._answer(address, packet)
        holders: list[Configuration] = []
        copies: list[Copy] = []
        for key in packet.keys[: self.reply_records_max]:
            owner = (self.before or self.table).owner_of(key.location)
            if owner.address == address and packet.digests_only and not packet.any_copy and address not in self.without_lease:
                holders.append(Configuration(0, (Member(owner.node_id, bytes(16)),), 1))
                item = self._found(key)
                digest = b"" if item is None else version_of(item.header)
                copies.append(Copy(CopyState.DIGEST if digest else CopyState.NOTHING, len(holders) - 1, digest, None))
                continue
            if owner.address == address or address in self.without_custody or (address in self.without_lease and not packet.any_copy):
                copies.append(Copy(CopyState.NO_CUSTODY, 0, b"", None))
                continue
            holders.append(self.claimed.get(address) or self.configuration(owner))
            found = self.kept[address].get(key.location)
            if found is None:
                copies.append(Copy(CopyState.NOTHING, len(holders) - 1, b"", None))
            elif packet.digests_only:
                copies.append(Copy(CopyState.DIGEST, len(holders) - 1, version_of(found.header), None))
            else:
                copies.append(Copy(CopyState.RECORD, len(holders) - 1, b"", found))
        return CopiesFound(tuple(holders), tuple(copies))

    def configuration(self, owner: Owner) -> Configuration:
        others = [node_id_of(address) for address in self.addresses if address != owner.address]
        return Configuration(1, tuple(Member(NodeId(node), bytes(16)) for node in (owner.node_id, *others)), 2)


async def kept_scene(nodes: HoldingNodes) -> Scene:
    """Everything is put, and all nodes have it."""
    scene = _scene(nodes)
    access = scene.space(FILES)._access
    access.identity = replace(access.identity, layouts=LAYOUTS)
    await scene.space(FILES).put_many(ITEMS)
    nodes.keep()
    nodes.asked.clear()
    return scene


def owned_by(nodes: HoldingNodes, address: str) -> list[Location]:
    return [place for place in PLACES if nodes.table.owner_of(place).address == address]


def asked(nodes: HoldingNodes, kind: type[Packet]) -> set[str]:
    return {address for address, packet in nodes.asked if isinstance(packet, kind)}


async def test_as_long_as_owners_answer_nobody_else_is_asked(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    assert await scene.space(FILES).get_many(PLACES) == [payload for _, payload in ITEMS]
    assert not asked(nodes, GetCopies)


@pytest.mark.parametrize("how", ["away", "hung", "without_lease", "busy"])
async def test_what_an_owner_cannot_say_now_its_holders_say(how: str, autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(reply_records_max=4)
    scene = await kept_scene(nodes)
    owner = nodes.addresses[1]
    if how == "busy":
        nodes.busy[owner] = 1
    else:
        getattr(nodes, how).add(owner)
    with trio.fail_after(2 * CLIENT_HEDGE_S):
        missing = Location.from_number(nodes.table.by_id(node_id_of(owner)).right_bound.number - 1)  # type: ignore[union-attr]
        found = await scene.space(FILES).get_many([*PLACES, missing])
    assert found == [*(payload for _, payload in ITEMS), None]
    assert asked(nodes, GetCopies) >= set(nodes.addresses) - {owner}


async def test_once_an_owner_was_silent_it_is_not_waited_for_again(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    nodes.hung.add(nodes.addresses[1])
    places = owned_by(nodes, nodes.addresses[1])
    access = scene.space(FILES)._access
    with pytest.raises(Unreachable):
        await access.calls.ask(nodes.addresses[1], GetMany(9, 1, ()), CopiesFound, timeout_s=1.0)
    began = trio.current_time()
    await scene.space(FILES).get_many(places)
    assert trio.current_time() - began < CLIENT_HEDGE_S / 2


def found_at(nodes: HoldingNodes, place: Location) -> RecordBytes:
    """What its owner has."""
    item = next(item for (_, where), item in nodes.records.items() if where == place)
    return RecordBytes(item.signature, item.header, item.ciphertext)


@pytest.mark.parametrize("ahead", [0, 2])
async def test_what_one_holder_has_newer_than_the_other_counts(ahead: int, autojump_clock: MockClock) -> None:
    """It may have been acknowledged, and nothing newer can have been: both were heard."""
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner = nodes.addresses[1]
    (place, *_) = owned_by(nodes, owner)
    await scene.space(FILES).put(place, b"newer")
    nodes.kept[nodes.addresses[ahead]][place] = found_at(nodes, place)
    nodes.away.add(owner)
    began = trio.current_time()
    assert await scene.space(FILES).get(place) == b"newer"
    assert trio.current_time() - began < CLIENT_HEDGE_S


async def test_how_new_a_forged_record_is_nobody_believes(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner, liar = nodes.addresses[1], nodes.addresses[0]
    (place, *_) = owned_by(nodes, owner)
    await scene.space(FILES).put(place, b"newer")
    nodes.kept[liar][place] = replace(found_at(nodes, place), ciphertext=bytes(64))
    nodes.hung.add(owner)
    with trio.move_on_after(CLIENT_REQUEST_S / 2) as patience:
        await scene.space(FILES).get(place)
    assert patience.cancelled_caught, "it is left to the owner"
    nodes.hung.clear()
    assert await scene.space(FILES).get(place) == b"newer"


async def test_what_is_signed_by_nobody_who_is_known_is_not_the_newest(autojump_clock: MockClock) -> None:
    """It may be by a writer that came since; or somebody made it up, and it would win over everything."""
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner, liar = nodes.addresses[1], nodes.addresses[0]
    (place, *_) = owned_by(nodes, owner)
    sound = nodes.kept[liar][place]
    header = RecordHeader.decode(sound.header)
    nodes.kept[liar][place] = replace(sound, header=header._replace(epoch=1 << 40, writer=KeyId(header.writer ^ 1)).encode())
    nodes.slow[owner] = 2 * CLIENT_HEDGE_S
    assert await scene.space(FILES).get(place) == dict(ITEMS)[place]


@pytest.mark.parametrize("is_told", [True, False])
async def test_who_is_behind_learns_of_the_header_that_the_newest_record_names(
    is_told: bool, autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    space, owner = scene.space(FILES), nodes.addresses[1]
    (place, *_) = owned_by(nodes, owner)
    access, before = space._access, space._access.identity
    access.identity = after = replace(before, position=before.position + 1)
    await space.put(place, b"newer")
    access.identity = before
    asked_for: list[int] = []

    async def refresh(position: int = 0) -> None:
        asked_for.append(position)
        access.identity = after if is_told else before

    monkeypatch.setattr(access, "refresh", refresh)
    nodes.kept[nodes.addresses[0]][place] = found_at(nodes, place)
    nodes.hung.add(owner)
    with trio.move_on_after(CLIENT_REQUEST_S / 2) as patience:
        assert await space.get(place) == b"newer"
    assert patience.cancelled_caught is not is_told, "nobody knows what is newer"
    assert asked_for == [after.position]


@pytest.mark.parametrize("elsewhere", [1, 2])
async def test_whom_the_table_does_not_give_as_holder_is_asked_all_the_same(elsewhere: int, autojump_clock: MockClock) -> None:
    """Bounds have moved, and copies have not followed them yet: of the holders as placement gives them one, or none, has any."""
    nodes = HoldingNodes(addresses=tuple(f"127.0.0.{number}" for number in range(2, 8)))
    scene = await kept_scene(nodes)
    space, table = scene.space(FILES), nodes.table
    place = PLACES[3]
    owner = table.owner_of(place)
    placed = [address_of(node) for node in table.holders_of(LAYOUTS.offsets[FILES], place)]
    free = [address_of(node) for holder in placed for node in table.beside(node_id_of(holder))]
    free = [address for address in dict.fromkeys(free) if address not in (owner.address, *placed)]
    holding = [*placed[elsewhere:], *free[:elsewhere]]
    members = tuple(Member(NodeId(node_id_of(address)), bytes(16)) for address in (owner.address, *holding))
    nodes.claimed = dict.fromkeys(nodes.addresses, Configuration(1, members, 2))
    nodes.without_custody = set(nodes.addresses) - set(holding)
    nodes.away.add(owner.address)
    assert await space.get(place) == ITEMS[3][1]
    assert asked(nodes, GetCopies) >= set(holding)


async def test_who_has_something_older_its_owner_is_told_of(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner, behind = nodes.addresses[1], nodes.addresses[2]
    (place, *_) = owned_by(nodes, owner)
    await scene.space(FILES).put(place, b"newer")
    older = nodes.kept[behind]
    nodes.keep()
    nodes.kept[behind] = older
    nodes.slow[owner] = 2 * CLIENT_HEDGE_S
    assert await scene.space(FILES).get(place) == b"newer"
    told = [(address, packet) for address, packet in nodes.asked if isinstance(packet, LookAtCopies)]
    assert [(address, address_of(packet.holder), [key.location for key in packet.keys]) for address, packet in told] == [
        (owner, behind, [place])
    ]
    await trio.sleep(AGAIN_S)
    assert await scene.space(FILES).get(place) == b"newer"
    assert len([packet for _, packet in nodes.asked if isinstance(packet, LookAtCopies)]) == 2
    await scene.space(FILES).get_many([place, PLACES[0]])
    nodes.slow.clear()
    nodes.asked.clear()
    await scene.space(FILES).get(place)
    assert not asked(nodes, LookAtCopies), "nobody else was asked"


@pytest.mark.parametrize("is_adopted", [False, True])
async def test_what_a_removed_node_owned_its_holders_say_until_another_can(is_adopted: bool, autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    first, removed, last = nodes.table.owners
    calls = scene.space(FILES)._access.calls
    await calls.refresh()
    nodes.before = nodes.table
    if not is_adopted:
        nodes.claims[last.address] = nodes.table.arcs()[2][1]
    nodes.table = RoutingTable([replace(first, lamport=5), replace(last, lamport=5)])
    nodes.away.add(removed.address)
    nodes.not_ready.add(last.address)
    await calls.refresh()
    places = [place for place in PLACES if nodes.before.owner_of(place) is removed]
    assert all(bool(calls.table.claimants(place)) == is_adopted for place in places[1:])
    began = trio.current_time()
    assert await scene.space(FILES).get_many(places) == [payload for place, payload in ITEMS if place in places]
    assert trio.current_time() - began < CLIENT_HEDGE_S
    await trio.sleep(FORMER_S + 1)
    with pytest.raises((Refused, Unreachable)):
        await scene.space(FILES).get_many(places)


@pytest.mark.parametrize("giver", ["removed", "silent", "drained"])
async def test_who_adopted_what_it_cannot_tell_yet_is_asked_now_and_then_and_waited_for_by_nobody(
    giver: str, autojump_clock: MockClock
) -> None:
    """With what it owned before it is quick all the while. Of one that is silent, the client has not heard yet that it was removed."""
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    space, calls = scene.space(FILES), scene.access.calls
    (first, gone, adopter), arcs = nodes.table.owners, nodes.table.arcs()
    await calls.refresh()
    nodes.before = nodes.table
    left = {"removed": [], "silent": [gone], "drained": [replace(gone, right_bound=None, lamport=5)]}[giver]
    nodes.table = RoutingTable([replace(first, lamport=5), *left, replace(adopter, lamport=5)])
    nodes.claims[adopter.address] = Arc(arcs[1][1].first, arcs[2][1].last)
    await calls.refresh()
    if giver == "silent":
        nodes.away.add(gone.address)
        with pytest.raises(Unreachable):
            await calls.ask(gone.address, GetMany(9, 1, ()), GetManyReply)
    adopted = [place for place in PLACES if nodes.before.owner_of(place) is gone]
    own = owned_by(nodes, adopter.address)[-1]

    async def waits_s(times: int) -> list[float]:
        waits = []
        for place in adopted * times:
            began = trio.current_time()
            assert await space.get(place) == ITEMS[PLACES.index(place)][1]
            waits.append(trio.current_time() - began)
            await space.get(own)
        return waits

    nodes.untold.update(adopted)
    began = trio.current_time()
    assert max(await waits_s(8)) < CLIENT_HEDGE_S_MIN
    assert trio.current_time() - began < LEFT_ALONE_S
    questions = [packet for address, packet in nodes.asked if address == adopter.address and isinstance(packet, GetMany)]
    assert sum(packet.keys[0].location in adopted for packet in questions) == 1
    nodes.untold.clear()
    await trio.sleep(LEFT_ALONE_S)
    await waits_s(1)
    nodes.asked.clear()
    await waits_s(4)
    assert not asked(nodes, GetCopies), "it tells what lies there by now"
    nodes.untold.update(adopted)
    late, *others = await waits_s(1)
    assert late >= CLIENT_HEDGE_S_MIN > max(others)


async def test_one_that_names_a_configuration_of_its_own_is_not_believed(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner, liar, other = nodes.addresses[1], nodes.addresses[0], nodes.addresses[2]
    (place, *_) = owned_by(nodes, owner)
    nodes.claimed[liar] = Configuration(99, (Member(node_id_of(owner), bytes(16)), Member(node_id_of(liar), bytes(16))), 2)
    nodes.kept[liar].clear()
    nodes.away |= {owner, other}
    with pytest.raises(Unreachable):
        await scene.space(FILES).get(place)


async def test_what_has_rotted_at_its_owner_is_read_from_holders(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(rotten={PLACES[3]})
    scene = await kept_scene(nodes)
    assert await scene.space(FILES).get_many(PLACES) == [payload for _, payload in ITEMS]
    nodes.away |= set(nodes.addresses) - {nodes.table.owner_of(PLACES[3]).address}
    with pytest.raises(Refused) as refusal:
        await scene.space(FILES).get(PLACES[3])
    assert refusal.value.reason is RejectReason.NOT_READY, "and if they are away, it is said to be damaged"


async def test_an_owner_that_is_always_slow_is_not_what_is_usual_and_soon_not_waited_for(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(slow={"127.0.0.2": 0.002, "127.0.0.3": 0.3, "127.0.0.4": 0.002})
    scene = await kept_scene(nodes)
    space = scene.space(FILES)
    waits: list[float] = []
    for place in PLACES * 6:
        began = trio.current_time()
        assert await space.get(place) == ITEMS[PLACES.index(place)][1]
        waits.append(trio.current_time() - began)
    assert max(waits[-len(PLACES) :]) < 3 * CLIENT_HEDGE_S_MIN


async def test_what_one_holder_forges_comes_from_the_other(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner = nodes.addresses[1]
    for place in owned_by(nodes, owner):
        holder = address_of(scene.access.calls.table.holders_of(LAYOUTS.offsets[FILES], place)[0])
        nodes.kept[holder][place] = replace(nodes.kept[holder][place], ciphertext=bytes(64))
    nodes.away.add(owner)
    assert await scene.space(FILES).get_many(PLACES) == [payload for _, payload in ITEMS]


async def test_who_names_ever_more_holders_has_few_of_them_asked(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = HoldingNodes(addresses=tuple(f"127.0.0.{number}" for number in range(2, 62)))
    scene = await kept_scene(nodes)
    space, table = scene.space(FILES), nodes.table
    owner, arc = table.arcs()[7]
    places = [Location.from_number(arc.first.number + 1 + number) for number in range(40)]
    (liar, *others) = (address_of(node) for node in table.holders_of(LAYOUTS.offsets[FILES], places[0]))
    strangers = [node for node in map(node_id_of, nodes.addresses) if address_of(node) not in (owner.address, liar, *others)]
    honest = nodes._answer

    def answer(address: str, packet: Packet) -> Packet:
        if address != liar or not isinstance(packet, GetCopies):
            return honest(address, packet)
        named = [(owner.node_id, node_id_of(liar), strangers[number % len(strangers)]) for number in range(len(packet.keys))]
        holders = [Configuration(number, tuple(Member(node, bytes(16)) for node in three), 2) for number, three in enumerate(named)]
        return CopiesFound(tuple(holders), tuple(Copy(CopyState.NOTHING, number, b"", None) for number in range(len(holders))))

    monkeypatch.setattr(nodes, "_answer", answer)
    nodes.without_custody = set(nodes.addresses)
    nodes.hung.add(owner.address)
    with trio.move_on_after(CLIENT_HEDGE_S + 1):
        await space.get_many(places)
    assert others[0] in asked(nodes, GetCopies) and len(asked(nodes, GetCopies)) < 2 * NAMED_MAX < len(places)


async def test_who_says_little_at_a_time_and_slowly_is_not_heard_to_the_end(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner, liar, other = nodes.addresses[1], nodes.addresses[0], nodes.addresses[2]
    (place, *_) = owned_by(nodes, owner)
    places = [Location.from_number(place.number + number) for number in range(15)]
    nodes.reply_records_max = 1
    nodes.slow[liar] = CLIENT_STATUS_S - 1
    nodes.away |= {owner, other}
    with trio.move_on_after(4 * CLIENT_STATUS_S):
        await scene.space(FILES).get_many(places)
    assert len([packet for address, packet in nodes.asked if isinstance(packet, GetMany) and address == owner]) > 1, "it is tried again"
    assert len([packet for address, packet in nodes.asked if isinstance(packet, GetCopies) and address == liar]) < len(places)


async def test_who_hangs_does_not_keep_those_who_differ_from_showing_what_is_newer(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(addresses=tuple(f"127.0.0.{number}" for number in range(2, 8)))
    scene = await kept_scene(nodes)
    space, table, place = scene.space(FILES), nodes.table, PLACES[3]
    owner = table.owner_of(place)
    hung, holder = (address_of(node) for node in table.holders_of(LAYOUTS.offsets[FILES], place))
    other = next(address for address in nodes.addresses if address not in (owner.address, hung, holder))
    members = tuple(Member(NodeId(node_id_of(address)), bytes(16)) for address in (owner.address, holder, other))
    nodes.claimed = dict.fromkeys(nodes.addresses, Configuration(1, members, 2))
    await space.put(place, b"newer")
    nodes.kept[other][place] = found_at(nodes, place)
    nodes.away.add(owner.address)
    nodes.hung.add(hung)
    with trio.fail_after(CLIENT_STATUS_S / 2):
        assert await space.get(place) == b"newer"
