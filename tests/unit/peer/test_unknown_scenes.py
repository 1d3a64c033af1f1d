"""If this fails, a user's one packet sets off questions to all nodes, as many as it has room for ids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import pytest
import trio
import trio.testing
from hypothesis import given
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.ids import KeyId, NodeId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.peer.records.writes import SCENES_MAX
from scenefold.peer.scene_log.pull import MISS_S
from scenefold.peer.scene_log.rounds import (
    ASKED_OF_KNOWN,
    ASKER_QUESTIONS_BURST,
    ASKER_QUESTIONS_PER_S,
    QUESTIONS_BURST,
    QUESTIONS_PER_S,
    Rounds,
)
from scenefold.wire import (
    GetMany,
    Packet,
    PutItem,
    PutMany,
    PutManyReply,
    QueryRange,
    RecordKey,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogPublic,
    Want,
)
from unit.peer.data_nodes import LEFT, MIDDLE, RIGHT, SCENE, USER, Neighbours, Node, arc, item, with_nodes
from unit.peer.scenes_made import PLACE, SPACE, first_header, later_header, offered, sealed
from unit.peer.test_scenes import OTHER, Rig

ALL = arc(0, 10_000)
UNKNOWN, CUT, BUSY = RejectReason.UNKNOWN_SCENE_OR_SPACE, RejectReason.LIMIT_EXCEEDED, RejectReason.BUSY
MEMBERS = 2
"""Others whom a node of `Rig` asks."""


def of_scene(number: int, place: int = 1) -> PutItem:
    return replace(item(place), scene=SceneId(number))


async def reasons(node: Node, items: Sequence[PutItem]) -> list[int]:
    reply = await node.ask(PutMany(tuple(items)))
    assert isinstance(reply, PutManyReply)
    return [outcome.reason for outcome in reply.outcomes]


def test_nobody_is_asked_about_records_that_are_refused_anyway() -> None:
    async def test(all_nodes: Neighbours, node: Node, _other: Node) -> None:
        assert await reasons(node, [of_scene(70, MIDDLE), of_scene(71, MIDDLE)]) == [RejectReason.NOT_MY_LOCATION] * 2
        node.lease.held = False
        assert await reasons(node, [of_scene(72), of_scene(73)]) == [RejectReason.NOT_READY] * 2
        assert all_nodes.looked_for == []

    with_nodes(test, LEFT, RIGHT)


def test_a_write_of_records_of_many_scenes_sets_off_few_rounds() -> None:
    async def test(all_nodes: Neighbours, node: Node) -> None:
        items = [item(1), *(of_scene(number) for number in range(90, 70, -1)), item(2), of_scene(90)]
        assert await reasons(node, items) == [0] + [UNKNOWN] * (SCENES_MAX - 1) + [CUT] * (21 - SCENES_MAX) + [0, UNKNOWN]
        assert sorted(all_nodes.looked_for) == [(number, 1, USER) for number in range(92 - SCENES_MAX, 91)]

    with_nodes(test, ALL)


def test_a_scene_that_was_not_looked_for_is_not_said_to_be_unknown() -> None:
    async def test(all_nodes: Neighbours, node: Node) -> None:
        all_nodes.unknown_is = BUSY
        assert await reasons(node, [of_scene(70), item(1)]) == [BUSY, 0]

    with_nodes(test, ALL)


def test_what_was_given_away_or_lost_while_others_were_asked_is_not_judged() -> None:
    async def test(all_nodes: Neighbours, node: Node, _other: Node) -> None:
        early = offered(sealed(SCENE, epoch=SCENE.position + 1, location=item(1).location))

        def lease_lost() -> None:
            node.lease.held = False

        all_nodes.meanwhile = lease_lost
        assert await reasons(node, [early, of_scene(70), item(2)]) == [RejectReason.NOT_READY] * 3
        node.lease.held = True

        def given_away() -> None:
            node.line.arc = None

        all_nodes.meanwhile = given_away
        assert set(await reasons(node, [of_scene(70), item(2)])) == {RejectReason.NOT_READY}, "between two owners"

    with_nodes(test, LEFT, RIGHT)


@pytest.mark.parametrize(
    "question",
    [GetMany(SceneId(70), 1, (RecordKey(SPACE, PLACE),)), QueryRange(SceneId(70), SPACE, PLACE, PLACE)],
    ids=["read", "range"],
)
def test_questions_are_set_off_in_the_name_of_who_reads_too(question: Packet) -> None:
    async def test(all_nodes: Neighbours, node: Node) -> None:
        await node.ask(question)
        assert [(scene, asker) for scene, _, asker in all_nodes.looked_for] == [(70, USER)]

    with_nodes(test, ALL)


async def refused(rig: Rig, number: int, asker: str) -> RejectReason:
    with pytest.raises(Refused) as caught:
        await rig.scenes.known(SceneId(number), asker=asker)
    return caught.value.reason


async def test_who_asks_for_ever_new_scenes_has_the_others_asked_so_often_and_no_more(autojump_clock: MockClock) -> None:
    rig = Rig()
    begun = trio.current_time()
    found = [await refused(rig, number, USER) for number in range(1000, 1400)]
    allowed = ASKER_QUESTIONS_BURST + ASKER_QUESTIONS_PER_S * (trio.current_time() - begun)
    assert ASKER_QUESTIONS_BURST <= len(rig.peers.asked) <= allowed
    assert found.count(UNKNOWN) == len(rig.peers.asked) / MEMBERS
    assert found.count(UNKNOWN) + found.count(BUSY) == 400
    assert await refused(rig, 5000, "user:ben") is UNKNOWN, "another one is asked for as ever"
    assert await refused(rig, 6000, "") is UNKNOWN, "and so is this node itself"
    await trio.sleep(MEMBERS / ASKER_QUESTIONS_PER_S)
    assert await refused(rig, 7000, USER) is UNKNOWN


async def test_what_is_known_is_served_to_who_has_asked_too_often(autojump_clock: MockClock) -> None:
    rig = Rig()
    known = first_header(origin=OTHER)
    rig.peers.headers[known.scene] = known
    await rig.scenes.known(known.scene)
    while await refused(rig, 1000 + len(rig.peers.asked), USER) is not BUSY:
        continue
    asked = len(rig.peers.asked)
    assert (await rig.scenes.known(known.scene, position=9, asker=USER)).public == known
    assert len(rig.peers.asked) == asked


async def test_who_waits_for_anothers_round_pays_nothing(autojump_clock: MockClock) -> None:
    rig = Rig()
    async with trio.open_nursery() as nursery:
        for _ in range(ASKER_QUESTIONS_BURST + 1):
            nursery.start_soon(refused, rig, 1000, USER)
    await trio.sleep(MISS_S)
    assert await refused(rig, 1001, USER) is UNKNOWN
    assert len(rig.peers.asked) == 2 * MEMBERS


async def test_who_asks_for_a_scene_is_told_that_it_is_unknown_only_if_it_was_looked_for(autojump_clock: MockClock) -> None:
    rig = Rig()
    assert await rig.scenes.on_request(RequestSceneLog(SceneId(70), b"", 0, 0, Want.HEADER), USER) == RespondSceneLog(answer=None)
    while await refused(rig, 1000 + len(rig.peers.asked), USER) is not BUSY:
        continue
    with pytest.raises(Refused) as caught:
        await rig.scenes.on_request(RequestSceneLog(SceneId(71), b"", 0, 0, Want.HEADER), USER)
    assert caught.value.reason is BUSY
    node = await rig.scenes.on_request(RequestSceneLog(SceneId(71), b"", 0, 0, Want.HEADER), "node:2")
    assert node == RespondSceneLog(answer=None), "of nodes that is no more than what is here"


async def large(scenes: int) -> tuple[Rig, list[SceneLogPublic]]:
    """A node in a cluster of 101 that knows so many scenes, as all others do."""
    rig = Rig()
    rig.peers.members = [NodeId(number) for number in range(2, 102)]
    known = [first_header(origin=OTHER, private_key=KeyId(number)) for number in range(scenes)]
    for header in known:
        await rig.scenes.adopt(header)
        rig.peers.headers[header.scene] = header
    return rig, known


async def test_a_node_that_missed_much_takes_news_of_many_scenes_from_who_decides_them(autojump_clock: MockClock) -> None:
    rig, known = await large(ASKER_QUESTIONS_BURST // ASKED_OF_KNOWN)
    for header in known:
        rig.peers.headers[header.scene] = later_header(header)
    assert {(await rig.scenes.known(header.scene, position=2, asker=USER)).public.position for header in known} == {2}
    assert [member for member, _ in rig.peers.asked] == [OTHER] * len(known)


async def test_who_claims_too_much_of_known_scenes_sets_off_no_more_than_his_questions(autojump_clock: MockClock) -> None:
    rig, known = await large(2 * ASKER_QUESTIONS_BURST // ASKED_OF_KNOWN)
    begun = trio.current_time()
    for header in known:
        assert (await rig.scenes.known(header.scene, position=9, asker=USER)).public == header
    allowed = ASKER_QUESTIONS_BURST + ASKER_QUESTIONS_PER_S * (trio.current_time() - begun)
    assert ASKER_QUESTIONS_BURST <= len(rig.peers.asked) <= allowed


async def used_up_but_for_a_few() -> tuple[Rig, SceneLogPublic]:
    """Who decides is away, so that all were asked for two scenes. One node alone has news of a third."""
    rig, (*others, last) = await large(3)
    rig.peers.away.add(OTHER)
    for header in others:
        await rig.scenes.known(header.scene, position=2, asker=USER)
    assert len(rig.peers.asked) == 2 * len(rig.peers.members)
    rig.peers.asked.clear()
    rig.peers.shown[rig.peers.members[-1]] = later_header(last)
    return rig, last


async def test_where_who_decides_is_silent_the_others_are_asked_for_who_has_questions_left(autojump_clock: MockClock) -> None:
    rig, header = await used_up_but_for_a_few()
    assert (await rig.scenes.known(header.scene, position=2, asker=USER)).public == header
    assert len(rig.peers.asked) == ASKED_OF_KNOWN
    assert (await rig.scenes.known(header.scene, position=2, asker="user:ben")).public == later_header(header), (
        "at once: nothing was missed"
    )


async def test_who_waits_for_anothers_round_has_it_go_on(autojump_clock: MockClock) -> None:
    rig, header = await used_up_but_for_a_few()
    found = []

    async def look(asker: str) -> None:
        found.append((await rig.scenes.known(header.scene, position=2, asker=asker)).public.position)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(look, USER)
        await trio.testing.wait_all_tasks_blocked()
        nursery.start_soon(look, "user:ben")
    assert found == [2, 2]
    assert len(rig.peers.asked) == len(rig.peers.members), "nobody twice"


async def test_all_who_wait_for_a_round_that_nobody_can_pay_are_done_with_it(autojump_clock: MockClock) -> None:
    rig, header = await used_up_but_for_a_few()
    async with trio.open_nursery() as nursery:
        for _ in range(10):
            nursery.start_soon(partial(rig.scenes.known, header.scene, position=2, asker=USER))
    assert len(rig.peers.asked) == ASKED_OF_KNOWN


@given(
    st.lists(st.tuples(st.sampled_from(["user:ada", "user:ben", "node:2"]), st.floats(0, 2), st.booleans()), max_size=200),
    st.integers(1, 2000),
)
def test_no_asker_and_not_all_together_set_off_more_than_their_bounds(begins: list[tuple[str, float, bool]], members: int) -> None:
    rounds, now = Rounds(), 0.0
    whole = min(members, ASKER_QUESTIONS_BURST)
    few = min(members, ASKED_OF_KNOWN)
    begun: dict[str, int] = {}
    for asker, later, is_known in begins:
        now += later
        count = 0
        if rounds.begin(asker, members, now, is_known=is_known):
            count = few if is_known else whole
            if is_known and rounds.go_on([asker], members, now):
                count = whole
        begun[asker] = begun.get(asker, 0) + count
    assert all(of_one <= ASKER_QUESTIONS_BURST + ASKER_QUESTIONS_PER_S * now + 1e-6 for of_one in begun.values())
    assert sum(begun.values()) <= QUESTIONS_BURST + QUESTIONS_PER_S * now + 1e-6


def test_a_round_through_the_largest_cluster_is_possible() -> None:
    assert Rounds().begin(USER, 100_000, 0.0)
    rounds = Rounds()
    assert rounds.begin(USER, 100_000, 0.0, is_known=True) and rounds.go_on([USER], 100_000, 0.0)


def test_what_this_node_wants_for_itself_goes_on_at_the_cost_of_nobody() -> None:
    rounds = Rounds()
    assert rounds.go_on([USER, ""], 100, 0.0)
    assert rounds.begin(USER, ASKER_QUESTIONS_BURST, 0.0)
    assert not rounds.go_on([USER], 100, 0.0) and rounds.go_on([USER, "user:ben"], 100, 0.0)
