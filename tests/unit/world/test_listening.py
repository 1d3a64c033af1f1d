"""If this fails, a flood of connections keeps a node from all else, or keeps those waiting who are welcome."""

from __future__ import annotations

import errno
import itertools
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from typing import Any

import pytest
import trio
import trio.testing

from scenefold.world.real import listening
from scenefold.world.real.admission import PAUSE_S_MAX, REFUSED_PER_WELCOME
from scenefold.world.real.listening import GuardedListener

HOME, FLOOD = "127.0.0.1", "127.0.0.77"


class Entrance:
    """A listener on a port of this machine, and all that knock there; time passes only where the listener sleeps."""

    def __init__(self, listener: trio.SocketListener, held: ExitStack) -> None:
        self.address = listener.socket.getsockname()
        self.listener = GuardedListener(listener, self._may_knock)
        self._held = held
        self.looked_at: list[float] = []
        """When each connection that was refused was taken from the queue."""

    def _may_knock(self, source: str) -> bool:
        if source == FLOOD:
            self.looked_at.append(trio.current_time())
        return source != FLOOD

    def knock(self, source: str, count: int = 1) -> list[socket.socket]:
        """Connections that are in the system's queue when this returns."""
        made = [socket.create_connection(self.address, source_address=(source, 0)) for _ in range(count)]
        for one in made:
            self._held.enter_context(one)
        return made


@pytest.fixture
async def entrance() -> AsyncIterator[Entrance]:
    with ExitStack() as held:
        (listener,) = await trio.open_tcp_listeners(0, host=HOME)
        one = Entrance(listener, held)
        yield one
        await one.listener.aclose()


@asynccontextmanager
async def accepting(entrance: Entrance) -> AsyncIterator[None]:
    """While this lasts all that come are taken, and those that are let in dropped."""

    async def accept() -> None:
        while True:
            await trio.aclose_forcefully(await entrance.listener.accept())

    async with trio.open_nursery() as nursery:
        nursery.start_soon(accept)
        yield
        nursery.cancel_scope.cancel()


async def is_closed(connection: socket.socket) -> bool:
    """Wait until the other end says something, or closes."""
    with trio.socket.from_stdlib_socket(connection.dup()) as end:
        return await end.recv(1) == b""


async def test_who_may_knock_is_let_in_and_who_may_not_is_closed(entrance: Entrance, autojump_clock: trio.testing.MockClock) -> None:
    (refused,), (welcome,) = entrance.knock(FLOOD), entrance.knock(HOME)
    async with await entrance.listener.accept() as stream:
        assert stream.socket.getpeername() == welcome.getsockname()
        assert await is_closed(refused)
        await stream.send_all(b"hello")
        assert welcome.recv(10) == b"hello"


async def test_while_all_is_refused_the_queue_is_looked_at_less_and_less_often(
    entrance: Entrance, autojump_clock: trio.testing.MockClock
) -> None:
    async with accepting(entrance):
        for _ in range(9):
            (refused,) = entrance.knock(FLOOD)
            assert await is_closed(refused), "it comes again at once"
    gaps = [later - earlier for earlier, later in itertools.pairwise(entrance.looked_at)]
    assert gaps == pytest.approx([0.005, 0.01, 0.02, 0.04, 0.08, 0.1, 0.1, 0.1])


async def test_what_came_during_a_pause_is_taken_as_a_whole(entrance: Entrance, autojump_clock: trio.testing.MockClock) -> None:
    async with accepting(entrance):
        (first,) = entrance.knock(FLOOD)
        assert await is_closed(first)
        crowd = entrance.knock(FLOOD, 20)
        for refused in crowd:
            assert await is_closed(refused)
    assert len(entrance.looked_at) == 21 and len(set(entrance.looked_at)) == 2


