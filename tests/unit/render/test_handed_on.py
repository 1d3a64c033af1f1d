"""If this fails, frames pile up in memory before they are written, some never are, or a disk that is full ends in a hang."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from scenefold.base.errors import LocalFault
from scenefold.render.tasks.handed_on import HandedOn

END_S = 20.0


@contextmanager
def thread(target: partial[None]) -> Iterator[threading.Thread]:
    runs = threading.Thread(target=target, daemon=True)
    runs.start()
    yield runs
    runs.join(END_S)
    assert not runs.is_alive()


@pytest.mark.parametrize("room", [1, 20])
def test_all_that_is_given_is_written_in_its_order(room: int) -> None:
    """Also what is more than there is room for."""
    written: list[int] = []
    handed_on = HandedOn(room, written.append)
    with thread(partial(handed_on.write_all)):
        for number in range(50):
            handed_on.give(number, 10)
        handed_on.end()
    assert written == list(range(50)) and handed_on.last_at is not None


def test_no_more_wait_than_there_is_room_for() -> None:
    may_write, ahead = threading.Semaphore(0), list[int]()
    given: list[int] = []

    def write(number: int) -> None:
        assert may_write.acquire(timeout=END_S)
        ahead.append(len(given) - number)

    handed_on = HandedOn(39, write)

    def give() -> None:
        for number in range(20):
            handed_on.give(number, 10)
            given.append(number)
            may_write.release()
        handed_on.end()

    for _ in range(2):
        may_write.release()
    with thread(partial(handed_on.write_all)), thread(partial(give)):
        pass
    assert len(ahead) == 20 and max(ahead) <= 4


def test_what_cannot_be_written_ends_it_for_both() -> None:
    def write(_: int) -> None:
        raise LocalFault("cannot write there", where="x.exr", remedy="choose another folder")

    handed_on, faults = HandedOn(10, write), list[str]()

    def writes() -> None:
        with pytest.raises(LocalFault) as error:
            handed_on.write_all()
        faults.append(error.value.where)

    with thread(partial(writes)):
        for number in range(5):
            handed_on.give(number, 10)
    assert faults == ["x.exr"]
