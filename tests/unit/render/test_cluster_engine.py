"""If this fails, secrets are given to an engine that strangers reach, tasks pile up on it, or trouble with it is told in many lines, or never.

Dask is played by this module; tests/integration/test_partitions_ends.py has the real one.
"""

from __future__ import annotations

import logging
import types
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from scenefold.base.errors import LocalFault, Unreachable
from scenefold.render.tasks import engine
from scenefold.render.tasks.engine import OF_ENGINES, ClusterEngine

HERE, ELSEWHERE = "tcp://127.0.0.1:40001", "tcp://10.0.0.5:40001"


class Future:
    """Done when somebody listens."""

    def __init__(self, client: Client, task: Callable[[], Any]) -> None:
        self.key, self._client, self._task = object(), client, task

    def add_done_callback(self, heard: Callable[[Future], None]) -> None:
        heard(self)

    def result(self) -> Any:
        return self._task()

    def release(self) -> None:
        self._client.at_work -= 1


class Client:
    """Of a scheduler with these addresses; `silent`: it does not answer."""

    def __init__(self, address: str, workers: dict[str, int], *, silent: bool = False) -> None:
        self.scheduler = self
        self.known, self.workers, self.silent = address, workers, silent
        self.at_work, self.most, self.is_closed, self.cancelled = 0, 0, False, 0

    def sync(self, call: Callable[[], Any], *, callback_timeout: float) -> Any:
        assert callback_timeout > 0
        if self.silent:
            raise TimeoutError("timed out")
        return call()

    def identity(self, *, n_workers: int) -> dict[str, Any]:
        assert n_workers == -1, "all of them"
        return {"address": self.known, "workers": dict.fromkeys(self.workers)}

    def nthreads(self) -> dict[str, int]:
        return self.workers

    def run(self, call: Callable[[], None], *, on_error: str) -> None:
        assert on_error == "ignore"
        call()

    def compute(self, tasks: list[Callable[[], Any]], *, optimize_graph: bool) -> list[Future]:
        assert not optimize_graph
        self.at_work += len(tasks)
        self.most = max(self.most, self.at_work)
        return [Future(self, task) for task in tasks]

    def cancel(self, futures: list[Future], *, force: bool) -> None:
        assert force
        self.cancelled += len(futures)

    def close(self, *, timeout: float) -> None:
        assert timeout > 0
        self.is_closed = True


@pytest.fixture
def clients(monkeypatch: pytest.MonkeyPatch) -> deque[Client]:
    """What connecting gives, one after the other."""
    ready: deque[Client] = deque()
    dask = types.SimpleNamespace(delayed=lambda task, traverse: lambda: task)
    distributed = types.SimpleNamespace(
        Security=lambda: types.SimpleNamespace(get_connection_args=lambda _: {"ssl_context": object()}),
        Client=lambda *_, **__: ready[0],
        KilledWorker=ZeroDivisionError,
        CancelledError=ZeroDivisionError,
    )
    monkeypatch.setattr(engine, "_dask", lambda: dask)
    monkeypatch.setattr(engine, "_distributed", lambda: distributed)
    return ready


def nothing() -> None:
    pass


def connected(clients: deque[Client], client: Client, address: str = HERE, *, is_secret: bool = False) -> ClusterEngine:
    clients.append(client)
    return ClusterEngine(address, nothing, is_secret=is_secret)


@pytest.mark.parametrize(
    ("scheduler", "worker"), [(HERE, ELSEWHERE), (ELSEWHERE, HERE), (HERE, "tcp://render.example:1"), (HERE, "tcp://[::1"), ("", HERE)]
)
def test_a_scene_of_a_cluster_goes_to_an_engine_that_is_here_as_a_whole(scheduler: str, worker: str, clients: deque[Client]) -> None:
    """Its address may be passed on to another computer, or others may reach it."""
    client = Client(scheduler, {HERE: 1, worker: 1})
    with pytest.raises(LocalFault, match=r"not of this computer alone.*--host 127.0.0.1"):
        connected(clients, client, is_secret=True)
    assert client.is_closed


def test_a_file_need_not_nor_who_speaks_tls(clients: deque[Client]) -> None:
    assert connected(clients, Client(ELSEWHERE, {ELSEWHERE: 2})).workers == 2
    clients.clear()
    assert connected(clients, Client("tls://10.0.0.5:1", {ELSEWHERE: 3}), "tls://10.0.0.5:1", is_secret=True).workers == 3
    clients.clear()
    assert connected(clients, Client(HERE, {HERE: 1, "tcp://[::1]:7": 1}), is_secret=True).workers == 2


def test_what_cannot_be_used_is_let_go_of(clients: deque[Client]) -> None:
    client = Client(HERE, {})
    with pytest.raises(Unreachable, match="has no worker"):
        connected(clients, client)
    assert client.is_closed


@pytest.mark.parametrize("is_secret", [False, True])
def test_a_scheduler_that_does_not_answer_has_gone(*, is_secret: bool, clients: deque[Client]) -> None:
    client = Client(HERE, {HERE: 1}, silent=True)
    with pytest.raises(Unreachable, match="has gone"):
        connected(clients, client, is_secret=is_secret)
    assert client.is_closed


def test_nor_does_the_end_wait_for_it(clients: deque[Client]) -> None:
    client = Client(HERE, {HERE: 1})
    reached = connected(clients, client)
    client.silent = True
    reached.close()
    assert client.is_closed


def test_two_tasks_of_a_worker_are_begun_at_a_time(clients: deque[Client]) -> None:
    """What they have made lies in memory until it is taken."""
    client, taken = Client(HERE, {HERE: 3}), list[int]()
    assert connected(clients, client).map([partial(int, number) for number in range(50)], taken.append)
    assert sorted(taken) == list(range(50))
    assert client.most == 6 and client.at_work == 0 and client.cancelled == 0


def test_those_that_are_begun_are_cancelled_if_one_fails(clients: deque[Client]) -> None:
    client = Client(HERE, {HERE: 2})

    def fails() -> None:
        raise LocalFault("the file is none", where="a.glb", remedy="give another")

    with pytest.raises(LocalFault, match="the file is none"):
        connected(clients, client).map([fails] * 50, nothing_of)
    assert client.cancelled == 4


def nothing_of(_: object) -> None:
    pass


def test_nothing_is_said_but_by_our_errors(clients: deque[Client], caplog: pytest.LogCaptureFixture) -> None:
    """Some loggers of Dask have levels of their own, and write to the terminal themselves."""
    names = [*OF_ENGINES, "distributed.client", "distributed.core", "tornado.application"]
    before = {name: logging.getLogger(name).level for name in names}
    try:
        for name in names:
            logging.getLogger(name).setLevel(logging.WARNING)
        connected(clients, Client(HERE, {HERE: 1}))
        for name in names:
            logging.getLogger(name).error("said by %s", name)
        logging.getLogger("distributed.later").error("said later")
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)
    assert caplog.records == []
