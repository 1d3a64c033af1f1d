"""If this fails, who has a certificate of the authority, and stands in no log, does more than a newcomer must."""

from __future__ import annotations

from pathlib import Path

import pytest

from integration.clusters import nodes_here
from scenefold.base.errors import Refused
from scenefold.base.ids import node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Identity, MemberSecrets, new_tls_key, tls_key_in
from scenefold.peer.cluster_log.log_packets import proposal_of
from scenefold.wire import (
    AddNode,
    ListScenes,
    LogRecord,
    Member,
    Packet,
    RejectSceneProposal,
    RequestReport,
    RequestSceneLog,
    RequestTable,
    RespondSceneLog,
    Want,
)
from scenefold.world import Priority, open_links, real_world

GHOST = "127.0.0.77"
FIRST = "127.0.0.2"


async def test_a_certified_node_that_nobody_enrolled_may_read_the_log_and_is_not_added(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 2) as nodes:
        profile, secrets, tls_key = nodes.profile, MemberSecrets.generate(), new_tls_key()
        name = f"node:{node_id_of(GHOST)}"
        pem = profile.authority().certify(name, [GHOST], tls_key_in(tls_key), keys=secrets.public())
        facts = profile.facts()
        world = real_world(Identity(name, pem, tls_key), profile.authority_certificate(), ports=profile.ports)
        async with open_links(world) as links:

            async def ask(packet: Packet, priority: Priority = Priority.HIGH) -> Packet:
                return await links.request(FIRST, priority, packet, 20)

            genesis = facts.genesis_header
            log = await ask(RequestSceneLog(genesis.scene, genesis.genesis, 0, 0, Want.LOG))
            assert isinstance(log, RespondSceneLog) and log.answer is not None and log.answer.position > 0
            me = Member(node_id_of(GHOST), bytes(range(16)))
            entry = AddNode(me, secrets.signing.public.raw, secrets.sealing.public.raw, GHOST, node_id_of(FIRST))
            added = await ask(proposal_of(LogRecord(1, bytes(32), bytes(16), me.node, entry), facts))
            assert isinstance(added, RejectSceneProposal) and added.reason is RejectReason.NOT_AUTHORISED
            for packet, priority in (
                (RequestTable(), Priority.HIGH),
                (RequestReport(), Priority.HIGH),
                (ListScenes(), Priority.LOW),
            ):
                with pytest.raises(Refused, match="no member of this cluster") as caught:
                    await ask(packet, priority)
                assert caught.value.reason is RejectReason.NOT_AUTHORISED
