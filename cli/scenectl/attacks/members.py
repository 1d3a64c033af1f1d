"""Attacks with a certificate of the cluster that counts, and no key of any scene."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from random import Random

import trio

from scenectl.attacks.attacker import CROWD, HANDS, PAUSE_S, Attacker, by_many, by_one
from scenefold.base.errors import Refused
from scenefold.base.limits import CONNECTIONS_PER_PEER_MAX, FRAME_BYTES_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, EXPECTS_NOTHING, RecordHeader
from scenefold.wire import (
    GetMany,
    GetManyReply,
    ListScenes,
    MiniStatus,
    Packet,
    PutItem,
    PutMany,
    PutManyReply,
    RecordKey,
    RequestTable,
    encode_packet,
)
from scenefold.world import ConnectionLost, Links, Priority, open_links

OLD_MAX = 65
_LENGTH = struct.Struct(">I")


async def silent_members(me: Attacker) -> None:
    """A thousand connections with a good certificate that say nothing."""

    async def hand() -> None:
        connection = await me.enter()
        me.seen["opened"] += 1
        try:
            await connection.receive(1)
            me.seen["closed by the node"] += 1
        finally:
            await connection.aclose()

    await by_many(CROWD, hand)


async def byte_a_second(me: Attacker) -> None:
    """Frames that come one byte a second, on as many connections as a peer may have."""
    data = encode_packet(ListScenes(request_id=1))

    async def hand() -> None:
        connection = await me.enter()
        me.seen["opened"] += 1
        try:
            for byte in _LENGTH.pack(FRAME_BYTES_MAX) + data * 100:
                await connection.send(bytes((byte,)))
                me.seen["bytes"] += 1
                await trio.sleep(1.0)
        except ConnectionLost:
            me.seen["closed by the node"] += 1
        finally:
            await connection.aclose()

    await by_many(CONNECTIONS_PER_PEER_MAX, hand)


async def enormous_lengths(me: Attacker) -> None:
    """Frames that claim four gigabytes, or just a byte too many; and whole ones of eight mebibytes of noise."""

    async def hand() -> None:
        connection = await me.enter(Priority.LOW)
        try:
            match me.dice.randrange(3):
                case 0:
                    await connection.send(b"\xff" * 1_000)
                case 1:
                    await connection.send(_LENGTH.pack(FRAME_BYTES_MAX + 1) + bytes(1_000))
                case _:
                    await connection.send(_LENGTH.pack(FRAME_BYTES_MAX) + bytes(FRAME_BYTES_MAX))
            me.seen["sent"] += 1
            while await connection.receive(1 << 16):
                pass
            me.seen["closed by the node"] += 1
        finally:
            await connection.aclose()

    await by_many(HANDS // 4, hand)


async def malformed_packets(me: Attacker) -> None:
    """Whole frames with noise in them."""

    async def hand() -> None:
        connection = await me.enter(Priority.LOW)
        try:
            for _ in range(100):
                noise = me.dice.randbytes(me.dice.randrange(1, 2_000))
                await connection.send(_LENGTH.pack(len(noise)) + noise)
                me.seen["sent"] += 1
                await trio.lowlevel.checkpoint()
            while await connection.receive(1 << 16):
                pass
            me.seen["closed by the node"] += 1
        except ConnectionLost:
            me.seen["closed by the node"] += 1
        finally:
            await connection.aclose()

    await by_many(HANDS, hand)


async def flood_of_requests(me: Attacker) -> None:
    """Honest questions, as many at a time as connections take."""
    async with open_links(me.world) as links:

        async def hand() -> None:
            question: Packet = RequestTable() if me.dice.random() < 0.5 else GetMany(me.scene, 0, (RecordKey(me.space, me.place),) * 64)
            priority = Priority.HIGH if isinstance(question, RequestTable) else Priority.LOW
            began = trio.current_time()
            await links.request(me.address, priority, question, 10.0)
            me.seen["answered"] += 1
            me.seen["of these after a quarter of a second"] += trio.current_time() - began > 0.25

        await by_many(256, hand)


async def flood_by_a_member(me: Attacker) -> None:
    """The same by a node that is a member of the cluster's log."""
    await flood_of_requests(me.as_member)


