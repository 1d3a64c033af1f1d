"""If this fails, a change of a scene that somebody repeats, because nobody knew what became of it, is made twice, or one is taken for another."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused, Unreachable, UsageFault
from scenefold.base.ids import node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import InDoubt, Request
from scenefold.client.modes import set_mode
from scenefold.client.scene import Scene
from scenefold.client.scene_log import Standing
from scenefold.peer.scene_log.proposals import rejection
from scenefold.wire import Packet, ProposeSceneLog, RejectSceneProposal, Role, SceneMode
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_grants import card_of
from unit.client.test_modes import Lenders
from unit.client.test_participants import STEP, hall_of, proposals, saying, where
from unit.client.test_spaces import BOX

A, B, C, D, E = FIVE
Change = Callable[[Scene, Request | None], Awaitable[object]]


async def translate(scene: Scene, again: Request | None) -> object:
    return await (await scene.space_named("hall")).translate(STEP, again=again)


async def lost(council: FakeCouncil, scene: Scene, change: Change = translate) -> tuple[Request, ProposeSceneLog]:
    """A change of which nobody knows what became of it: its request, and what was proposed, which may still come."""
    late: list[ProposeSceneLog] = []

    def unknown(address: str, packet: ProposeSceneLog) -> Packet:
        late.append(packet)
        return rejection(RejectReason.NOT_READY, node_id_of(address))

    council.answers = dict.fromkeys(FIVE, unknown)
    with pytest.raises(InDoubt) as told:
        await change(scene, None)
    council.answers.clear()
    assert f"scene status kitchen {told.value.request}`" in told.value.remedy
    return told.value.request, late[0]


async def elsewhere(council: FakeCouncil, folder: Path) -> Scene:
    """The scene, in another process of its owner."""
    return await council.scenes(Keyring(folder)).open("kitchen")


async def attic(scene: Scene) -> object:
    return await scene.create_space("attic", BOX)


async def test_what_came_in_meanwhile_is_not_done_again(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, packet = await lost(council, scene)
    council.propose(B, packet)
    await attic(scene)
    council.asked.clear()
    other = await elsewhere(council, tmp_path)
    for _ in range(2):
        assert await translate(other, request) == await hall.info()
    assert proposals(council) == [] and (await where(hall), council.newest(scene.id).position) == (1.0, 4)
    assert await other.standing(request.id, request.offered_at) == Standing(3, True, 4)


@pytest.mark.parametrize("is_taken", [True, False])
async def test_what_never_came_is_done_once(autojump_clock: MockClock, tmp_path: Path, is_taken: bool) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, packet = await lost(council, scene)
    if is_taken:
        await attic(scene)
    position = 4 if is_taken else 3
    for _ in range(2):
        await translate(await elsewhere(council, tmp_path), request)
    assert (await where(hall), council.newest(scene.id).position) == (1.0, position)
    assert isinstance(council.propose(A, packet), RejectSceneProposal), "what comes late has its position taken"
    assert (await where(hall), (await scene.standing(request.id)).position) == (1.0, position)


async def test_what_comes_in_while_it_is_repeated_is_found(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, late = await lost(council, scene)

    def first(address: str, packet: ProposeSceneLog) -> Packet:
        council.answers.clear()
        council.propose(address, late)
        return council.propose(address, packet)

    council.answers = dict.fromkeys(FIVE, first)
    await translate(await elsewhere(council, tmp_path), request)
    assert (await where(hall), council.newest(scene.id).position) == (1.0, 3)


async def test_as_long_as_the_first_one_may_come_nobody_is_told_that_the_second_was_refused(
    autojump_clock: MockClock, tmp_path: Path
) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, packet = await lost(council, scene)
    council.answers = dict.fromkeys(FIVE, saying(RejectReason.NO_MAJORITY))
    other = await elsewhere(council, tmp_path)
    with pytest.raises(InDoubt, match=r"may have happened.*no majority") as told:
        await translate(other, request)
    assert told.value.request == request
    council.away = set(FIVE)
    with pytest.raises(InDoubt, match="may have happened") as told:
        await hall.translate(STEP, again=request)
    assert told.value.request == request
    council.away, council.answers = set(), {}
    await attic(scene)
    council.answers = dict.fromkeys(FIVE, saying(RejectReason.NO_MAJORITY))
    with pytest.raises(Refused, match="no majority"):
        await translate(other, request)
    council.answers.clear()
    assert isinstance(council.propose(A, packet), RejectSceneProposal) and await where(hall) == 0.0


async def test_who_repeats_it_in_doubt_is_told_where_it_was_offered_last(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    first, _ = await lost(council, scene)
    await attic(scene)
    second, packet = await lost(council, scene, lambda scene, _: translate(scene, first))
    assert second == replace(first, offered_at=4) and packet.public.position == 4


@pytest.mark.parametrize(
    "other",
    [
        lambda hall, _, request: hall.translate((2.0, 0.0, 0.0), again=request),
        lambda hall, _, request: hall.scale(2.0, again=request),
        lambda hall, _, request: hall.set_copies(2, again=request),
        lambda _, scene, request: scene.create_space("cellar", BOX, again=request),
        lambda _, scene, request: scene.create_space("hall", BOX, again=request),
        lambda _, scene, request: scene.rotate_key(again=request),
        lambda _, scene, request: scene.revoke("user:nobody", again=request),
        lambda _, scene, request: scene.end(again=request),
        lambda _, scene, request: scene.change_render_settings(partial(replace, samples=16), again=request),
        lambda _, scene, request: scene.change_render_settings(lambda before: before, again=request),
        lambda _, scene, request: set_mode(scene.access, SceneMode.RENDER, again=request),
    ],
)
async def test_the_request_of_another_change_is_an_error_and_nothing_is_done(
    autojump_clock: MockClock, tmp_path: Path, other: Callable[..., Awaitable[object]]
) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, packet = await lost(council, scene)
    council.propose(B, packet)
    with pytest.raises(LocalFault, match="that of another change, which is in the log at position 3") as told:
        await other(hall, scene, request)
    assert "nothing was done now" in told.value.remedy and told.value.where == "scene kitchen"
    assert council.newest(scene.id).position == 3


async def test_a_request_that_the_log_would_not_know_any_more_is_refused(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenefold.scene.log.book.LOG_REQUESTS_KEPT", 2)
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, packet = await lost(council, scene)
    council.propose(B, packet)
    for name in ("attic", "cellar"):
        await scene.create_space(name, BOX)
    with pytest.raises(
        Refused, match=r"so much was decided since position 3.*make the change without the request if it is missing"
    ) as told:
        await translate(await elsewhere(council, tmp_path), request)
    assert told.value.reason is RejectReason.POSITION_BEHIND and (await where(hall), council.newest(scene.id).position) == (1.0, 5)


async def test_a_request_whose_change_is_in_a_snapshot_by_now_is_neither_done_again_nor_called_the_same(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenefold.scene.log.shortening.LOG_TAIL_RECORDS_MAX", 4)
    monkeypatch.setattr("scenefold.scene.log.shortening.LOG_TAIL_RECORDS_KEPT", 2)
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, packet = await lost(council, scene)
    council.propose(B, packet)
    await attic(scene)
    await translate(scene, request)
    for name in ("cellar", "yard", "well"):
        await scene.create_space(name, BOX)
    for told in (scene, await elsewhere(council, tmp_path)):
        with pytest.raises(Refused, match="in the log, at position 3, so long ago that nobody can tell which change it was"):
            await translate(told, request)
    newest, _ = await lost(council, scene)
    await scene.create_space("gate", BOX)
    await translate(scene, newest)
    await translate(scene, newest)
    assert await where(hall) == 2.0, "what lies behind the snapshot is compared with what was then"


async def test_where_it_was_offered_must_be_said(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    with pytest.raises(UsageFault, match="where the request was offered is not said"):
        await hall.translate(STEP, again=Request(b"a new request id"))
    assert await where(hall) == 0.0


async def copies(scene: Scene, again: Request | None) -> object:
    return await (await scene.space_named("hall")).set_copies(4, again=again)


CHANGES: dict[str, Change] = {
    "grant": lambda scene, again: scene.grant(card_of(3), Role.WRITER, again=again),
    "revoke": lambda scene, again: scene.revoke("user:ada", again=again),
    "rotate": lambda scene, again: scene.rotate_key(again=again),
    "create": lambda scene, again: scene.create_space("attic", BOX, copies=2, again=again),
    "copies": copies,
    "settings": lambda scene, again: scene.change_render_settings(partial(replace, samples=16), again=again),
    "mode": lambda scene, again: set_mode(scene.access, SceneMode.RENDER, again=again),
    "end": lambda scene, again: scene.end(again=again),
}


@pytest.mark.parametrize("name", CHANGES)
async def test_each_change_can_be_repeated(autojump_clock: MockClock, tmp_path: Path, name: str) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    await scene.grant(card_of(2), Role.READER)
    change = CHANGES[name]
    request, packet = await lost(council, scene, change)
    council.propose(B, packet)
    position = council.newest(scene.id).position
    found = await change(await elsewhere(council, tmp_path), request)
    assert council.newest(scene.id).position == position == request.offered_at
    if name == "end":
        assert not getattr(found, "was_ended", True), "it was by this very change"
    if name == "mode":
        decided: list[int] = []
        await set_mode(scene.access, SceneMode.RENDER, decided.append, again=request)
        assert decided == [position]


async def test_a_switch_that_was_switched_back_is_not_made_once_more(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    request, packet = await lost(council, scene, CHANGES["mode"])
    council.propose(B, packet)
    await set_mode(scene.access, SceneMode.EDIT)
    position, decided = council.newest(scene.id).position, list[int]()
    with pytest.raises(Refused, match=f"the scene was switched to edit mode since: so it is at position {position} "):
        await set_mode((await elsewhere(council, tmp_path)).access, SceneMode.RENDER, decided.append, again=request)
    assert (decided, council.newest(scene.id).position) == ([request.offered_at], position)


@pytest.mark.parametrize("joins", [True, False])
@pytest.mark.parametrize("observes", [True, False])
async def test_who_takes_part_is_changed_once(autojump_clock: MockClock, tmp_path: Path, joins: bool, observes: bool) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    await scene.add_observer(council.entry(node_id_of(E)))

    def change(scene: Scene, again: Request | None) -> Awaitable[object]:
        entry = council.entry(node_id_of(D))
        if joins:
            return scene.add_observer(entry, again=again) if observes else scene.add_participants([entry], again=again)
        if observes:
            return scene.remove_observer(node_id_of(E), again=again)
        return scene.remove_participant(node_id_of(A), again=again)

    request, packet = await lost(council, scene, change)
    council.propose(B, packet)
    assert await change(await elsewhere(council, tmp_path), request) == await scene.deciders()
    assert council.newest(scene.id).position == request.offered_at


async def test_what_is_so_already_is_not_decided_for_a_request_that_never_came(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, hall = await hall_of(council, tmp_path)
    request, _ = await lost(council, scene, lambda *_: hall.set_copies(2))
    await hall.set_copies(2)
    position = council.newest(scene.id).position
    assert (await hall.set_copies(2, again=request)).copies == 2
    already: list[int | None] = []
    await set_mode(scene.access, SceneMode.EDIT, so_already=already.append, again=request)
    await scene.change_render_settings(lambda before: before, again=request)
    assert council.newest(scene.id).position == position and already == [1]


async def test_a_scene_that_another_change_has_ended_is_said_to_have_been(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    request, _ = await lost(council, scene, lambda scene, _: scene.end())
    await scene.end()
    assert (await (await elsewhere(council, tmp_path)).end(again=request)).was_ended


async def test_where_the_origin_decides_alone_it_is_the_same(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path, 0)

    def dies(address: str, packet: ProposeSceneLog) -> Packet:
        raise Unreachable("no answer in time", where=address)

    council.answers = dict.fromkeys(FIVE, dies)
    with trio.fail_after(600), pytest.raises(InDoubt) as told:
        await translate(scene, None)
    council.answers.clear()
    for _ in range(2):
        await translate(await elsewhere(council, tmp_path), told.value.request)
    assert (await where(hall), council.headers[scene.id].position) == (1.0, 3)
    with pytest.raises(LocalFault, match="another change"):
        await scene.create_space("attic", BOX, again=told.value.request)
