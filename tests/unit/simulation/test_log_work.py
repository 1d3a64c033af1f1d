"""If this fails, a client of the simulation asks for one change and, after a lost answer, for another one under the same request: what it is told then says nothing of the log."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import trio

from scenefold.client.repeating import check_same, state_before
from scenefold.client.requests import Request
from scenefold.client.scene import Scene
from scenefold.client.scene_log import ReadLog
from scenefold.crypto import MemberSecrets
from scenefold.scene.log import SceneLog, follow
from scenefold.simulation.log_history import LogHistory, Told
from scenefold.simulation.log_work import LogClient, Make, Work, steady
from scenefold.wire import LogEntry
from unit.scene.log.council import Council, added
from unit.scene.log.members import secrets_of
from unit.scene.log.test_grants import MAKER_NUMBER, ORIGIN


class LostAnswer:
    """A log that takes whatever is offered. Its answer is lost, so that the author finds his change in it."""

    def __init__(self) -> None:
        self.council = Council()

    async def propose(self, make: Make, *, again: Request) -> ReadLog:
        council = self.council
        record = council.state.next_record(make(council.state), again.id, ORIGIN.node)
        signer = secrets_of(MAKER_NUMBER).signing
        council.settle(follow(council.header, council.log, record, council.keys, signer, council.token).sealed())
        read = ReadLog(council.header, council.log)
        check_same(read, state_before(read.log, read.state.requests[again.id]), again, make, "a")
        return read


class Whims:
    """Somebody who names another node each time that he is asked, as nodes come and go."""

    def __init__(self) -> None:
        self._asked = 3

    def __call__(self, log: SceneLog) -> LogEntry:
        self._asked += 1
        return added(self._asked)


def client_of(log: LostAnswer) -> LogClient:
    watch = SimpleNamespace(history=LogHistory(), told=lambda attempt: None, shown=lambda who, header: None)
    scene = SimpleNamespace(access=SimpleNamespace(log=log))
    work = Work(cast("Any", watch), lambda: 0.0, [], cast("MemberSecrets", None))
    return LogClient("steward", cast("Scene", scene), 1, work, lambda: 0)


def test_a_change_whose_answer_was_lost_is_found_whatever_its_author_would_want_by_now() -> None:
    client = client_of(LostAnswer())
    whims = Whims()

    assert trio.run(client.want, whims) is Told.COMMITTED


def test_another_log_is_gone_on_from_with_another_entry_and_an_earlier_one_still_with_its_own() -> None:
    council, make = Council(), steady(Whims())
    before = council.state
    first = make(before)
    council.decide(added(9))

    assert make(council.state) != first
    assert make(before) == first
