"""If this fails, owners cannot say which nodes observe a scene, or are not told who keeps its mode from being changed."""

from __future__ import annotations

from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client.modes import set_mode
from scenefold.client.relieving import Relieved, relieve
from scenefold.peer.scene_log.proposals import rejection
from scenefold.wire import Packet, ProposeSceneLog, RejectSceneProposal, SceneMode
from unit.client.fake_council import FIVE, FakeCouncil, taking_part
from unit.client.test_modes import Lenders
from unit.client.test_participants import hall_of, proposals
from unit.client.test_relieving import cluster_of
from unit.scene.log.council import node

A, B, C, D, E = FIVE


async def test_a_node_observes_and_does_so_no_more(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    one = council.entry(node_id_of(E))
    found = await scene.add_observer(one)
    assert list(found.observers) == taking_part(E) and found.majority == 2 and found.document()["observers"] == [E]
    assert council.newest(scene.id).observers == (one,)
    with pytest.raises(LocalFault, match="observes the scene already"):
        await scene.add_observer(one)
    with pytest.raises(LocalFault, match=f"before it lost its disk.*remove-observer kitchen {E}"):
        await scene.add_observer(node(node_id_of(E), 1))
    with pytest.raises(LocalFault, match=f"decides the scene's log.*remove-participant kitchen {A}"):
        await scene.add_observer(council.entry(node_id_of(A)))
    with pytest.raises(LocalFault, match=f"as an observer.*remove-observer kitchen {E}"):
        await scene.add_participants([one])
    with pytest.raises(LocalFault, match=f"does not observe the scene.*{D}"):
        await scene.remove_observer(node_id_of(D))
    assert (await scene.remove_observer(node_id_of(E))).observers == ()
    assert council.newest(scene.id).observers == ()


async def test_where_nobody_holds_leases_nobody_observes(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path, participants=0)
    with pytest.raises(LocalFault, match=r"no participants.*add-participant kitchen"):
        await scene.add_observer(council.entry(node_id_of(E)))


async def test_who_is_relieved_observes_no_more(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    cluster = cluster_of(council, tmp_path)
    scene = await cluster.scenes.create("kitchen", participants=taking_part(A, B, C))
    await scene.add_observer(council.entry(node_id_of(E)))
    expected = [Relieved(scene.id, "kitchen")]
    assert await relieve(cluster, node_id_of(E), dry_run=True) == expected
    assert council.newest(scene.id).observers, "nothing was changed"
    assert await relieve(cluster, node_id_of(E)) == expected
    assert not council.newest(scene.id).observers and await relieve(cluster, node_id_of(E)) == []


@pytest.mark.parametrize(("missing", "part"), [(B, "a participant"), (E, "an observer")])
async def test_who_does_not_answer_is_named_with_his_last_sign(autojump_clock: MockClock, tmp_path: Path, missing: str, part: str) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    await scene.add_observer(council.entry(node_id_of(E)))

    def missed(address: str, packet: ProposeSceneLog) -> Packet:
        return RejectSceneProposal(RejectReason.PEER_MISSED, node_id_of(missing), 4_200)

    council.answers = dict.fromkeys(FIVE, missed)
    with pytest.raises(Refused) as told:
        await set_mode(scene.access, SceneMode.RENDER)
    assert told.value.reason is RejectReason.PEER_MISSED
    text = str(told.value)
    assert f"{missing}, {part} of the scene" in text and "4.2 s ago" in text and "--force" in text
    assert f"remove-{part.split()[1]} kitchen {missing}" in text


async def test_a_participant_that_is_busy_is_said_to_have_lent_a_lease_and_what_helps(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    council.answers = dict.fromkeys(FIVE, lambda *_: rejection(RejectReason.BUSY, node_id_of(FIVE[1])))
    with pytest.raises(Refused, match=r"somebody edits the scene, by a lease that a node has lent.*scene mode kitchen render --force"):
        await set_mode(scene.access, SceneMode.RENDER)
    with pytest.raises(Refused, match="has too much to do, or something under way") as told:
        await scene.add_observer(council.entry(node_id_of(E)))
    assert "--force" not in str(told.value)


async def test_a_render_of_an_observer_is_named(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    await scene.add_observer(council.entry(node_id_of(E)))
    council.answers = dict.fromkeys(FIVE, lambda *_: rejection(RejectReason.BUSY, node_id_of(E)))
    with pytest.raises(Refused, match=f"an observer of the scene, {E}, is reading it.*--force"):
        await set_mode(scene.access, SceneMode.RENDER)


@pytest.mark.parametrize(
    ("reason", "by", "words"),
    [
        (RejectReason.BUSY, A, "somebody edits the scene"),
        (RejectReason.BUSY, E, "is reading it for an image"),
        (RejectReason.PEER_MISSED, B, "does not answer"),
    ],
)
async def test_who_ends_a_scene_is_advised_nothing_that_cannot_be(
    autojump_clock: MockClock, tmp_path: Path, reason: RejectReason, by: str, words: str
) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    await scene.add_observer(council.entry(node_id_of(E)))
    council.answers = dict.fromkeys(FIVE, lambda *_: rejection(reason, node_id_of(by)))
    with pytest.raises(Refused, match=words) as told:
        await scene.end()
    assert "force" not in str(told.value) and "ended --" not in str(told.value) and "repeat" in told.value.remedy


async def test_force_is_asked_for_with_the_change_alone(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, hall = await hall_of(council, tmp_path)
    await set_mode(scene.access, SceneMode.RENDER)
    assert not any(packet.forced for _, packet in proposals(council))
    shown = await set_mode(scene.access, SceneMode.EDIT, force=True)
    assert shown.is_active and [packet.forced for _, packet in proposals(council)][-1]
    await hall.translate((1.0, 0.0, 0.0))
    assert not [packet.forced for _, packet in proposals(council)][-1]


def test_nobody_is_named_who_is_not_known() -> None:
    assert RejectSceneProposal(RejectReason.PEER_MISSED, NodeId(0)).silent_ms == 0