async def forged_records(me: Attacker) -> None:
    """An honest record, moved, changed, unsigned, or with another expectation."""
    good: PutItem | None = None
    async with open_links(me.world) as links:

        async def hand() -> None:
            nonlocal good
            good = good or await _honest_record(me, links)
            items = [_forged(good, me.dice) for _ in range(64)]
            await _offer(me, links, items)

        await by_one(me, hand)


async def forged_records_from_a_member(me: Attacker) -> None:
    """The same by a node that is a member of the cluster's log."""
    await forged_records(me.as_member)


async def old_record_again(me: Attacker) -> None:
    """What its writer signed, and has written over since, as it was."""
    met: dict[bytes, PutItem] = {}
    async with open_links(me.world) as links:

        async def hand() -> None:
            record = await _honest_record(me, links)
            met.setdefault(record.signature, record)
            *old, _present = list(met.values())[-OLD_MAX:]
            if old:
                await _offer(me, links, old)
            else:
                await trio.sleep(PAUSE_S)

        await by_one(me, hand)


async def _honest_record(me: Attacker, links: Links) -> PutItem:
    """What lies at the honest place now, as its writer sent it."""
    found = await links.request(me.address, Priority.LOW, GetMany(me.scene, 0, (RecordKey(me.space, me.place),)), 10.0)
    assert isinstance(found, GetManyReply) and found.records[0] is not None
    record = found.records[0]
    return PutItem(me.scene, me.space, me.place, record.signature, record.header, record.ciphertext)


async def _offer(me: Attacker, links: Links, items: Sequence[PutItem]) -> None:
    answer = await links.request(me.address, Priority.LOW, PutMany(tuple(items)), 10.0)
    assert isinstance(answer, PutManyReply)
    for outcome in answer.outcomes:
        me.seen[RejectReason(outcome.reason).name.lower() if outcome.reason else "taken"] += 1


def _forged(good: PutItem, dice: Random) -> PutItem:
    match dice.randrange(5):
        case 0:
            return replace(good, location=Location.from_number(good.location.number + 1 + dice.randrange(1 << 40)))
        case 1:
            return replace(good, ciphertext=_flipped(good.ciphertext, dice))
        case 2:
            return replace(good, signature=_flipped(good.signature, dice))
        case 3:
            return replace(good, header=_expecting(good.header, dice.choice((EXPECTS_ANYTHING, EXPECTS_NOTHING, dice.randbytes(32)))))
        case _:
            return replace(good, header=_flipped(good.header, dice))


def _expecting(header: bytes, expects: bytes) -> bytes:
    decoded = RecordHeader.decode(header)
    # Not what it says already: that would be an honest repetition.
    return decoded._replace(expects=expects if expects != decoded.expects else bytes(31) + b"\1").encode()


def _flipped(data: bytes, dice: Random) -> bytes:
    bit = dice.randrange(8 * len(data))
    return data[: bit // 8] + bytes((data[bit // 8] ^ 1 << bit % 8,)) + data[bit // 8 + 1 :]


async def others_names(me: Attacker) -> None:
    """Packets in the name of another node."""
    node = me.profile.members[0].node_id
    mini = MiniStatus(1 << 40, node, None, 0, 0, 0, 0, 0, 1 << 30)
    packets: tuple[tuple[Priority, Packet], ...] = (
        (Priority.HIGH, RequestTable(mini_status=mini)),
        (Priority.LOW, GetMany(me.scene, 0, (RecordKey(me.space, me.place),), mini_status=mini)),
    )
    async with open_links(me.world) as links:

        async def hand() -> None:
            priority, packet = me.dice.choice(packets)
            await _count_refusal(me, links, priority, packet)

        await by_many(HANDS, hand)


async def _count_refusal(me: Attacker, links: Links, priority: Priority, packet: Packet) -> None:
    try:
        await links.request(me.address, priority, packet, 10.0)
        me.seen["taken"] += 1
    except Refused as refusal:
        me.seen[refusal.reason.name.lower()] += 1
