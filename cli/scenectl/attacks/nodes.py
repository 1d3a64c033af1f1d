"""Attacks of a node that is certified, and no member of the cluster's log yet."""

from __future__ import annotations

import trio

from scenectl.attacks.attacker import BURST, PAUSE_S, Attacker
from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import SealingPublicKey
from scenefold.peer.datagrams import Exchange
from scenefold.wire import RequestState, encode_packet
from scenefold.world import Priority, real_world


async def replayed_datagrams(me: Attacker) -> None:
    """What a node has said before, again and again: by a spare, whose keys are good."""
    spare = me.profile.members[-1]
    secrets = me.profile.node_secrets(spare.address)
    keys: dict[NodeId, SealingPublicKey] = {member.node_id: member.sealing_key for member in me.profile.members}
    target = next(member.node_id for member in me.profile.members if member.address == me.address)
    world = real_world(me.profile.node_identity(spare.address), me.profile.authority_certificate(), ports=me.profile.ports)
    exchange = Exchange(spare.node_id, me.profile.facts().cluster_id, 1, secrets.sealing, keys.get, world.entropy.token)
    datagrams = await world.network.open_datagrams(spare.address, Priority.HIGH)

    async def answer() -> None:
        while True:
            data, source = await datagrams.receive()
            sender, taken = exchange.take(data, source.address, trio.current_time())
            me.seen["answers"] += len(taken.packets)
            for reply in taken.replies:
                await datagrams.send(reply, address_of(sender) if sender is not None else me.address)

    question = encode_packet(RequestState(request_id=1))
    async with trio.open_nursery() as nursery:
        nursery.start_soon(answer)
        tape: list[bytes] = []
        while True:
            if len(tape) < BURST:
                tape.append(exchange.seal(target, question) or b"")
            for data in tape:
                await datagrams.send(data, me.address)
                me.seen["sent"] += 1
            await trio.sleep(PAUSE_S)
