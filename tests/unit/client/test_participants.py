"""If this fails, a scene that participants decide cannot be read or changed while one of them is away, or its author is told what is not so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, PeerFault, Refused, Unreachable, UsageFault
from scenefold.base.ids import node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.client.space import Space
from scenefold.peer.scene_log.proposals import accepted, rejection
from scenefold.wire import Packet, ProposeSceneLog, RequestSceneLog, RequestTable, RespondTable, Status, Want
from scenefold.world import Priority
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil, in_doubt, taking_part
from unit.client.test_spaces import BOX

A, B, C, D, E = FIVE
STEP = (1.0, 0.0, 0.0)


async def hall_of(council: FakeCouncil, folder: Path, participants: int = 3) -> tuple[Scene, Space]:
    scene = await council.scenes(Keyring(folder)).create("kitchen", participants=participants)
    return scene, await scene.create_space("hall", BOX)


async def where(hall: Space) -> float:
    return (await hall.info()).transform.offset[0]


def saying(reason: RejectReason) -> Callable[[str, ProposeSceneLog], Packet]:
    return lambda address, _: rejection(reason, node_id_of(address))


def proposals(council: FakeCouncil) -> list[tuple[str, ProposeSceneLog]]:
    return [(address, packet) for address, packet in council.asked if isinstance(packet, ProposeSceneLog)]


# ------------------------------------------------------------------------------------------------------- who decides


async def test_a_scene_is_made_with_trusted_nodes_that_decide_it(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil(trusted=(A, C, D, E))
    scene, hall = await hall_of(council, tmp_path)
    header = council.newest(scene.id)
    assert [entry.member.node for entry in header.participants] == taking_part(A, C, D), "the first voter, then in the order of the line"
    assert header.position == 2 and header.decision is not None and header.decision.form == 2
    await hall.translate(STEP)
    assert await where(hall) == 1.0
    assert [address for address, _ in proposals(council)] == [A, C, C], "the origin, and then the one in the middle, as all authors do"
    alone = await council.scenes(Keyring(tmp_path)).create("hall", participants=0)
    assert council.newest(alone.id).participants == ()


@pytest.mark.parametrize(("trusted", "decide"), [(FIVE, FIVE), ((A, B, C, E), (A, B, C)), ((A, B), ()), ((A,), ())])
async def test_as_many_as_are_trusted_an_odd_number(
    autojump_clock: MockClock, tmp_path: Path, trusted: tuple[str, ...], decide: tuple[str, ...]
) -> None:
    council = FakeCouncil(trusted=trusted)
    scene = await council.scenes(Keyring(tmp_path)).create("kitchen", participants=None)
    assert [entry.member.node for entry in council.newest(scene.id).participants] == taking_part(*decide)


async def test_who_is_there_decides_before_who_is_silent(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil(away={B, C})
    scenes = council.scenes(Keyring(tmp_path))
    scene = await scenes.create("kitchen", participants=3)
    assert [entry.member.node for entry in council.newest(scene.id).participants] == taking_part(A, D, E)
    scene = await scenes.create("hall", participants=None)
    assert [entry.member.node for entry in council.newest(scene.id).participants] == taking_part(*FIVE), "a majority is there"


async def test_nobody_is_to_decide_with_those_who_are_gone(autojump_clock: MockClock, tmp_path: Path) -> None:
    """Nothing could be changed any more: so it is refused before anything happens."""
    council = FakeCouncil()
    scenes = council.scenes(Keyring(tmp_path))
    alone = await scenes.create("origins", participants=0)
    pair = await scenes.create("pair", participants=taking_part(A, B, C))
    council.away = {C, D, E}
    few = rf"of the 3 nodes that are to decide the scene's log 2 must agree, and 1 of them answers \(scene \w+; silent: {D}, {E}\): start those"
    with pytest.raises(Refused, match=few) as refused:
        await scenes.create("kitchen", participants=taking_part(A, D, E))
    assert refused.value.reason is RejectReason.NO_MAJORITY
    assert sorted(one.name or "" for one in await scenes.list()) == ["origins", "pair"], "no key of it was made"
    with pytest.raises(Refused, match=r"of the 5 nodes .* 3 must agree, and 2 of them answer"):
        await scenes.create("kitchen", participants=5)
    with pytest.raises(Refused, match=few):
        await alone.add_participants([council.entry(node) for node in taking_part(A, D, E)])
    with pytest.raises(Refused, match=rf"of the 4 nodes .* 3 must agree, and 2 of them answer .*silent: {C}, {D}"):
        await pair.add_participants([council.entry(*taking_part(D))])
    with pytest.raises(Refused, match=rf"of the 2 nodes .* 2 must agree, and 1 of them answers .*silent: {C}"):
        await pair.remove_participant(*taking_part(B))
    await pair.remove_participant(*taking_part(C))
    assert [entry.member.node for entry in council.newest(pair.id).participants] == taking_part(A, B)


class SlowCouncil(FakeCouncil):
    """Who is away says nothing for as long as he is waited for."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address in self.away:
            await trio.sleep(timeout)
        return await super().request(address, priority, packet, timeout)


