"""If this fails, an owner of one scene keeps all nodes busy with its changes, or who changes a scene now and then is refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.limits import HEADER_KEYS_MAX, SCENES_PER_USER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.changes import (
    KEYS_BURST,
    KEYS_PER_S,
    OF_MAKER_BURST,
    OF_MAKER_PER_S,
    OF_SCENE_BURST,
    OF_SCENE_PER_S,
    OWN_BURST,
    OWN_PER_S,
    Changes,
)
from scenefold.scene.log import FOR_EVER, succeeded
from scenefold.wire import AcceptSceneProposal, KeyEntry, RejectSceneProposal, SceneLogPublic, Succession, WriterEntry
from unit.peer.scenes_made import HEADER_KEY, STRANGER, WRITER, later_header
from unit.peer.test_scenes import FIRST, LONGER, NODE, USER, Rig, proposal

KNOWN = KnownScene.of(FIRST)


def scene_of(maker: SigningKey, number: int) -> KnownScene:
    """A scene of that maker; only who and which it is counts."""
    public = replace(FIRST, scene=SceneId(number), writers=(WriterEntry(maker.public.key_id, 0, FOR_EVER),))
    return replace(KNOWN, public=public, keys={maker.public.key_id: maker.public})


def is_taken(changes: Changes, scene: KnownScene, now: float, *, epochs: int = 0, owners: int = 0) -> bool:
    """Whether the scene goes on, with so many new key epochs, and so many owners revoked."""
    before = scene.public
    succession = before.succession + (Succession(before.position + 1, bytes(32), bytes(64)),) * owners
    after = replace(before, position=before.position + 1, key_epoch=before.key_epoch + epochs, succession=succession)
    try:
        changes.check(scene, after, now)
    except Refused:
        return False
    changes.count(scene, after, now)
    return True


def taken_of(changes: Changes, scene: KnownScene, now: float, **kind: int) -> int:
    """How often it goes on at that moment, until it is refused."""
    taken = 0
    while is_taken(changes, scene, now, **kind):
        taken += 1
        assert taken <= 2 * OF_MAKER_BURST
    return taken


@given(st.lists(st.tuples(st.floats(0, 0.4), st.booleans()), max_size=300))
def test_no_scene_goes_on_faster_than_the_bound(steps: list[tuple[float, bool]]) -> None:
    changes, now = Changes(), 0.0
    taken: dict[bool, list[float]] = {False: [], True: []}
    for pause, is_of_keys in steps:
        now += pause
        if is_taken(changes, KNOWN, now, epochs=int(is_of_keys)):
            for which in {False, True} if not is_of_keys else {True}:
                taken[which].append(now)
    for of_keys, times in taken.items():
        burst, per_s = (OF_SCENE_BURST + KEYS_BURST, OF_SCENE_PER_S + KEYS_PER_S) if of_keys else (OF_SCENE_BURST, OF_SCENE_PER_S)
        for first, began in enumerate(times):
            for count, at in enumerate(times[first:], 1):
                assert count <= burst + (at - began) * per_s + 1e-6


def test_who_uses_up_one_scene_takes_nothing_from_another_and_who_uses_up_his_takes_nothing_from_other_makers() -> None:
    changes = Changes()
    mine = [scene_of(WRITER, number) for number in range(2, 8)]
    assert taken_of(changes, mine[0], 0.0) == OF_SCENE_BURST
    assert is_taken(changes, mine[1], 0.0)
    rest = 1 + sum(taken_of(changes, scene, 0.0) for scene in mine[1:])
    with_own = 2  # The fifth has its own when nothing of the maker's is left, and the sixth; who used up the scene's has none besides.
    assert OF_SCENE_BURST + rest == OF_MAKER_BURST + with_own * OWN_BURST
    assert is_taken(changes, scene_of(STRANGER, 9), 0.0)
    assert not is_taken(changes, mine[5], 0.0) and is_taken(changes, mine[5], 1.01 / OF_MAKER_PER_S)


def test_owners_of_four_scenes_of_one_maker_do_not_hold_back_the_fifth() -> None:
    changes = Changes()
    theirs, mine = [scene_of(WRITER, number) for number in range(2, 6)], scene_of(WRITER, 9)
    taken = list[float]()
    for tick in range(20 * 300):
        now = tick / 20
        for scene in theirs:
            is_taken(changes, scene, now)
        if now > 80 and is_taken(changes, mine, now):
            taken.append(now)
    assert len(taken) >= OWN_BURST + 220 * OWN_PER_S - 1
    assert taken[0] < 81 and max(later - before for before, later in pairwise(taken)) < 1.1 / OWN_PER_S


def test_an_owner_who_uses_up_the_scene_is_revoked_at_once_and_a_reader_by_a_part_that_is_set_aside() -> None:
    changes = Changes()
    taken_of(changes, KNOWN, 0.0)
    assert taken_of(changes, KNOWN, 0.0, epochs=1) == KEYS_BURST
    assert not is_taken(changes, KNOWN, 0.0) and not is_taken(changes, KNOWN, 0.0, epochs=1)
    assert all(is_taken(changes, KNOWN, 0.0, epochs=1, owners=1) for _ in range(HEADER_KEYS_MAX))
    assert is_taken(changes, KNOWN, 1.01 / OF_SCENE_PER_S), "which takes nothing from the others"
    assert is_taken(changes, KNOWN, 1.01 / KEYS_PER_S, epochs=1)


def test_all_scenes_that_a_maker_can_have_together_are_bounded() -> None:
    changes = Changes()
    taken = sum(taken_of(changes, scene_of(WRITER, 2 + number), 0.0) for number in range(SCENES_PER_USER_MAX))
    assert taken <= OF_MAKER_BURST + SCENES_PER_USER_MAX * OWN_BURST
    assert SCENES_PER_USER_MAX * OWN_PER_S <= OF_MAKER_PER_S


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


async def test_an_owner_who_uses_up_the_scene_is_revoked_by_another_without_waiting(autojump_clock: MockClock) -> None:
    rig = Rig()
    await rig.scenes.on_propose(proposal(FIRST), USER)
    *changed, too_many = headers(OF_SCENE_BURST + 1)
    for header in changed:
        await rig.scenes.on_propose(proposal(header, LONGER), USER)
    assert isinstance(await rig.scenes.on_propose(proposal(too_many, LONGER), USER), RejectSceneProposal)
    last = changed[-1]
    step = succeeded(HEADER_KEY, STRANGER.public, last.genesis, last.position + 1)
    keys = (*last.keys, KeyEntry(1, STRANGER.public.raw))
    revoking = later_header(last, STRANGER, log=LONGER, key_epoch=1, keys=keys, public_key=STRANGER.public.key_id, succession=(step,))
    assert isinstance(await rig.scenes.on_propose(proposal(revoking, LONGER), USER), AcceptSceneProposal)
