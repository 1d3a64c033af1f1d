"""If this fails, whoever asks a log for something is told what is not so, or waits for those who only look."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import pytest
import trio
import trio.testing

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Ask, Judge, Outcome, Reply, Stage, State, Value
from scenefold.consensus.state import Proposal
from scenefold.peer.logs import Answer
from scenefold.peer.logs.asking import LOOKS_MAX, Asking
from unit.consensus.logs_made import Book, participants


async def test_whose_time_is_over_is_told_what_the_log_says_of_it_by_then() -> None:
    """Others had it decided while it waited behind something here: that is not refused. And what fits no more is not for want of a majority."""
    first = Book(participants(1, 2, 3))
    asking, said = Asking(lambda: None), dict[str, Answer | RejectReason]()

    def unfit(_judge: Judge) -> Value:
        raise Refused(RejectReason.POSITION_BEHIND, "the log went on")

    async def one(name: str, make: Any) -> None:
        try:
            said[name] = await asking.ask(make, 5.0, is_for_all=False, is_forced=False, needs_consent=True)
        except Refused as refused:
            said[name] = refused.reason

    async with trio.open_nursery() as nursery:
        nursery.start_soon(one, "it", lambda judge: judge.value("it", 1))
        nursery.start_soon(one, "other", lambda judge: judge.value("other", 1))
        nursery.start_soon(one, "unfit", unfit)
        await trio.testing.wait_all_tasks_blocked()
        asking.expire(State(first.after(first.value("it", 2)), 1), 5.0)
    assert said == {
        "it": Answer(Outcome.COMMITTED, 1),
        "other": Answer(Outcome.REJECTED, 2, RejectReason.NO_MAJORITY),
        "unfit": RejectReason.POSITION_BEHIND,
    }


async def test_all_who_wait_to_look_share_one_look_and_changes_come_between() -> None:
    """Anybody may look, and each look makes all participants write."""
    state = State(Book(participants(1, 2, 3)))
    asking, said = Asking(lambda: None), list[str]()

    async def look(name: str, deadline: float) -> None:
        answer = await asking.ask(None, deadline, is_for_all=False, is_forced=False, needs_consent=True)
        said.append(f"{name} {answer.outcome.name}")

    async def change(name: str) -> None:
        await asking.ask(lambda judge: judge.value(name, 1), 9.0, is_for_all=False, is_forced=False, needs_consent=False)
        said.append(name)

    async def settle(outcome: Outcome) -> Ask | None:
        """What is proposed next, and has that outcome then."""
        asked = asking.next(state, 0.0)
        if asked is not None:
            asking.hear(Reply(None if asked.value is None else asked.value.digest, outcome, 1))
            await trio.testing.wait_all_tasks_blocked()
        return asked

    async with trio.open_nursery() as nursery:
        nursery.start_soon(look, "first", 9.0)
        await trio.testing.wait_all_tasks_blocked()
        running = asking.next(state, 0.0)
        for number in range(20):
            nursery.start_soon(look, f"look {number:02}", 5.0 + number % 2)
        for name in ("a", "b"):
            nursery.start_soon(change, name)
            await trio.testing.wait_all_tasks_blocked()
        assert running is not None and asking.next(state, 0.0) is None
        asking.hear(Reply(None, Outcome.OPEN, 1))
        await trio.testing.wait_all_tasks_blocked()
        assert said == ["first OPEN"], "who came later may want what was begun since"
        changed = await settle(Outcome.COMMITTED)
        assert changed is not None and changed.value is not None and said[1:] == ["a"]
        shared = asking.next(state, 0.0)
        assert shared is not None and (shared.value, shared.deadline) == (None, 6.0)
        asking.expire(replace(state, proposal=Proposal(has_voted=True)), 5.5)
        await trio.testing.wait_all_tasks_blocked()
        assert sorted(said[2:]) == [f"look {number:02} UNKNOWN" for number in range(0, 20, 2)], (
            "whose time is over does not wait for the others, and something was begun"
        )
        asking.expire(state, 6.5)
        asking.hear(Reply(None, Outcome.OPEN, 1))
        await trio.testing.wait_all_tasks_blocked()
        assert sorted(said[12:]) == [f"look {number:02} OPEN" for number in range(1, 20, 2)]
        assert (await settle(Outcome.COMMITTED)) is not None and said[22:] == ["b"]
        assert await settle(Outcome.COMMITTED) is None


@pytest.mark.parametrize(
    ("barrier", "said"),
    [
        (Proposal(), Answer(Outcome.REJECTED, 1, RejectReason.NO_MAJORITY)),
        (Proposal(Stage.RESTING, reason=RejectReason.BUSY, by=NodeId(2)), Answer(Outcome.REJECTED, 1, RejectReason.BUSY, NodeId(2))),
        (Proposal(before=(RejectReason.POSITION_TAKEN, NodeId(3))), Answer(Outcome.REJECTED, 1, RejectReason.POSITION_TAKEN, NodeId(3))),
        (Proposal(Stage.PREPARING, is_behind=True), Answer(Outcome.UNKNOWN, 1)),
        (Proposal(Stage.ACCEPTING, has_voted=True), Answer(Outcome.UNKNOWN, 1)),
        (Proposal(Stage.RESTING, has_voted=True, reason=RejectReason.POSITION_TAKEN), Answer(Outcome.UNKNOWN, 1)),
    ],
)
async def test_whose_look_goes_on_for_others_is_told_how_it_stands(barrier: Proposal, said: Answer) -> None:
    """By what their barrier has met so far: what it has voted for may be decided, and is no refusal. Whose look has not begun is told 15."""
    state, told = State(Book(participants(1, 2, 3))), dict[str, Answer]()
    asking = Asking(lambda: None)

    async def look(name: str, deadline: float) -> None:
        told[name] = await asking.ask(None, deadline, is_for_all=False, is_forced=False, needs_consent=True)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(look, "early", 5.0)
        nursery.start_soon(look, "late", 6.0)
        await trio.testing.wait_all_tasks_blocked()
        assert asking.next(state, 0.0) is not None
        nursery.start_soon(look, "next", 5.0)
        await trio.testing.wait_all_tasks_blocked()
        asking.expire(replace(state, proposal=barrier), 5.5)
        await trio.testing.wait_all_tasks_blocked()
        assert told == {"early": said, "next": Answer(Outcome.REJECTED, 1, RejectReason.NO_MAJORITY)}
        asking.hear(Reply(None, Outcome.UNKNOWN, 1))


async def test_a_look_that_nobody_waits_for_is_left_out() -> None:
    state = State(Book(participants(1, 2, 3)))
    asking = Asking(lambda: None)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(partial(asking.ask, None, 5.0, is_for_all=False, is_forced=False, needs_consent=True))
        await trio.testing.wait_all_tasks_blocked()
        nursery.cancel_scope.cancel()
    assert asking.next(state, 0.0) is None
    refused = 0

    async def look() -> None:
        nonlocal refused
        try:
            await asking.ask(None, 5.0, is_for_all=False, is_forced=False, needs_consent=True)
        except Refused as refusal:
            refused += refusal.reason is RejectReason.BUSY

    async with trio.open_nursery() as nursery:
        for _ in range(LOOKS_MAX + 3):
            nursery.start_soon(look)
        await trio.testing.wait_all_tasks_blocked()
        nursery.cancel_scope.cancel()
    assert refused == 3
