"""Hedged requests: whoever hangs does not hold up a question that others can answer.

One node after the other is asked: the next one as soon as one cannot be reached, or has said nothing for a while, and
then both may still answer. The first answer, or refusal, is what counts; a packet that is no answer is like silence, since
one node that is wrong must not speak for all. So only for what may be asked twice. What any node can answer, none can refuse
for the others: then a refusal is like silence, too.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Sequence
from typing import TypeVar

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, TurnedAway, Unreachable
from scenefold.world import background_tasks, first_of

T = TypeVar("T")


async def first_answer(
    tries: Sequence[Callable[[], Awaitable[T]]], *, next_after_s: float, at_a_time: int, refusal_counts: bool = True
) -> T:
    """What the first of the tries returns or raises, but for Unreachable and PeerFault; of these the last one, Unreachable rather,
    and of that TurnedAway rather: a certificate that is not valid says more than a closed port.

    `refusal_counts` false: Refused is one of these, too.
    """
    assert tries and at_a_time >= 1
    ended, ends = trio.open_memory_channel[T | ScenefoldError](len(tries))

    async def attempt(call: Callable[[], Awaitable[T]]) -> None:
        end: T | ScenefoldError
        try:
            end = await call()
        except ScenefoldError as error:
            end = error
        ended.send_nowait(end)

    begun = over = 0
    silence: Unreachable | None = None
    async with background_tasks() as nursery:
        while True:
            if begun < len(tries) and begun - over < at_a_time:
                nursery.start_soon(attempt, tries[begun])
                begun += 1
            may_begin_another = begun < len(tries) and begun - over < at_a_time
            with trio.move_on_after(next_after_s if may_begin_another else math.inf):
                end = await ends.receive()
                over += 1
                if not isinstance(end, ScenefoldError):
                    return end
                if isinstance(end, Unreachable):
                    silence = end if silence is None else more_telling(silence, end)
                elif not isinstance(end, PeerFault) and (refusal_counts or not isinstance(end, Refused)):
                    raise end
                if over == len(tries):
                    # Who was silent may be back soon, so this is worth another try.
                    raise silence or end


async def some_answers(
    tries: Sequence[Callable[[], Awaitable[T]]], *, count: int, next_after_s: float, more_within_s: float, at_a_time: int
) -> list[T]:
    """What up to `count` of the tries return, those that others need not wait for: not below one, and after the first of them
    whatever comes within `more_within_s` of each other. Whoever fails, whyever, speaks for nobody else; if all do, one of their
    errors, Unreachable rather, and of that TurnedAway rather.
    """
    assert tries and 1 <= count <= at_a_time
    ended, ends = trio.open_memory_channel[T | ScenefoldError](len(tries))

    async def attempt(call: Callable[[], Awaitable[T]]) -> None:
        end: T | ScenefoldError
        try:
            end = await call()
        except ScenefoldError as error:
            end = error
        ended.send_nowait(end)

    found: list[T] = []
    problem: ScenefoldError | None = None
    begun = over = passed_over = 0
    async with background_tasks() as nursery:
        while True:
            while begun < min(len(tries), count + passed_over) and begun - over < at_a_time:
                nursery.start_soon(attempt, tries[begun])
                begun += 1
            if begun == over:
                break
            with trio.move_on_after(more_within_s if found else next_after_s) as waiting:
                end = await ends.receive()
            if waiting.cancelled_caught:
                if found:
                    break
                passed_over += 1
                continue
            over += 1
            if isinstance(end, ScenefoldError):
                passed_over += not found
                if isinstance(problem, Unreachable):
                    problem = more_telling(problem, end) if isinstance(end, Unreachable) else problem
                else:
                    problem = end
            else:
                found.append(end)
    if not found:
        assert problem is not None
        raise problem
    return found


def more_telling(first: Unreachable, second: Unreachable) -> Unreachable:
    """Of two that cannot be reached the one whose reason says more; the second if neither does."""
    return first if isinstance(first, TurnedAway) and not isinstance(second, TurnedAway) else second


async def helped(
    first: Callable[[], Awaitable[object]], others: Callable[[], Awaitable[object]], *, after_s: float, others_know: Callable[[], bool]
) -> bool:
    """Ask one, and if it fails, or says nothing for so long, others as well. Returns whether the first one had answered, once it has or `others_know`.

    Unreachable, Refused or PeerFault of the first one if the others have ended, and do not know either.
    """
    problem: Unreachable | Refused | PeerFault | None = None
    first_ended, others_ended = trio.Event(), trio.Event()

    async def ask_first() -> None:
        nonlocal problem
        try:
            await first()
        except (Unreachable, Refused, PeerFault) as error:
            problem = error
        first_ended.set()

    async def ask_others() -> None:
        await others()
        others_ended.set()

    def is_over() -> bool:
        return (first_ended.is_set() and problem is None) or (others_ended.is_set() and others_know())

    async with background_tasks() as nursery:
        nursery.start_soon(ask_first)
        with trio.move_on_after(after_s):
            await first_ended.wait()
        if not is_over():
            nursery.start_soon(ask_others)
            await first_of(first_ended.wait, others_ended.wait)
        if not is_over():
            await first_ended.wait()
        if not is_over():
            await others_ended.wait()
    if not is_over():
        assert problem is not None
        raise problem
    return first_ended.is_set() and problem is None
