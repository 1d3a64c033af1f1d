"""If this fails, whoever reads through a node that is cut off from most others waits for each of them in turn, longer than a reader does."""

from __future__ import annotations

from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.headers import checked_header
from scenefold.peer.scene_log.pull import MISS_S, NEWS_S_MAX, NEXT_S, Pull
from scenefold.peer.scene_log.rounds import ASKED_OF_KNOWN
from scenefold.wire import RequestSceneLog, RespondSceneLog, SceneLogAnswer, SceneLogPublic
from unit.peer.scenes_made import first_header, later_header
from unit.peer.test_scenes import PlainWorld

FIRST = first_header()
NEWER = later_header(FIRST)
OTHERS = [NodeId(number) for number in range(2, 9)]
USER = "user:ada"


class Peers:
    """Some never answer: they are cut off, and only the time limit ends a question to them."""

    def __init__(self, silent: list[NodeId], header: SceneLogPublic) -> None:
        self.asked: list[NodeId] = []
        self.ended: list[NodeId] = []
        self.slow: dict[NodeId, tuple[float, SceneLogPublic]] = {}
        """Who answers only after so long, and with which header."""
        self._silent, self._header = silent, header

    def others(self) -> list[NodeId]:
        return OTHERS

    async def ask(self, member: NodeId, _priority: Any, packet: RequestSceneLog, _answer: Any, timeout_s: float) -> RespondSceneLog:
        self.asked.append(member)
        try:
            if member in self._silent:
                await trio.sleep(timeout_s)
                raise Unreachable("it does not answer")
            seconds, header = self.slow.get(member, (0.01, self._header))
            await trio.sleep(seconds)
            return RespondSceneLog(SceneLogAnswer(0, 2, header.position, header, None))
        finally:
            self.ended.append(member)


class Node:
    """It knows the first header, or nothing of the scene."""

    def __init__(self, peers: Peers, known: SceneLogPublic | None) -> None:
        world: Any = PlainWorld()
        them: Any = peers
        self._known: KnownScene | None = None if known is None else checked_header(known, None)
        self.pull = Pull(world, them, lambda _scene: self._known, self._take)

    async def _take(self, header: SceneLogPublic, _where: str) -> None:
        await trio.lowlevel.checkpoint()
        if self._known is None or header.position > self._known.public.position:
            self._known = checked_header(header, self._known)

    @property
    def position(self) -> int:
        return 0 if self._known is None else self._known.public.position


async def test_who_is_cut_off_from_all_others_says_so_soon(autojump_clock: MockClock) -> None:
    peers = Peers(OTHERS, NEWER)
    node = Node(peers, FIRST)
    assert await node.pull.until(FIRST.scene, NEWER.position, USER)
    assert trio.current_time() <= NEWS_S_MAX + 0.1 and node.position == FIRST.position
    assert len(peers.asked) >= ASKED_OF_KNOWN and sorted(peers.ended) == sorted(peers.asked), "no question is left behind"


@pytest.mark.parametrize("known", [FIRST, None], ids=["known", "unknown"])
@pytest.mark.parametrize("silent", [1, 3, 5])
async def test_one_that_answers_is_found_among_silent_ones(autojump_clock: MockClock, silent: int, known: SceneLogPublic | None) -> None:
    peers = Peers(OTHERS[:silent], NEWER)
    node = Node(peers, known)
    assert await node.pull.until(FIRST.scene, NEWER.position, USER)
    assert node.position == NEWER.position
    assert trio.current_time() < silent * NEXT_S + 0.1, "nobody waits until a silent one has had all of its time"
    assert sorted(peers.ended) == sorted(peers.asked)


async def test_where_all_answer_only_one_is_asked(autojump_clock: MockClock) -> None:
    peers = Peers([], NEWER)
    node = Node(peers, FIRST)
    assert await node.pull.until(FIRST.scene, NEWER.position, USER)
    assert peers.asked == OTHERS[:1]


async def test_who_was_silent_is_asked_last_the_next_time(autojump_clock: MockClock) -> None:
    """Else of many who decide, and of whom the first cannot be reached, nobody else would ever be asked: a round has an end."""
    others = [NodeId(number) for number in range(2, 20)]
    peers = Peers(others[:-1], NEWER)
    peers.others = lambda: others  # type: ignore[method-assign]
    node = Node(peers, FIRST)
    rounds = 0
    while node.position < NEWER.position:
        rounds += 1
        assert rounds <= 4 and await node.pull.until(FIRST.scene, NEWER.position)
        await trio.sleep(MISS_S)
    assert len(set(peers.asked)) == len(others)


DECIDES, *NOT = [NodeId(number) for number in range(1, 10)]
"""Who decides the scene is asked first where that is known, and here by chance where it is not."""


@pytest.mark.parametrize("known", [FIRST, None], ids=["known", "unknown"])
async def test_a_slow_one_that_decides_is_heard_out(autojump_clock: MockClock, known: SceneLogPublic | None) -> None:
    """Others show an old header meanwhile. Its word is waited for, and nobody pays for questions to all."""
    peers = Peers([], FIRST)
    peers.others = lambda: [DECIDES, *NOT]  # type: ignore[method-assign]
    peers.slow[DECIDES] = 0.9, NEWER
    node = Node(peers, known)
    assert await node.pull.until(FIRST.scene, NEWER.position if known else 0, USER)
    assert node.position == NEWER.position
    assert known is None or len(peers.asked) <= ASKED_OF_KNOWN


async def test_who_has_no_questions_left_still_hears_who_was_asked(autojump_clock: MockClock) -> None:
    peers = Peers([], FIRST)
    peers.others = lambda: [DECIDES, *NOT]  # type: ignore[method-assign]
    peers.slow[DECIDES] = 0.9, NEWER
    node = Node(peers, FIRST)
    node.pull._begun.go_on = lambda *_given: False  # type: ignore[method-assign]
    assert await node.pull.until(FIRST.scene, NEWER.position, USER)
    assert node.position == NEWER.position and len(peers.asked) == ASKED_OF_KNOWN
    peers.asked.clear()
    assert not await node.pull.until(FIRST.scene, NEWER.position + 1, USER), "nobody has it, and not all were asked"
    assert len(peers.asked) == ASKED_OF_KNOWN
