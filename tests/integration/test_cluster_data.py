"""If this fails, records go to the wrong node, come back wrong, or are stored without their writer's signature.

Three nodes with real TLS, UDP and stores; packets are made by hand, so that they can be bent.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import trio

from integration.clusters import PATIENCE_S, Nodes, links_of_user, nodes_here
from integration.made_scenes import decider_of, scene_in
from loopback import addresses, free_ports
from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, EXPECTS_NOTHING
from scenefold.wire import (
    AcceptData,
    AcceptSceneProposal,
    EmptyData,
    GetData,
    GetMany,
    GetManyReply,
    ListScenes,
    Packet,
    PingBroadcast,
    ProposeData,
    ProposeSceneLog,
    PutItem,
    PutMany,
    PutManyReply,
    QueryRange,
    RecordKey,
    RejectData,
    RejectRange,
    RejectSceneProposal,
    RequestPublicKey,
    RequestSceneLog,
    RequestTable,
    RespondPublicKey,
    RespondSceneLog,
    RespondTable,
    ReturnData,
    ReturnRange,
    SceneLogAnswer,
    SceneLogPublic,
    ScenesListed,
    Want,
)
from scenefold.world import Links, Priority, open_links, real_world
from scenefold.world.profile import ClusterProfile
from unit.peer.scenes_made import LOG, SPACE, STRANGER, WRITER, first_header, later_header, offered, sealed


class User:
    """A client that speaks bare packets to the nodes by number."""

    def __init__(self, nodes: Nodes, links: Links) -> None:
        self.nodes = nodes
        self.scene = scene_in(nodes.profile)
        self._links = links

    def address(self, node: int) -> str:
        return self.nodes.profile.members[node].address

    def node_id(self, node: int) -> NodeId:
        return self.nodes.profile.members[node].node_id

    async def ask(self, node: int, packet: Packet) -> Packet:
        return await self._links.request(self.address(node), Priority.LOW, packet, PATIENCE_S)

    async def refusal(self, node: int, packet: Packet) -> RejectReason:
        with pytest.raises(Refused) as caught:
            await self.ask(node, packet)
        return caught.value.reason

    async def put(self, node: int, *items: PutItem) -> list[int]:
        reply = await self.ask(node, PutMany(items=items))
        assert isinstance(reply, PutManyReply)
        return [outcome.reason for outcome in reply.outcomes]

    async def create(self, scene: SceneLogPublic, node: int = 0) -> Packet:
        return await self.ask(node, proposal_of(scene))


def proposal_of(scene: SceneLogPublic) -> ProposeSceneLog:
    return ProposeSceneLog(scene.genesis, scene.proposed(), LOG)


def place_in(nodes: Nodes, node: int, offset: int = 5) -> Location:
    """A location that this node owns."""
    arc = nodes.contexts[0].routing.arc_of(nodes.profile.members[node].node_id)
    return Location.from_number(arc.first.number + offset)


def item_in(nodes: Nodes, node: int, offset: int = 5, payload: bytes = b"payload", seq: int = 1) -> PutItem:
    expects = EXPECTS_NOTHING if seq == 1 else EXPECTS_ANYTHING
    return offered(sealed(scene_in(nodes.profile), payload=payload, location=place_in(nodes, node, offset), seq=seq, expects=expects))


async def test_records_live_with_their_owners(tmp_path: Path) -> None:
    async with nodes_here(tmp_path) as nodes, links_of_user(nodes.profile) as links:
        user = User(nodes, links)
        accepted = await user.create(user.scene)
        assert isinstance(accepted, AcceptSceneProposal) and accepted.position == user.scene.position

        await check_writes(user)
        await check_single_packets(user)
        await check_reads_anywhere(user)
        await check_ranges(user)
        await check_forgeries(user)
        await check_authority_of_names(user)
        await check_tables_and_keys(user)
        await check_scenes(user)


async def check_writes(user: User) -> None:
    nodes = user.nodes
    items = [item_in(nodes, node) for node in range(3)]
    assert await user.put(0, items[0]) == [0]
    wrong = await user.ask(0, PutMany(items=tuple(items)))
    assert isinstance(wrong, PutManyReply)
    assert [(outcome.reason, outcome.owner) for outcome in wrong.outcomes] == [
        (0, 0),
        (RejectReason.NOT_MY_LOCATION, user.node_id(1)),
        (RejectReason.NOT_MY_LOCATION, user.node_id(2)),
    ]
    assert await user.put(1, items[1]) == [0]
    assert await user.put(2, items[2]) == [0]
    other = sealed(scene_in(nodes.profile), payload=b"other", location=items[0].location, seq=2, expects=EXPECTS_NOTHING)
    assert await user.put(0, offered(other)) == [RejectReason.STALE_VERSION], "what is there is not overwritten"
    assert [node.store.record_count for node in nodes.contexts.values()] == [1, 1, 1]


async def check_single_packets(user: User) -> None:
    item = item_in(user.nodes, 1, offset=9)
    packet = ProposeData(
        scene=item.scene,
        space=item.space,
        location=item.location,
        signature=item.signature,
        header=item.header,
        ciphertext=item.ciphertext,
    )
    rejected = await user.ask(0, packet)
    assert isinstance(rejected, RejectData)
    assert (rejected.reason, rejected.owner) == (RejectReason.NOT_MY_LOCATION, user.node_id(1))
    accepted = await user.ask(1, packet)
    assert isinstance(accepted, AcceptData) and accepted.location == item.location
    assert accepted.mini_status is not None and accepted.mini_status.node == user.node_id(1)


async def check_reads_anywhere(user: User) -> None:
    nodes = user.nodes
    keys = tuple(RecordKey(SPACE, place_in(nodes, node)) for node in (2, 0, 1))
    nothing = RecordKey(SPACE, place_in(nodes, 1, offset=6))
    for node in range(3):
        reply = await user.ask(node, GetMany(scene=user.scene.scene, position=1, keys=(*keys, nothing)))
        assert isinstance(reply, GetManyReply)
        headers = [None if record is None else record.header for record in reply.records]
        assert headers == [item_in(nodes, owner).header for owner in (2, 0, 1)] + [None]
    found = await user.ask(0, GetData(scene=user.scene.scene, space=SPACE, location=place_in(nodes, 1), position=1))
    assert isinstance(found, ReturnData) and found.ciphertext == item_in(nodes, 1).ciphertext and found.position == 1
    empty = await user.ask(0, GetData(scene=user.scene.scene, space=SPACE, location=nothing.location, position=1))
    assert isinstance(empty, EmptyData)
    request = GetMany(scene=user.scene.scene, position=1, keys=keys)
    with pytest.raises(Refused) as caught:
        await nodes.contexts[0].peers.ask(user.node_id(1), Priority.LOW, request, GetManyReply, PATIENCE_S)
    assert caught.value.reason == RejectReason.NOT_MY_LOCATION, "what a node asks is not forwarded again"


async def check_ranges(user: User) -> None:
    nodes = user.nodes
    arcs = [nodes.contexts[0].routing.arc_of(user.node_id(node)) for node in range(3)]
    found = [place_in(nodes, 0)], [place_in(nodes, 1), place_in(nodes, 1, 9)], [place_in(nodes, 2)]
    for node in range(3):
        reply = await user.ask(node, QueryRange(scene=user.scene.scene, space=SPACE, first=FIRST, last=LAST))
        assert isinstance(reply, ReturnRange)
        assert (reply.first, reply.last) == (arcs[node].first, arcs[node].last), "it says which part it covers"
        assert list(reply.locations) == found[node]
    outside = await user.ask(1, QueryRange(scene=user.scene.scene, space=SPACE, first=FIRST, last=FIRST))
    assert isinstance(outside, RejectRange) and outside.reason == RejectReason.OUTSIDE_BOUNDS
    other = await user.ask(0, QueryRange(scene=user.scene.scene, space=SpaceId(11), first=FIRST, last=LAST))
    assert isinstance(other, ReturnRange) and other.locations == ()


async def check_forgeries(user: User) -> None:
    place = place_in(user.nodes, 0, offset=20)
    good = offered(sealed(user.scene, location=place))
    assert await user.put(
        0,
        replace(good, signature=bytes(64)),
        replace(good, ciphertext=bytes(len(good.ciphertext))),
        replace(good, location=place_in(user.nodes, 0, offset=21)),
        offered(sealed(user.scene, STRANGER, location=place)),
        offered(sealed(user.scene, location=place, space=SpaceId(77))),
        offered(sealed(scene_in(user.nodes.profile, private_key=KeyId(5)), location=place)),
    ) == [
        RejectReason.SIGNATURE_INVALID,
        RejectReason.SIGNATURE_INVALID,
        RejectReason.ILL_FORMED,
        RejectReason.NOT_AUTHORISED,
        RejectReason.UNKNOWN_SCENE_OR_SPACE,
        RejectReason.UNKNOWN_SCENE_OR_SPACE,
    ]
    reply = await user.ask(0, GetMany(scene=user.scene.scene, position=1, keys=(RecordKey(SPACE, place),)))
    assert isinstance(reply, GetManyReply) and reply.records == (None,)


async def check_authority_of_names(user: User) -> None:
    answer = SceneLogAnswer(0, 2, 1, user.scene, None)
    assert await user.refusal(0, RespondSceneLog(answer=answer)) == RejectReason.NOT_AUTHORISED
    mini = user.nodes.contexts[1].own.mini()
    assert await user.refusal(0, RequestTable(mini_status=mini)) == RejectReason.NOT_AUTHORISED
    assert await user.refusal(0, PingBroadcast(())) == RejectReason.ILL_FORMED


async def check_tables_and_keys(user: User) -> None:
    table = await user.ask(1, RequestTable())
    assert isinstance(table, RespondTable)
    assert [status.node for status in table.statuses] == [user.node_id(node) for node in range(3)]
    assert table.statuses[-1].right_bound == LAST
    assert all(status.lamport > 0 for status in table.statuses)
    for key in (WRITER.public, user.nodes.profile.members[2].public_key):
        found = await user.ask(0, RequestPublicKey(key=key.key_id))
        assert isinstance(found, RespondPublicKey) and found.answer is not None and found.answer.raw == key.raw
    unknown = await user.ask(0, RequestPublicKey(key=STRANGER.key_id))
    assert isinstance(unknown, RespondPublicKey) and unknown.answer is None


async def check_scenes(user: User) -> None:
    decider = decider_of(user.nodes.profile)
    again = await user.create(user.scene, node=1)
    assert isinstance(again, AcceptSceneProposal), "announcing it again is harmless"
    for bent, reason in (
        (replace(scene_in(user.nodes.profile, private_key=KeyId(9)), signature=bytes(64)), RejectReason.SIGNATURE_INVALID),
        (later_header(scene_in(user.nodes.profile, private_key=KeyId(8))), RejectReason.UNKNOWN_SCENE_OR_SPACE),
        (first_header(origin=NodeId(9)), RejectReason.NOT_AUTHORISED),
        (first_header(WRITER, decider, origin=user.scene.origin), RejectReason.NOT_AUTHORISED),
        (later_header(user.scene, decider=decider, position=3), RejectReason.ILL_FORMED),
        (later_header(user.scene, STRANGER, decider), RejectReason.SIGNATURE_INVALID),
    ):
        rejected = await user.create(bent, node=2)
        assert isinstance(rejected, RejectSceneProposal) and rejected.reason == reason
    later = later_header(user.scene, decider=decider, write_floor=2)
    assert isinstance(await user.create(later), AcceptSceneProposal)
    place = place_in(user.nodes, 2, offset=30)
    await heard_everywhere(user, later)
    assert await user.put(2, offered(sealed(user.scene, location=place))) == [RejectReason.MODE_FORBIDS]
    assert await user.put(2, offered(sealed(later, location=place))) == [0]
    listed = await user.ask(2, ListScenes())
    assert isinstance(listed, ScenesListed) and listed.scenes == (later,)
    number = [member.node_id for member in user.nodes.profile.members].index(user.scene.origin)
    request = RequestSceneLog(scene=user.scene.scene, genesis=user.scene.genesis, have=0, nonce=7, want=Want.LOG)
    log = await user.ask(number, request)
    assert isinstance(log, RespondSceneLog) and log.answer is not None
    assert (log.answer.public, log.answer.private, log.answer.nonce) == (later, LOG, 7)
    stranger = await user.ask(0, replace(request, genesis=bytes(32)))
    assert isinstance(stranger, RespondSceneLog) and stranger.answer is None


async def heard_everywhere(user: User, header: SceneLogPublic) -> None:
    """A push has no answer; but who asks for at least this position gets it."""
    for node in range(3):
        request = RequestSceneLog(scene=header.scene, genesis=b"", have=header.position, nonce=0, want=Want.HEADER)
        reply = await user.ask(node, request)
        assert isinstance(reply, RespondSceneLog) and reply.answer is not None and reply.answer.public == header


async def test_a_scene_that_nobody_made_is_unknown(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 2) as nodes, links_of_user(nodes.profile) as links:
        user = User(nodes, links)
        assert await user.put(0, item_in(nodes, 0)) == [RejectReason.UNKNOWN_SCENE_OR_SPACE]
        unknown = RejectReason.UNKNOWN_SCENE_OR_SPACE
        assert await user.refusal(0, GetMany(scene=SceneId(5), position=0, keys=(RecordKey(SPACE, FIRST),))) == unknown
        assert await user.refusal(0, QueryRange(scene=SceneId(5), space=SPACE, first=FIRST, last=LAST)) == unknown


async def test_a_node_that_was_away_learns_of_the_scene(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 3, start=[0, 1, 2]) as nodes, links_of_user(nodes.profile) as links:
        user = User(nodes, links)
        away = next(node for node in range(3) if user.node_id(node) != user.scene.origin)
        await nodes.stop(away)
        assert isinstance(await user.create(user.scene, node=next(iter(nodes.contexts))), AcceptSceneProposal)
        await nodes.start(away)
        await nodes.joined()  # without a lease it acknowledges nothing
        place = await place_of(nodes, away)
        assert await user.put(away, offered(sealed(user.scene, location=place))) == [0]


async def place_of(nodes: Nodes, node: int) -> Location:
    """In its arc, as another node knows it: who was stopped early may take it only now."""
    routing = next(iter(nodes.contexts.values())).routing
    with trio.fail_after(PATIENCE_S):
        while (arc := routing.arc_of(nodes.profile.members[node].node_id)) is None:  # noqa: ASYNC110 - nobody is told when a table changes
            await trio.sleep(0.1)
    return Location.from_number(arc.first.number + 5)


async def test_a_restarted_node_has_its_records_and_a_new_boot(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 3) as nodes, links_of_user(nodes.profile) as links:
        user = User(nodes, links)
        await user.create(user.scene)
        item = item_in(nodes, 1)
        assert await user.put(1, item) == [0]
        before = nodes.contexts[1].own.signed()
        await nodes.stop(1)
        with pytest.raises(Unreachable):
            await user.put(1, item)
        assert (
            await user.refusal(0, GetMany(scene=user.scene.scene, position=1, keys=(RecordKey(SPACE, item.location),)))
            == RejectReason.NOT_READY
        )
        assert not nodes.contexts[0].roster.is_believed_alive(user.node_id(1)), "who did not answer is suspected"
        await nodes.start(1)
        with trio.fail_after(PATIENCE_S):
            await nodes.contexts[1].joined.wait()
        assert nodes.contexts[1].scenes.all() == [user.scene]
        reply = await user.ask(0, GetMany(scene=user.scene.scene, position=1, keys=(RecordKey(SPACE, item.location),)))
        assert isinstance(reply, GetManyReply) and reply.records[0] is not None
        after = nodes.contexts[1].own.signed()
        assert after.incarnation == before.incarnation and after.boot == before.boot + 1
        assert after.lamport > before.lamport
        assert nodes.contexts[0].roster.is_believed_alive(user.node_id(1))


async def test_another_clusters_authority_counts_for_nothing(tmp_path: Path) -> None:
    async with nodes_here(tmp_path / "ours", 2) as nodes:
        theirs = ClusterProfile.create(tmp_path / "theirs", "theirs", addresses(2), ports=free_ports())
        stranger = real_world(theirs.user_identity(), nodes.profile.authority_certificate(), ports=nodes.profile.ports)
        async with open_links(stranger) as links:
            with pytest.raises(Unreachable):
                await links.request("127.0.0.2", Priority.HIGH, RequestTable(), PATIENCE_S)
        deceived = real_world(nodes.profile.user_identity(), theirs.authority_certificate(), ports=nodes.profile.ports)
        async with open_links(deceived) as links:
            with pytest.raises(Unreachable):
                await links.request("127.0.0.2", Priority.HIGH, RequestTable(), PATIENCE_S)


test_another_clusters_authority_counts_for_nothing = pytest.mark.expect_log(".*")(  # strangers are logged by the world
    test_another_clusters_authority_counts_for_nothing
)
