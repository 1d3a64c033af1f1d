"""If this fails, a scene is read once for each task instead of once for each process, or stays in memory when nobody wants it."""

from __future__ import annotations

import threading

import pytest

from scenefold.render.tasks.holding import ENDED_MAX, Holding, RenderEnded


class Thing:
    """Something that can be held."""

    def __init__(self) -> None:
        self.closed = 0

    def close(self) -> None:
        self.closed += 1


def test_it_is_opened_once_and_freed_when_the_render_ends() -> None:
    holding, made = Holding[Thing](), list[Thing]()

    def opened() -> Thing:
        made.append(Thing())
        return made[-1]

    for number in range(3):
        with holding.borrowed("a", opened) as (thing, is_new):
            assert thing is made[0] and is_new == (number == 0)
    assert len(made) == 1 and not made[0].closed
    holding.end("a")
    holding.end("a")
    assert made[0].closed == 1


def test_the_last_that_uses_it_frees_it() -> None:
    holding, thing = Holding[Thing](), Thing()
    with holding.borrowed("a", lambda: thing):
        with holding.borrowed("a", lambda: thing):
            holding.end("a")
            with pytest.raises(RenderEnded):
                holding.check("a")
        assert not thing.closed
    assert thing.closed == 1


def test_a_task_that_comes_late_does_not_begin() -> None:
    holding = Holding[Thing]()
    holding.end("a")
    with pytest.raises(RenderEnded), holding.borrowed("a", Thing):
        pytest.fail("nobody wants it")


def test_what_an_ended_client_has_left_goes_when_another_render_begins() -> None:
    holding, left = Holding[Thing](), Thing()
    with holding.borrowed("a", lambda: left):
        with holding.borrowed("b", Thing):
            assert not left.closed, "in use"
    with holding.borrowed("c", Thing):
        assert left.closed == 1


def test_what_cannot_be_opened_is_tried_again_by_the_next_task() -> None:
    holding, thing = Holding[Thing](), Thing()

    def fails() -> Thing:
        raise OSError("no")

    with pytest.raises(OSError, match="no"), holding.borrowed("a", fails):
        pytest.fail("there is nothing")
    with holding.borrowed("a", lambda: thing) as (found, is_new):
        assert found is thing and is_new


def test_others_wait_for_the_one_that_opens_it() -> None:
    holding, made, got = Holding[Thing](), list[Thing](), list[Thing]()
    begun, may = threading.Event(), threading.Event()

    def slowly() -> Thing:
        begun.set()
        assert may.wait(10)
        made.append(Thing())
        return made[-1]

    def borrow() -> None:
        with holding.borrowed("a", slowly) as (thing, _):
            got.append(thing)

    threads = [threading.Thread(target=borrow) for _ in range(4)]
    for thread in threads:
        thread.start()
    assert begun.wait(10)
    may.set()
    for thread in threads:
        thread.join(10)
    assert len(made) == 1 and got == made * 4


def test_few_of_those_that_ended_are_remembered() -> None:
    holding = Holding[Thing]()
    for number in range(ENDED_MAX + 1):
        holding.end(str(number))
    holding.check("0")
    with pytest.raises(RenderEnded):
        holding.check("1")
