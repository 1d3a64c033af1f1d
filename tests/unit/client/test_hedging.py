"""If this fails, one node that hangs holds up a client for half a minute, or a client floods all nodes with one question."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as some
from trio.testing import MockClock

from scenefold.base.errors import PeerFault, Refused, TurnedAway, Unreachable
from scenefold.base.limits import CLIENT_ASKED_MAX, CLIENT_CONTACT_NEXT_S, CLIENT_NEXT_S, CLIENT_REQUEST_S
from scenefold.base.reasons import RejectReason
from scenefold.client.hedging import first_answer, some_answers
from scenefold.wire import ListScenes, RequestTable, RespondTable, ScenesListed
from unit.client.fake_nodes import FakeNodes

NEXT_S = 2.0


class Tries:
    """Nodes that answer, refuse or are unreachable after so many seconds."""

    def __init__(self, *nodes: tuple[float, str]) -> None:
        self._nodes = nodes
        self.begun: list[float] = []
        self.under_way = self.most = 0

    def all(self) -> list[Callable[[], Awaitable[int]]]:
        return [lambda number=number: self._one(number) for number in range(len(self._nodes))]  # type: ignore[misc]

    async def _one(self, number: int) -> int:
        seconds, what = self._nodes[number]
        self.begun.append(trio.current_time())
        self.under_way += 1
        self.most = max(self.most, self.under_way)
        try:
            await trio.sleep(seconds)
        finally:
            self.under_way -= 1
        if what == "turns away":
            raise TurnedAway(f"another certificate {number}")
        if what == "away":
            raise Unreachable(f"away {number}")
        if what == "nonsense":
            raise PeerFault(f"nonsense {number}")
        if what == "refuses":
            raise Refused(RejectReason.BUSY, "later")
        return number


async def asked(tries: Tries, at_a_time: int = 3) -> int:
    return await first_answer(tries.all(), next_after_s=NEXT_S, at_a_time=at_a_time)


async def test_who_answers_soon_is_the_only_one_asked(autojump_clock: MockClock) -> None:
    tries = Tries((1.0, "answers"), (0.0, "answers"))
    assert await asked(tries) == 0 and len(tries.begun) == 1


async def test_while_one_hangs_the_next_is_asked_and_the_first_may_still_answer(autojump_clock: MockClock) -> None:
    begin = trio.current_time()
    assert await asked(Tries((30.0, "away"), (0.5, "answers"))) == 1
    assert trio.current_time() - begin == pytest.approx(NEXT_S + 0.5)
    assert await asked(Tries((3.0, "answers"), (30.0, "away"))) == 0


async def test_who_cannot_be_reached_is_passed_over_at_once(autojump_clock: MockClock) -> None:
    begin = trio.current_time()
    assert await asked(Tries((0.1, "away"), (0.1, "away"), (0.1, "answers"))) == 2
    assert trio.current_time() - begin == pytest.approx(0.3)


async def test_a_refusal_is_an_answer(autojump_clock: MockClock) -> None:
    tries = Tries((1.0, "refuses"), (0.0, "answers"))
    with pytest.raises(Refused):
        await asked(tries)
    assert len(tries.begun) == 1


async def test_where_no_refusal_counts_the_next_is_asked(autojump_clock: MockClock) -> None:
    tries = Tries((0.1, "refuses"), (0.1, "answers"))
    assert await first_answer(tries.all(), next_after_s=NEXT_S, at_a_time=3, refusal_counts=False) == 1
    with pytest.raises(Refused):
        await first_answer(Tries((0.1, "refuses")).all(), next_after_s=NEXT_S, at_a_time=3, refusal_counts=False)


async def test_if_nobody_answers_the_last_reason_is_given(autojump_clock: MockClock) -> None:
    with pytest.raises(Unreachable, match="away 1"):
        await asked(Tries((5.0, "away"), (9.0, "away"), (4.0, "away")))


async def test_what_says_more_than_silence_is_the_reason_that_is_given(autojump_clock: MockClock) -> None:
    for seconds in ((0.1, 0.1, 0.1), (0.1, 0.3, 0.2), (0.3, 0.1, 0.1)):
        with pytest.raises(TurnedAway, match="another certificate 1"):
            await asked(Tries((seconds[0], "away"), (seconds[1], "turns away"), (seconds[2], "away")))
        with pytest.raises(TurnedAway, match="another certificate 1"):
            await several(Tries((seconds[0], "away"), (seconds[1], "turns away"), (seconds[2], "nonsense")))


async def test_one_that_answers_with_nonsense_does_not_speak_for_all(autojump_clock: MockClock) -> None:
    assert await asked(Tries((0.1, "nonsense"), (0.1, "answers"))) == 1
    with pytest.raises(Unreachable, match="away 0"):
        await asked(Tries((0.1, "away"), (0.1, "nonsense")))
    with pytest.raises(PeerFault, match="nonsense 1"):
        await asked(Tries((0.1, "nonsense"), (0.1, "nonsense")))


@given(
    some.lists(some.tuples(some.floats(0.0, 40.0), some.sampled_from(["answers", "away", "refuses"])), min_size=1, max_size=9),
    some.integers(1, 4),
)
def test_so_many_at_a_time_and_nobody_waits_without_need(nodes: list[tuple[float, str]], at_a_time: int) -> None:
    async def test() -> None:
        tries, begin = Tries(*nodes), trio.current_time()
        answer: int | None = None
        with suppress(Refused, Unreachable):
            answer = await asked(tries, at_a_time)
        took = trio.current_time() - begin
        assert tries.most <= at_a_time and tries.under_way == 0
        assert len(tries.begun) == len(nodes) or any(what != "away" for _, what in nodes)
        assert answer is None or nodes[answer][1] == "answers"
        # No slower than one after the other.
        index = next((number for number, (_, what) in enumerate(nodes) if what != "away"), len(nodes) - 1)
        assert took <= math.fsum(seconds for seconds, _ in nodes[: index + 1]) + 1e-6

    trio.run(test, clock=MockClock(autojump_threshold=0))


async def test_a_client_asks_the_next_node_while_one_hangs(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(addresses=tuple(f"127.0.0.{number}" for number in range(2, 12)))
    calls = nodes.calls()
    # All but the last one that is asked accept the question and never answer.
    nodes.hung = set(nodes.addresses) - {calls._addresses_from(None)[1]}
    begin = trio.current_time()
    await calls.ask_any(ListScenes(), ScenesListed)
    assert trio.current_time() - begin == pytest.approx(CLIENT_CONTACT_NEXT_S), "nobody had answered before"
    await calls.ask_any(RequestTable(), RespondTable)
    assert trio.current_time() - begin == pytest.approx(CLIENT_CONTACT_NEXT_S + CLIENT_NEXT_S)
    nodes.hung = set(nodes.addresses) - {calls._addresses_from(None)[-1]}
    begin = trio.current_time()
    await calls.ask_any(ListScenes(), ScenesListed)
    rounds = math.ceil(len(nodes.addresses) / CLIENT_ASKED_MAX) - 1
    assert trio.current_time() - begin <= rounds * CLIENT_REQUEST_S + CLIENT_ASKED_MAX * CLIENT_NEXT_S


async def test_a_first_table_is_taken_from_the_next_node_while_one_hangs(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    calls = nodes.calls()
    nodes.hung = {calls._addresses_from(None)[0]}
    begin = trio.current_time()
    await calls.learn()
    assert trio.current_time() - begin == pytest.approx(CLIENT_CONTACT_NEXT_S)


async def several(tries: Tries, count: int = 3) -> list[int]:
    return await some_answers(tries.all(), count=count, next_after_s=NEXT_S, more_within_s=0.5, at_a_time=3)


async def test_of_several_answers_those_that_hang_or_fail_are_not_waited_for(autojump_clock: MockClock) -> None:
    tries = Tries((30, "hangs"), (0.1, "nonsense"), (0.2, "refuses"), (0.3, "answers"), (0.4, "answers"), (9, "never asked"))
    assert await several(tries) == [3, 4]
    assert trio.current_time() < 2
    assert tries.most <= 3
    assert await several(Tries((0.1, "answers"), (0.2, "answers"), (0.3, "answers"), (0, "not asked"))) == [0, 1, 2]
    assert await several(Tries((30, "hangs"), (30, "hangs"), (0.3, "answers")), count=2) == [2]
    with pytest.raises(Unreachable):
        await several(Tries((0.1, "away"), (0.2, "nonsense"), (0.3, "refuses")))
    with pytest.raises(PeerFault):
        await several(Tries((0.1, "nonsense")))