class WipedCouncil(FakeCouncil):
    """Some nodes answer in another life than the one that they are registered in."""

    wiped: ClassVar[frozenset[str]] = frozenset()

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address in self.wiped and isinstance(packet, RequestTable):
            return RespondTable((Status(1, node_id_of(address), b"w" * 16, 1, address, None, None),))
        return await super().request(address, priority, packet, timeout)


async def test_who_is_silent_holds_up_nobody_for_long(autojump_clock: MockClock, tmp_path: Path) -> None:
    many = tuple(f"127.0.0.{number}" for number in range(2, 102))
    council = SlowCouncil(addresses=many, trusted=many)
    scenes = council.scenes(Keyring(tmp_path))
    council.away = {B}
    began = trio.current_time()
    await scenes.create("kitchen", participants=5)
    assert trio.current_time() - began < 3.0, "a majority has answered at once"
    council.away = set(many) - {A}
    began = trio.current_time()
    with pytest.raises(Refused, match=r"of the 7 nodes .* 4 must agree, and 1 of them answers"):
        await scenes.create("hall", participants=None)
    assert trio.current_time() - began < 15.0


async def test_who_lost_its_disk_is_not_there_for_the_scene(autojump_clock: MockClock, tmp_path: Path) -> None:
    """It answers, in another life; to count it would leave a scene that nobody can change."""
    council = WipedCouncil()
    scene = await council.scenes(Keyring(tmp_path)).create("kitchen", participants=taking_part(A, B, C))
    council.wiped = frozenset({C})  # type: ignore[misc]
    with pytest.raises(Refused, match=rf"of the 2 nodes .* 2 must agree, and 1 of them answers .*silent: {C}"):
        await scene.remove_participant(*taking_part(B))
    await scene.remove_participant(*taking_part(C))


async def test_nobody_decides_who_is_not_trusted(autojump_clock: MockClock, tmp_path: Path) -> None:
    scenes = FakeCouncil(trusted=(A, B)).scenes(Keyring(tmp_path))
    with pytest.raises(LocalFault, match=rf"not trusted: it stores.*\({C}\).*cluster trust {C}"):
        await scenes.create("kitchen", participants=taking_part(A, B, C))
    with pytest.raises(LocalFault, match=rf"3 participants are asked for, and the cluster trusts 2 nodes.*not trusted: {C}, .*trust {C}"):
        await scenes.create("kitchen", participants=3)
    alone = FakeCouncil(addresses=(A,), trusted=(A,)).scenes(Keyring(tmp_path))
    with pytest.raises(
        LocalFault, match=r"trusts 1 node .*all nodes that have joined are trusted.*start the others and wait until they have joined"
    ):
        await alone.create("kitchen", participants=3)
    with pytest.raises(LocalFault, match=r"no node of this cluster has this address \(127.0.0.99\)"):
        await scenes.create("kitchen", participants=taking_part(A, "127.0.0.99"))
    with pytest.raises(UsageFault, match=f"{B} is named twice"):
        await scenes.create("kitchen", participants=taking_part(A, B, B))
    with pytest.raises(UsageFault, match="0 to 33 participants"):
        await scenes.create("kitchen", participants=34)
    assert Keyring(tmp_path).names() == [], "nothing was begun"


