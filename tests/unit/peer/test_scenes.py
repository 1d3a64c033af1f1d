"""If this fails, many readers of a new scene set off as many rounds of asking, or a scene's log is lost or overwritten."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, NotReached, Refused, Unreachable
from scenefold.base.ids import KeyId, NodeId, address_of
from scenefold.base.limits import SCENES_PER_USER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SealingKey, SigningKey
from scenefold.peer.scene_log.makers import check_decider
from scenefold.peer.scene_log.pull import MISS_S
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.scene.log import FOR_EVER
from scenefold.wire import (
    AcceptSceneProposal,
    KeyEntry,
    ListScenes,
    Member,
    Packet,
    ProposeSceneLog,
    RejectSceneProposal,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    Want,
    WriterEntry,
    page_of,
)
from scenefold.world.facts import Credential
from scenefold.world.quiet import SILENCE_S
from unit.peer.scenes_made import DECIDER, HEADER_KEY, LOG, STRANGER, WRITER, first_header, later_header

ME, OTHER, THIRD = NodeId(1), NodeId(2), NodeId(3)
LONGER = b"the longer log"
FIRST = first_header(origin=ME)
USER, NODE = "user:ada", "node:2"


class PlainWorld:
    """Clock and workers of a test."""

    def __init__(self) -> None:
        self.clock = self
        self.workers = self
        self.worked = 0

    def now(self) -> float:
        return trio.current_time()

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)

    async def run(self, _lane: str, function: Any, *arguments: object) -> Any:
        await trio.lowlevel.checkpoint()
        self.worked += 1
        return function(*arguments)


class PlainStore:
    """One dict; remembers what was written together."""

    def __init__(self) -> None:
        self.written: list[tuple[bytes, bytes | None]] = []
        self.private: dict[int, bytes] = {}
        self.headers_kept: dict[int, bytes] = {}

    async def headers(self) -> dict[int, bytes]:
        await trio.lowlevel.checkpoint()
        return self.headers_kept

    async def put_header(self, scene: int, header: bytes) -> None:
        await trio.lowlevel.checkpoint()
        self.written.append((header, None))

    async def put_scene_log(self, scene: int, header: bytes, private: bytes) -> None:
        await trio.lowlevel.checkpoint()
        self.written.append((header, private))
        self.private[scene] = private

    async def get_scene_log(self, scene: int) -> bytes | None:
        await trio.lowlevel.checkpoint()
        return self.private.get(scene)

    async def logs_kept(self) -> frozenset[bytes]:
        await trio.lowlevel.checkpoint()
        return frozenset()


class PlainPeers:
    """The other nodes: all know the same headers."""

    def __init__(self) -> None:
        self.headers: dict[int, SceneLogPublic] = {}
        self.shown: dict[NodeId, SceneLogPublic | None] = {}
        """What one of them shows of the only scene in place of that."""
        self.asked: list[tuple[NodeId, Packet]] = []
        self.told: list[tuple[NodeId, Packet]] = []
        self.away: set[NodeId] = set()
        self.seem_alive: list[NodeId] = []
        self.members = [OTHER, THIRD]
        self.unconnected: set[NodeId] = set()

    def others(self, *, first: NodeId | None = None) -> list[NodeId]:
        return sorted(self.members, key=lambda node: (node != first, node))

    def witnesses(self) -> list[NodeId]:
        return self.seem_alive

    async def ask(self, member: NodeId, _priority: Any, packet: Any, _answer: Any, _timeout: float) -> Any:
        self.asked.append((member, packet))
        await trio.sleep(0.01)
        if member in self.away:
            raise Unreachable("away")
        if member in self.unconnected:
            raise NotReached("Connection refused")
        if isinstance(packet, ListScenes):
            own = self.shown.get(member)
            if own is not None:
                return page_of([own], packet.after)
            return page_of(sorted(self.headers.values(), key=lambda header: header.scene), packet.after)
        if not isinstance(packet, RequestSceneLog):
            return packet
        header = self.shown.get(member, self.headers.get(packet.scene))
        return RespondSceneLog(header and SceneLogAnswer(0, 2, header.position, header, None))

    async def tell(self, member: NodeId, _priority: Any, packet: Packet, _timeout: float) -> None:
        await trio.lowlevel.checkpoint()
        self.told.append((member, packet))


class Rig:
    def __init__(
        self,
        voter: NodeId = ME,
        check_new: Callable[[SceneLogPublic], None] = lambda _public: None,
        store: PlainStore | None = None,
    ) -> None:
        self.peers, self.store = PlainPeers(), store or PlainStore()
        self.world = PlainWorld()
        world: Any = self.world
        own: Any = type("Own", (), {"me": ME, "member": Member(ME, bytes(16)), "key": DECIDER})()
        self.users = [WRITER.public]
        self.scenes = Scenes(world, self.store, self.peers, own, voter, lambda key: key in self.users, check_new)  # type: ignore[arg-type]

    @property
    def worked(self) -> int:
        """Times that a worker had something to do."""
        return self.world.worked


def second_of(first: SceneLogPublic) -> SceneLogPublic:
    return later_header(first, log=LONGER)


def proposal(public: SceneLogPublic, private: bytes = LOG) -> ProposeSceneLog:
    return ProposeSceneLog(public.genesis, public.proposed(), private)


def request(want: Want = Want.LOG) -> RequestSceneLog:
    return RequestSceneLog(FIRST.scene, FIRST.genesis, 0, 5, want)


async def test_many_who_need_a_scene_ask_once(autojump_clock: MockClock) -> None:
    rig = Rig()
    foreign = first_header(origin=OTHER)
    rig.peers.headers[foreign.scene] = foreign
    found: list[int] = []

    async def need() -> None:
        found.append((await rig.scenes.known(foreign.scene, position=1)).public.position)

    async with trio.open_nursery() as nursery:
        for _ in range(50):
            nursery.start_soon(need)
    assert found == [1] * 50
    assert len(rig.peers.asked) == 1


async def test_who_waits_goes_on_when_the_one_that_asks_is_cancelled(autojump_clock: MockClock) -> None:
    rig = Rig()
    foreign = first_header(origin=OTHER)
    rig.peers.headers[foreign.scene] = foreign

    async def give_up() -> None:
        with trio.move_on_after(0.005):
            await rig.scenes.known(foreign.scene)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(give_up)
        await trio.testing.wait_all_tasks_blocked()
        nursery.start_soon(rig.scenes.known, foreign.scene)
    assert rig.scenes.all() == [foreign]


async def test_a_scene_that_nobody_has_is_asked_for_once_a_second(autojump_clock: MockClock) -> None:
    rig = Rig()

    async def miss() -> None:
        with pytest.raises(Refused) as refused:
            await rig.scenes.known(FIRST.scene)
        assert refused.value.reason is RejectReason.UNKNOWN_SCENE_OR_SPACE

    async with trio.open_nursery() as nursery:
        for _ in range(20):
            nursery.start_soon(miss)
    assert len(rig.peers.asked) == 2, "each other node once"
    await trio.sleep(MISS_S)
    await miss()
    assert len(rig.peers.asked) == 4


async def test_the_origin_decides_keeps_and_tells(autojump_clock: MockClock) -> None:
    rig = Rig()
    assert isinstance(await rig.scenes.on_propose(proposal(FIRST), USER), AcceptSceneProposal)
    second = second_of(FIRST)
    accepted = await rig.scenes.on_propose(proposal(second, LONGER), USER)
    assert isinstance(accepted, AcceptSceneProposal)
    assert (accepted.decision, accepted.record_hash) == (second.decision, second.log_hash)
    assert rig.store.written == [(FIRST.encode(), LOG), (second.encode(), LONGER)]
    assert sorted(member for member, _ in rig.peers.told) == [OTHER, OTHER, THIRD, THIRD]
    answer = await rig.scenes.on_request(request(), USER)
    assert isinstance(answer, RespondSceneLog) and answer.answer is not None
    assert (answer.answer.public, answer.answer.private) == (second, LONGER)
    bare = await rig.scenes.on_request(request(Want.HEADER), USER)
    assert isinstance(bare, RespondSceneLog) and bare.answer is not None and bare.answer.private is None


async def test_of_two_proposals_at_once_one_is_first(autojump_clock: MockClock) -> None:
    rig = Rig()
    await rig.scenes.on_propose(proposal(FIRST), USER)
    replies: list[Packet] = []

    async def propose(private: bytes) -> None:
        replies.append(await rig.scenes.on_propose(proposal(later_header(FIRST, log=private), private), USER))

    async with trio.open_nursery() as nursery:
        # A translation and a scale have the same header but for the log that it names.
        nursery.start_soon(propose, b"translated")
        nursery.start_soon(propose, b"scaled")
    taken = [reply for reply in replies if isinstance(reply, AcceptSceneProposal)]
    refused = [reply.reason for reply in replies if isinstance(reply, RejectSceneProposal)]
    assert (len(taken), refused) == (1, [RejectReason.POSITION_TAKEN])
    assert len(rig.store.written) == 2


async def test_another_node_hands_a_users_proposal_to_the_origin(autojump_clock: MockClock) -> None:
    rig = Rig()
    foreign = first_header(origin=OTHER)
    await rig.scenes.on_propose(proposal(foreign), USER)
    assert [member for member, _ in rig.peers.asked] == [OTHER]
    rejected = await rig.scenes.on_propose(proposal(foreign), NODE)
    assert isinstance(rejected, RejectSceneProposal)
    assert (rejected.reason, rejected.node) == (RejectReason.NOT_MY_LOCATION, OTHER)
    nowhere = await rig.scenes.on_propose(proposal(first_header(origin=NodeId(9))), USER)
    assert isinstance(nowhere, RejectSceneProposal) and nowhere.reason is RejectReason.NOT_AUTHORISED
    assert rig.store.written == []


async def test_who_hands_on_says_that_nothing_came_to_the_origin_only_if_it_is_so(autojump_clock: MockClock) -> None:
    rig = Rig()
    rig.peers.unconnected = {OTHER}
    rejected = await rig.scenes.on_propose(proposal(first_header(origin=OTHER)), USER)
    assert isinstance(rejected, RejectSceneProposal)
    assert (rejected.reason, rejected.node) == (RejectReason.PEER_MISSED, OTHER)
    rig.peers.unconnected, rig.peers.away = set(), {OTHER}
    with pytest.raises(Unreachable):
        await rig.scenes.on_propose(proposal(first_header(origin=OTHER)), USER)


@pytest.mark.expect_log("damaged scene header is dropped")
async def test_a_damaged_header_is_had_from_others(autojump_clock: MockClock) -> None:
    rig = Rig()
    foreign = first_header(origin=OTHER)
    rig.peers.headers[foreign.scene] = foreign
    rig.store.headers_kept = {foreign.scene: foreign.encode()[:-1] + b"?", FIRST.scene: FIRST.encode()}
    await rig.scenes.load()
    assert rig.scenes.all() == [FIRST]
    assert (await rig.scenes.known(foreign.scene)).public == foreign


async def test_the_keeper_of_a_log_does_not_forget_how_far_it_is(autojump_clock: MockClock) -> None:
    rig = Rig()
    rig.store.headers_kept = {FIRST.scene: FIRST.encode()[:-1] + b"?"}
    rig.store.private[FIRST.scene] = LOG
    with pytest.raises(DamagedData, match="whose log is kept here"):
        await rig.scenes.load()


@pytest.mark.parametrize("told", [None, 1, 2])
async def test_who_died_between_deciding_and_telling_tells_when_it_is_back(told: int | None, autojump_clock: MockClock) -> None:
    rig, second = Rig(), later_header(FIRST)
    rig.store.headers_kept = {FIRST.scene: second.encode()}
    await rig.scenes.load()
    if told is not None:
        rig.peers.headers[FIRST.scene] = (FIRST, second)[told - 1]
    await rig.scenes.catch_up()
    news = [] if told == second.position else [OTHER, THIRD]
    assert sorted(member for member, _ in rig.peers.told) == news
    assert all(isinstance(packet, RespondSceneLog) and packet.answer and packet.answer.public == second for _, packet in rig.peers.told)


@pytest.mark.expect_log("not taken: .*nobody shows that it was decided")
async def test_what_was_only_proposed_counts_nowhere_whoever_shows_it(autojump_clock: MockClock) -> None:
    """A relay has it before it is decided, and it may never be."""
    rig, proposed = Rig(), second_of(FIRST).proposed()
    await rig.scenes.on_propose(proposal(FIRST), USER)
    await rig.scenes.on_push(pushed(proposed), NODE)
    rig.peers.headers[FIRST.scene] = proposed
    assert (await rig.scenes.known(FIRST.scene, position=2)).public == FIRST
    await rig.scenes.catch_up()
    assert rig.scenes.all() == [FIRST]
    assert rig.store.written == [(FIRST.encode(), LOG)]
    assert isinstance(await rig.scenes.on_propose(proposal(proposed, LONGER), USER), AcceptSceneProposal)


@pytest.mark.expect_log("node:2: the header of scene .* is not taken")
async def test_who_pushes_headers_that_do_not_count_fills_no_log(caplog: pytest.LogCaptureFixture, autojump_clock: MockClock) -> None:
    rig, bad = Rig(), second_of(FIRST).proposed()
    caplog.set_level(logging.INFO)
    for _ in range(100):
        await rig.scenes.on_push(pushed(bad), NODE)
        await rig.scenes.on_propose(proposal(bad, LONGER), USER)
    assert len(caplog.records) == 2
    await trio.sleep(SILENCE_S)
    await rig.scenes.on_push(pushed(bad), NODE)
    assert "99 times more" in caplog.records[-1].getMessage()


async def test_what_was_decided_counts_whoever_shows_it(autojump_clock: MockClock) -> None:
    rig, first = Rig(), first_header(origin=THIRD)
    await rig.scenes.on_push(pushed(first), "node:2")
    assert rig.scenes.all() == [first]


@pytest.mark.expect_log("has decided position 2 and forgotten it")
async def test_a_node_that_forgot_what_it_decided_decides_no_position_twice(autojump_clock: MockClock) -> None:
    """Its disk is an older one. The log that it has goes with an older header, and is shown to nobody."""
    rig, second = Rig(), second_of(FIRST)
    await rig.scenes.on_propose(proposal(FIRST), USER)
    await rig.scenes.on_push(pushed(second), NODE)
    third = later_header(second, log=LONGER)
    refused = await rig.scenes.on_propose(proposal(third, LONGER), USER)
    assert isinstance(refused, RejectSceneProposal) and refused.reason is RejectReason.UNKNOWN_SCENE_OR_SPACE
    shown = await rig.scenes.on_request(request(), USER)
    assert isinstance(shown, RespondSceneLog) and shown.answer is not None
    assert (shown.answer.public, shown.answer.private) == (second, None)


async def test_an_origin_that_lost_the_log_goes_on_hearing_of_headers(autojump_clock: MockClock) -> None:
    rig, second = Rig(), later_header(FIRST)
    await rig.scenes.adopt(FIRST)
    rig.peers.headers[FIRST.scene] = second
    assert (await rig.scenes.known(FIRST.scene, position=2)).public == second


async def test_who_meets_a_scene_first_asks_the_node_that_decides_how_far_it_is(autojump_clock: MockClock) -> None:
    """An older header was decided as well, and any node may show it."""
    first = first_header(origin=THIRD)
    for meet in ("known", "catch_up"):
        rig = Rig()
        rig.peers.headers[first.scene] = first
        rig.peers.shown[OTHER], rig.peers.shown[THIRD] = first, second_of(first)
        if meet == "known":
            await rig.scenes.known(first.scene)
        else:
            await rig.scenes.catch_up()
        assert rig.scenes.all() == [second_of(first)]


async def test_while_the_node_that_decides_is_away_others_are_believed(autojump_clock: MockClock) -> None:
    rig = Rig()
    first = first_header(origin=THIRD)
    rig.peers.shown[OTHER], rig.peers.shown[THIRD] = later_header(first), None
    assert (await rig.scenes.known(first.scene)).public == later_header(first)


def made_by(maker: SigningKey, number: int) -> SceneLogPublic:
    """The scene of this number by a user."""
    keys = tuple(KeyEntry(1, key.public.raw) for key in (HEADER_KEY, maker))
    return first_header(maker, origin=ME, private_key=KeyId(number), keys=keys, writers=(WriterEntry(maker.key_id, 1, FOR_EVER),))


async def reason_of(rig: Rig, public: SceneLogPublic) -> RejectReason | None:
    reply = await rig.scenes.on_propose(proposal(public), USER)
    return reply.reason if isinstance(reply, RejectSceneProposal) else None


async def test_one_user_does_not_fill_the_list_for_all(autojump_clock: MockClock) -> None:
    rig = Rig()
    rig.users.append(STRANGER.public)
    made = [made_by(WRITER, number) for number in range(SCENES_PER_USER_MAX + 1)]
    assert {await reason_of(rig, public) for public in made[:-1]} == {None}
    assert await reason_of(rig, made[-1]) is RejectReason.LIMIT_EXCEEDED
    assert await reason_of(rig, made[0]) is None, "what there is may be announced again"
    assert await reason_of(rig, later_header(made[0])) is None, "and goes on"
    assert await reason_of(rig, made_by(STRANGER, 0)) is None, "and others make theirs"


async def test_at_several_nodes_at_once_a_user_makes_no_more_scenes(autojump_clock: MockClock) -> None:
    rig = Rig(voter=OTHER)
    assert await reason_of(rig, FIRST) is RejectReason.NOT_AUTHORISED
    assert rig.scenes.all() == []
    rig.store.headers_kept[FIRST.scene] = FIRST.encode()
    rig.store.private[FIRST.scene] = LOG
    await rig.scenes.load()
    assert await reason_of(rig, later_header(FIRST)) is None, "what began elsewhere goes on there"


@pytest.mark.parametrize("origin", [ME, OTHER])
async def test_what_a_member_decides_in_a_users_name_costs_the_user_nothing(origin: NodeId, autojump_clock: MockClock) -> None:
    rig, liar = Rig(), SigningKey.generate()
    for number in range(SCENES_PER_USER_MAX):
        in_adas_name = first_header(STRANGER, liar, origin=origin, private_key=KeyId(number))
        await rig.scenes.on_push(pushed(in_adas_name), NODE)
    assert len(rig.scenes.all()) == SCENES_PER_USER_MAX
    assert await reason_of(rig, FIRST) is None


@pytest.mark.expect_log("was not begun at the cluster's first voter")
@pytest.mark.parametrize("position", [1, 2])
async def test_who_meets_a_members_own_scene_does_not_take_it_and_still_takes_a_true_one(position: int, autojump_clock: MockClock) -> None:
    """Ids are short: a member searches for another's, and newcomers that meet its header first would refuse the true one for ever."""
    voter = Credential(OTHER, address_of(OTHER), DECIDER.public, SealingKey(b"s" * 32).public)
    rig, liar = Rig(OTHER, partial(check_decider, voter=voter)), SigningKey.generate()
    for first in (first_header(decider=liar, origin=THIRD), first_header(decider=liar, origin=OTHER), first_header(origin=THIRD)):
        shown = first if position == 1 else later_header(first, decider=liar if first.origin_key == liar.public.raw else DECIDER)
        await rig.scenes.on_push(pushed(shown), NODE)
        assert rig.scenes.all() == []
    true = first_header(origin=OTHER)
    shown = true if position == 1 else later_header(true)
    await rig.scenes.on_push(pushed(shown), NODE)
    assert rig.scenes.all() == [shown]


async def test_nobody_makes_scenes_at_the_cost_of_another(autojump_clock: MockClock) -> None:
    rig = Rig()
    assert await reason_of(rig, made_by(STRANGER, 0)) is RejectReason.NOT_AUTHORISED, "no user has this key"
    # Ada's public key is known to all: what she must have signed is the first lockbox.
    in_adas_name = first_header(STRANGER, origin=ME)
    assert await reason_of(rig, in_adas_name) is RejectReason.SIGNATURE_INVALID
    borrowed = first_header(origin=ME, write_floor=1, lockboxes=FIRST.lockboxes)
    assert await reason_of(rig, borrowed) is RejectReason.SIGNATURE_INVALID
    for without in ({"lockboxes": FIRST.lockboxes * 2}, {"writers": ()}):
        assert await reason_of(rig, first_header(origin=ME, **without)) is RejectReason.ILL_FORMED
    assert rig.scenes.all() == []


def pushed(public: SceneLogPublic) -> RespondSceneLog:
    return RespondSceneLog(SceneLogAnswer(0, 2, public.position, public, None))
