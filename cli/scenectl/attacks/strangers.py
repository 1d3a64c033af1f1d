"""Attacks that need nothing but an address."""

from __future__ import annotations

import struct
from contextlib import suppress

import trio

from scenectl.attacks.attacker import BURST, CROWD, HANDS, PAUSE_S, Attacker, by_many
from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import newcomer_context
from scenefold.world import Priority


async def silent_strangers(me: Attacker) -> None:
    """A thousand connections that say nothing."""

    async def hand() -> None:
        async with await me.knock() as stream:
            me.seen["opened"] += 1
            await stream.receive_some()
            me.seen["closed by the node"] += 1

    await by_many(CROWD, hand)


async def garbage(me: Attacker) -> None:
    """Connections that begin with noise."""

    async def hand() -> None:
        async with await me.knock(me.dice.choice(list(Priority))) as stream:
            await stream.send_all(me.dice.randbytes(1_000))
            me.seen["sent"] += 1
            with suppress(trio.BrokenResourceError):
                while await stream.receive_some():
                    pass
            me.seen["closed by the node"] += 1

    await by_many(HANDS, hand)


async def handshakes(me: Attacker) -> None:
    """TLS handshakes that lead to nothing, since no certificate is shown."""
    context = newcomer_context()

    async def hand() -> None:
        stream = await me.knock(me.dice.choice(list(Priority)))
        secure = trio.SSLStream(stream, context, server_hostname=me.address)
        try:
            me.seen["begun"] += 1
            await secure.do_handshake()
            me.seen["answered"] += 1
            await secure.receive_some()
            me.seen["closed by the node"] += 1
        except trio.BrokenResourceError:
            me.seen["closed by the node"] += 1
        finally:
            await trio.aclose_forcefully(secure)

    await by_many(HANDS, hand)


async def forged_datagrams(me: Attacker) -> None:
    """Datagrams in the name of members, and noise."""
    await _forge(me, [member.node_id for member in me.profile.members], "")


async def forged_datagrams_from_a_members_address(me: Attacker) -> None:
    """The same by somebody who can write a member's address on them: only their seal tells."""
    member = me.profile.founders[-1]
    await _forge(me, [member], address_of(member))


async def _forge(me: Attacker, members: list[NodeId], source: str) -> None:
    socket = trio.socket.socket(type=trio.socket.SOCK_DGRAM)
    target = next(member.node_id for member in me.profile.members if member.address == me.address)
    with socket:
        await socket.bind((source, 0))
        while True:
            for _ in range(BURST):
                head = struct.pack(">4sII", b"SFD2", me.dice.choice(members), target)
                data = head + me.dice.randbytes(200) if me.dice.random() < 0.8 else me.dice.randbytes(300)
                with suppress(OSError):
                    await socket.sendto(data, (me.address, me.profile.ports.high))
                    me.seen["sent"] += 1
            await trio.sleep(PAUSE_S)