async def test_a_creation_that_was_lost_is_found_whoever_was_to_decide(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    council.answers[A] = in_doubt(council, done=True)
    made = await council.scenes(Keyring(tmp_path)).create("kitchen", participants=3)
    assert len(council.newest(made.id).participants) == 3
    other = FakeCouncil()
    other.lost_replies = 1
    begun = await other.scenes(Keyring(tmp_path / "other")).create("kitchen", participants=5)
    assert len(other.newest(begun.id).participants) == 5


# ------------------------------------------------------------------------------------------------------- reading


async def test_the_newest_log_counts_of_those_that_answer(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path, 5)
    council.deaf = {A, B}
    await hall.translate(STEP)
    assert council.has[B, scene.id][0].position < council.newest(scene.id).position == 3
    reader = await council.scenes(Keyring(tmp_path)).open("kitchen")
    council.away = {D, E}
    assert await where(await reader.space_named("hall")) == 1.0
    council.away = {A, C, D, E}
    with pytest.raises(Unreachable, match="answers and has the newest"):
        await where(hall)
    council.away = {A, C, D}
    council.has[E, scene.id] = council.has[B, scene.id]
    with pytest.raises(Unreachable, match="answers and has the newest"):
        await where(hall)


async def test_who_has_just_begun_to_take_part_is_waited_for(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil(without_log={A, B, C})

    async def get_it() -> None:
        await trio.sleep(3.0)
        council.without_log.clear()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(get_it)
        _, hall = await hall_of(council, tmp_path)
    assert await where(hall) == 0.0
    council.without_log = {A, B, C}
    with pytest.raises(Refused, match="does not have the scene's log yet"):
        await (await council.scenes(Keyring(tmp_path)).open("kitchen")).spaces()


async def test_without_participants_nothing_is_read_and_they_are_named(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    council.away = {A, B, C}
    with pytest.raises(
        Unreachable, match=f"none of the nodes that decide the scene's log answers and has the newest.*{A}, {B}, {C}.*start one of these"
    ):
        await where(hall)


async def test_a_log_that_does_not_verify_is_that_of_one_node(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    header, private = council.has[A, scene.id]
    council.has[A, scene.id] = header, private[:-1] + bytes((private[-1] ^ 1,))
    reader = await council.scenes(Keyring(tmp_path)).open("kitchen")
    assert len([space for space in await reader.spaces() if space.name == "hall"]) == 1
    for address in (B, C):
        council.has[address, scene.id] = council.has[A, scene.id]
    with pytest.raises(PeerFault, match="not the one that its header names"):
        await (await council.scenes(Keyring(tmp_path)).open("kitchen")).spaces()


async def test_who_decides_may_be_others_by_now(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    other = await council.scenes(Keyring(tmp_path)).open("kitchen")
    for node in taking_part(D, E):
        await other.add_participants([council.entry(node)])
    await other.remove_participant(node_id_of(A))
    council.away = {A, B, C}
    council.has = {key: value for key, value in council.has.items() if key[0] != A}
    assert await where(hall) == 0.0, "the new ones are found"


# ------------------------------------------------------------------------------------------------------- deciding


async def test_a_change_is_decided_though_one_is_away(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    council.away = {A}
    await hall.translate(STEP)
    council.away = {B}
    council.hung = {A}
    council.has[A, hall._access.identity.scene] = council.has[C, hall._access.identity.scene]
    council.hung.clear()
    await hall.translate(STEP)
    assert await where(hall) == 2.0


async def test_without_a_majority_it_is_refused_in_words_and_in_time(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path, 5)
    council.away = {C, D, E}
    began = autojump_clock.current_time()
    with pytest.raises(Refused, match=r"no majority .* 3 of 5 must agree.*127.0.0.2, .*127.0.0.6.*nothing was changed") as refused:
        await hall.translate(STEP)
    assert refused.value.reason is RejectReason.NO_MAJORITY
    assert autojump_clock.current_time() - began < 20.0
    assert council.newest(scene.id).position == 2
    council.away.clear()
    assert await where(hall) == 0.0


async def test_who_sees_no_majority_speaks_for_nobody_else(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    for reason in (RejectReason.NO_MAJORITY, RejectReason.NOT_AUTHORISED, RejectReason.BUSY, RejectReason.STORAGE_FULL):
        council.answers = {A: saying(reason)}
        await hall.translate(STEP)
    assert await where(hall) == 4.0


@pytest.mark.parametrize("reason", [RejectReason.BUSY, RejectReason.NOT_READY])
async def test_who_is_cut_off_outvoices_nobody_who_may_have_a_majority(
    autojump_clock: MockClock, tmp_path: Path, reason: RejectReason
) -> None:
    """What those say passes, so they are asked again: about a change, and about what became of one."""
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)

    def for_now(address: str, _: ProposeSceneLog) -> Packet:
        council.answers.pop(address)
        return rejection(reason, node_id_of(address))

    council.answers = {A: saying(RejectReason.NO_MAJORITY), B: for_now, C: for_now}
    await hall.translate(STEP)
    assert (await where(hall), council.newest(scene.id).position) == (1.0, 3)
    council.answers = {A: saying(RejectReason.NO_MAJORITY), B: for_now, C: for_now}
    assert (await scene.standing(bytes(16), 9)).document()["outcome"] == "open"
    council.answers = {A: saying(RejectReason.NO_MAJORITY), B: saying(reason), C: saying(reason)}
    with pytest.raises(Unreachable) as told:
        await scene.standing(bytes(16), 9)
    assert isinstance(told.value.__cause__, Refused) and told.value.__cause__.reason is reason


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        (
            RejectReason.NOT_AUTHORISED,
            "you own the scene no more, or it takes part no more.*scene access kitchen.*scene participants kitchen",
        ),
        (RejectReason.BUSY, "not now.*try again"),
        (RejectReason.NO_MAJORITY, "no majority.*start those"),
        (RejectReason.MODE_FORBIDS, "mode forbids it"),
        (RejectReason.LIMIT_EXCEEDED, "too long for this"),
        (RejectReason.SIGNATURE_INVALID, "refused it: signature invalid"),
    ],
)
async def test_what_all_refuse_is_refused_with_the_reason_and_by_whom(
    autojump_clock: MockClock, tmp_path: Path, reason: RejectReason, words: str
) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    council.answers = dict.fromkeys((A, B, C), saying(reason))
    with pytest.raises(Refused, match=words) as refused:
        await hall.translate(STEP)
    assert refused.value.reason is reason and "says 127.0.0." in str(refused.value)
    council.answers.clear()
    assert await where(hall) == 0.0


@pytest.mark.parametrize("done", [True, False])
async def test_unknown_is_asked_again_with_the_very_same_header(autojump_clock: MockClock, tmp_path: Path, done: bool) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    for address in (A, B):
        council.answers[address] = in_doubt(council, done=done and address == A)
    await hall.translate(STEP)
    offered = [packet.public for _, packet in proposals(council) if packet.public.position == 3]
    assert len(offered) >= 2 and set(offered) == {offered[0]}
    assert (await where(hall), council.newest(scene.id).position) == (1.0, 3)


async def test_unknown_is_never_told_as_refused(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    late: list[ProposeSceneLog] = []

    def unknown(address: str, packet: ProposeSceneLog) -> Packet:
        late.append(packet)
        return rejection(RejectReason.NOT_READY if len(late) == 1 else RejectReason.NO_MAJORITY, node_id_of(address))

    council.answers = dict.fromkeys((A, B, C), unknown)
    with pytest.raises(Unreachable, match=r"may have happened.*scene status kitchen [0-9a-f]{32}@3` tells"):
        await hall.translate(STEP)
    council.answers.clear()
    council.propose(A, late[0])
    assert (await where(hall), council.newest(scene.id).position) == (1.0, 3)


async def test_proposals_go_from_the_middle_outwards_and_who_was_silent_is_asked_last(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path, participants=5)
    council.asked.clear()
    await hall.translate(STEP)
    council.away = {C, B}
    await hall.translate(STEP)
    assert [address for address, _ in proposals(council)] == [C, D], "who does not even show a header is not asked first"
    council.away.clear()
    council.tell(*council.has[D, scene.id])
    council.asked.clear()
    await hall.translate(STEP)
    assert proposals(council)[0][0] == D


async def test_who_is_overtaken_makes_it_anew_from_the_newer_log(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    other = await council.scenes(Keyring(tmp_path)).open("kitchen")
    others = dict(council.has), dict(council.headers)
    await other.create_space("attic", BOX)
    after = dict(council.has), dict(council.headers)
    council.has, council.headers = others

    def overtaken(address: str, packet: ProposeSceneLog) -> Packet:
        council.answers.clear()
        council.has, council.headers = after
        return rejection(RejectReason.POSITION_TAKEN, node_id_of(address))

    council.answers[B] = overtaken
    cellar = await scene.create_space("cellar", BOX)
    assert council.newest(scene.id).position == 4
    assert {space.name for space in await scene.spaces()} >= {"hall", "attic", "cellar"}
    assert cellar.id not in {(await scene.space_named(name)).id for name in ("hall", "attic")}


async def test_an_answer_without_a_decision_of_this_very_header_is_none(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    before = council.newest(scene.id)

    def lying(_address: str, packet: ProposeSceneLog) -> Packet:
        answer = accepted(before)
        return replace(answer, position=packet.public.position, record_hash=packet.public.log_hash)

    council.answers[A] = lying
    await hall.translate(STEP)
    assert (await where(hall), council.newest(scene.id).position) == (1.0, 3), "it was decided by another one"
    council.answers = dict.fromkeys((A, B, C), lying)
    with pytest.raises(Unreachable, match=r"may have happened.*said to be accepted"):
        await hall.translate(STEP)


async def test_a_log_is_fetched_once_while_it_stays(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    await hall.translate(STEP)
    council.asked.clear()
    assert [await where(hall) for _ in range(3)] == [1.0] * 3
    assert sum(isinstance(packet, RequestSceneLog) and packet.want is Want.LOG for _, packet in council.asked) == 0
    other = await (await council.scenes(Keyring(tmp_path)).open("kitchen")).space_named("hall")
    council.asked.clear()
    assert [await where(other) for _ in range(3)] == [1.0] * 3
    assert sum(isinstance(packet, RequestSceneLog) and packet.want is Want.LOG for _, packet in council.asked) == 0