async def test_who_is_welcome_waits_for_one_pause_at_most_and_ends_it(entrance: Entrance, autojump_clock: trio.testing.MockClock) -> None:
    async with accepting(entrance):
        for _ in range(12):
            (refused,) = entrance.knock(FLOOD)
            assert await is_closed(refused)
        (welcome,) = entrance.knock(HOME)
        came_at = trio.current_time()
        assert await is_closed(welcome)
        assert 0 < trio.current_time() - came_at <= PAUSE_S_MAX + 1e-9
        came_at = trio.current_time()
        entrance.knock(HOME)
        entrance.knock(FLOOD, REFUSED_PER_WELCOME)
        await trio.testing.wait_all_tasks_blocked()
        (welcome,) = entrance.knock(HOME)
        assert await is_closed(welcome) and trio.current_time() == came_at, "some are refused everywhere"


async def test_who_comes_long_after_a_flood_waits_for_nothing(entrance: Entrance, autojump_clock: trio.testing.MockClock) -> None:
    async with accepting(entrance):
        for _ in range(12):
            (refused,) = entrance.knock(FLOOD)
            assert await is_closed(refused)
        await trio.sleep(PAUSE_S_MAX)
        (welcome,) = entrance.knock(HOME)
        came_at = trio.current_time()
        assert await is_closed(welcome) and trio.current_time() == came_at


class Steps(trio.abc.Instrument):
    """How many had been refused whenever some task had ended its turn."""

    def __init__(self, entrance: Entrance) -> None:
        self._entrance = entrance
        self.seen: set[int] = set()

    def after_task_step(self, _task: trio.lowlevel.Task) -> None:
        self.seen.add(len(self._entrance.looked_at))


async def test_others_have_their_turn_after_so_many_that_are_refused(
    entrance: Entrance, autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listening, "AT_ONCE_MAX", 8)
    steps = Steps(entrance)
    entrance.knock(FLOOD, 30)
    trio.lowlevel.add_instrument(steps)
    async with accepting(entrance):
        await trio.testing.wait_all_tasks_blocked()
    assert steps.seen == {0, 8, 16, 24, 30}, "and no more often, as each turn costs time"


async def test_who_is_let_in_one_after_the_other_leaves_others_their_turn(
    entrance: Entrance, autojump_clock: trio.testing.MockClock
) -> None:
    entrance.knock(HOME, 3)
    for _ in range(3):
        with trio.testing.assert_checkpoints():
            stream = await entrance.listener.accept()
        await trio.aclose_forcefully(stream)


class Failing:
    """A socket at which the system says this before it gives what comes."""

    def __init__(self, real: Any, *numbers: int) -> None:
        self._errors = list(numbers)
        self._real = real
        self.fileno: Callable[[], int] = real.fileno
        self.close: Callable[[], None] = real.close

    def accept(self) -> tuple[socket.socket, Any]:
        if self._errors:
            number = self._errors.pop(0)
            raise OSError(number, "no")
        accepted: tuple[socket.socket, Any] = self._real.accept()
        return accepted


async def test_a_connection_that_ended_in_the_queue_ends_nothing_else(entrance: Entrance, autojump_clock: trio.testing.MockClock) -> None:
    gone = (errno.ECONNABORTED, errno.ECONNRESET, errno.EPERM, errno.EPROTO)
    entrance.listener._socket = Failing(entrance.listener._socket, *gone)  # type: ignore[assignment]
    entrance.knock(HOME)
    await trio.aclose_forcefully(await entrance.listener.accept())


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE, errno.EBADF])
async def test_what_is_wrong_with_this_machine_is_said(entrance: Entrance, number: int, autojump_clock: trio.testing.MockClock) -> None:
    entrance.listener._socket = Failing(entrance.listener._socket, number)  # type: ignore[assignment]
    entrance.knock(HOME)
    with pytest.raises(OSError, match="no") as caught:
        await entrance.listener.accept()
    assert caught.value.errno == number, "who serves knows what to do about it"


async def test_a_closed_listener_wakes_who_waits_for_a_connection(entrance: Entrance, autojump_clock: trio.testing.MockClock) -> None:
    async def accept() -> None:
        with pytest.raises(trio.ClosedResourceError):
            await entrance.listener.accept()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(accept)
        await trio.testing.wait_all_tasks_blocked()
        await entrance.listener.aclose()
    with pytest.raises(ConnectionRefusedError):
        entrance.knock(HOME)
