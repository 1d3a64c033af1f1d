"""If this failed, a revoked key would be let in, or a renewed certificate be shown to nobody: in one world, unnoticed in the other."""

from __future__ import annotations

import pytest
import trio

from conformance.world.makers import Worlds
from scenefold.base.errors import LocalFault
from scenefold.base.ids import KeyId
from scenefold.crypto import MemberKeys, MemberSecrets
from scenefold.world import Connection, Priority, World

OLD, NEW, OTHER = (MemberSecrets.generate().public() for _ in range(3))


async def keys_seen(client: World, node: World, address: str) -> tuple[KeyId | None, KeyId | None]:
    """Of a client that connects: which key of the node it sees, and which one the node sees of it."""
    seen: list[KeyId | None] = []

    async def serve(connection: Connection) -> None:
        seen.append(connection.peer_key)
        await connection.send(b"!")

    async with trio.open_nursery() as nursery:
        await nursery.start(node.network.listen, address, Priority.HIGH, serve)
        connection = await client.network.connect(address, Priority.HIGH)
        try:
            assert await connection.receive(1) == b"!"
            seen.append(connection.peer_key)
        finally:
            await connection.aclose()
        nursery.cancel_scope.cancel()
    return seen[1], seen[0]


async def test_both_know_which_key_the_other_signs_with(worlds: Worlds) -> None:
    (node, _), (client, _) = worlds.certified(0, OLD), worlds.certified(1, OTHER)
    assert await keys_seen(client, node, worlds.address(0)) == (OLD.signing.key_id, OTHER.signing.key_id)


async def test_who_names_no_key_has_none(worlds: Worlds) -> None:
    assert await keys_seen(worlds.node(1), worlds.node(0), worlds.address(0)) == (None, None)


@pytest.mark.parametrize("who", ["node", "client"])
async def test_a_newer_certificate_is_shown_from_the_next_handshake_on(worlds: Worlds, who: str) -> None:
    (node, renew_node), (client, renew_client) = worlds.certified(0, OLD), worlds.certified(1, OLD)
    held: list[KeyId | None] = []
    address = worlds.address(0)

    async def serve(connection: Connection) -> None:
        held.append(connection.peer_key)
        await connection.send(b"!")

    async def keys() -> tuple[KeyId | None, KeyId | None]:
        connection = await client.network.connect(address, Priority.HIGH)
        try:
            assert await connection.receive(1) == b"!"
            return connection.peer_key, held[-1]
        finally:
            await connection.aclose()

    before, after = OLD.signing.key_id, NEW.signing.key_id
    async with trio.open_nursery() as nursery:
        await nursery.start(node.network.listen, address, Priority.HIGH, serve)
        assert await keys() == (before, before)
        if who == "node":
            node.network.show(renew_node(NEW))
        else:
            client.network.show(renew_client(NEW))
        assert await keys() == ((after, before) if who == "node" else (before, after))
        nursery.cancel_scope.cancel()


def of_another_key(worlds: Worlds, keys: MemberKeys) -> bytes:
    """A good certificate in this node's name, but for a TLS key that it does not have."""
    _, renew = worlds.certified(0, keys)
    return renew(keys)


@pytest.mark.parametrize("certificate", [b"", b"no certificate", None])
async def test_a_certificate_that_is_unusable_changes_nothing(worlds: Worlds, certificate: bytes | None) -> None:
    elsewhere = of_another_key(worlds, NEW)
    node, _ = worlds.certified(0, OLD)
    with pytest.raises(LocalFault):
        node.network.show(elsewhere if certificate is None else certificate)
    assert await keys_seen(worlds.node(1), node, worlds.address(0)) == (OLD.signing.key_id, None)
