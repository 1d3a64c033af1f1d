"""If this fails, an owner of one scene keeps all nodes busy with its changes, or who changes a scene now and then is refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.changes import OF_MAKER_BURST, OF_MAKER_PER_S, OF_SCENE_BURST, OF_SCENE_PER_S, Changes
from scenefold.scene.log import FOR_EVER
from scenefold.wire import AcceptSceneProposal, RejectSceneProposal, SceneLogPublic, WriterEntry
from unit.peer.scenes_made import STRANGER, WRITER, later_header
from unit.peer.test_scenes import FIRST, LONGER, NODE, USER, Rig, proposal

KNOWN = KnownScene.of(FIRST)


def scene_of(maker: SigningKey, number: int) -> KnownScene:
    """A scene of that maker; only who and which it is counts."""
    public = replace(FIRST, scene=SceneId(number), writers=(WriterEntry(maker.public.key_id, 0, FOR_EVER),))
    return replace(KNOWN, public=public, keys={maker.public.key_id: maker.public})


def is_taken(changes: Changes, scene: KnownScene, now: float) -> bool:
    try:
        changes.check(scene, scene.public.position + 1, now)
    except Refused:
        return False
    changes.count(scene, now)
    return True


@given(st.lists(st.floats(0, 40), max_size=300))
def test_no_scene_goes_on_faster_than_the_bound(pauses: list[float]) -> None:
    changes, now, taken = Changes(), 0.0, list[float]()
    for pause in pauses:
        now += pause / 100
        if is_taken(changes, KNOWN, now):
            taken.append(now)
    for first, began in enumerate(taken):
        for count, at in enumerate(taken[first:], 1):
            assert count <= OF_SCENE_BURST + (at - began) * OF_SCENE_PER_S + 1e-6


def test_who_uses_up_one_scene_takes_nothing_from_another_and_who_uses_up_his_takes_nothing_from_other_makers() -> None:
    changes = Changes()
    mine = [scene_of(WRITER, number) for number in range(2, 8)]
    assert sum(is_taken(changes, mine[0], 0.0) for _ in range(1000)) == OF_SCENE_BURST
    assert is_taken(changes, mine[1], 0.0)
    rest = sum(is_taken(changes, scene, 0.0) for scene in mine[1:] for _ in range(1000))
    assert OF_SCENE_BURST + 1 + rest == OF_MAKER_BURST
    assert is_taken(changes, scene_of(STRANGER, 9), 0.0)
    assert not is_taken(changes, mine[5], 0.0) and is_taken(changes, mine[5], 1.01 / OF_MAKER_PER_S)


def headers(count: int) -> Iterable[SceneLogPublic]:
    header = FIRST
    for _ in range(count):
        header = later_header(header, log=LONGER)
        yield header


@pytest.mark.parametrize("peer", [USER, NODE])
async def test_an_owner_that_changes_the_scene_without_end_waits_and_costs_nothing(peer: str, autojump_clock: MockClock) -> None:
    rig = Rig()
    await rig.scenes.on_propose(proposal(FIRST), USER)
    changed = list(headers(OF_SCENE_BURST + 1))
    for header in changed[:-1]:
        assert isinstance(await rig.scenes.on_propose(proposal(header, LONGER), peer), AcceptSceneProposal)
    work, told, written = rig.worked, len(rig.peers.told), len(rig.store.written)
    for _ in range(10):
        refused = await rig.scenes.on_propose(proposal(changed[-1], LONGER), peer)
        assert isinstance(refused, RejectSceneProposal) and refused.reason is RejectReason.BUSY
    assert (rig.worked, len(rig.peers.told), len(rig.store.written)) == (work, told, written)
    again = await rig.scenes.on_propose(proposal(changed[-2], LONGER), peer)
    assert isinstance(again, AcceptSceneProposal), "whose answer was lost hears that it was decided"
    await trio.sleep(1.01 / OF_SCENE_PER_S)
    assert isinstance(await rig.scenes.on_propose(proposal(changed[-1], LONGER), peer), AcceptSceneProposal)


async def test_many_proposals_at_once_are_no_way_round_the_bound(autojump_clock: MockClock) -> None:
    rig = Rig()
    await rig.scenes.on_propose(proposal(FIRST), USER)
    changed = list(headers(OF_SCENE_BURST + 1))
    for header in changed[:-2]:
        await rig.scenes.on_propose(proposal(header, LONGER), USER)
    accepted = list[bool]()

    async def propose(header: SceneLogPublic) -> None:
        accepted.append(isinstance(await rig.scenes.on_propose(proposal(header, LONGER), USER), AcceptSceneProposal))

    async with trio.open_nursery() as nursery:
        for header in changed[-2:]:
            nursery.start_soon(propose, header)
            nursery.start_soon(propose, header)
    assert rig.scenes.all() == [changed[-2]], "the last one that the bound lets in"
    assert accepted.count(True) == 2, "one of them, and the same again"
