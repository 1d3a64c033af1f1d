"""Who does tasks: threads of this process, or the workers of a Dask cluster. The only door to dask and distributed, an optional extra.

What is handed to either are plain functions without arguments (`functools.partial`), in the same graph. A worker that dies is the scheduler's
business: it gives its tasks to others, and gives a task up whose workers die again and again.
"""

from __future__ import annotations

import ipaddress
import logging
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any, Protocol, TypeVar
from urllib.parse import urlsplit

import trio

from scenefold.base.errors import LocalFault, ScenefoldError, Unreachable, UsageFault
from scenefold.render.pool.share import LANE
from scenefold.render.tasks.holding import RenderEnded
from scenefold.world import Workers

EXTRA = "scenefold[dask]"
CONNECT_S = 10.0
LOOK_S = 30.0
"""Without a word from the scheduler, it is asked whether it has workers."""
ANSWER_S = 10.0
TASKS_AT_A_WORKER = 2
"""One is done, and one waits for it."""
SCHEMES = ("tcp", "tls")
OF_ENGINES = ("distributed", "tornado", "asyncio")
"""Loggers of what runs a client of Dask; nothing else here uses the last two."""
T = TypeVar("T")
Task = Callable[[], T]


class Engine(Protocol):
    """Calls come from one thread, but for `stop`."""

    @property
    def name(self) -> str:
        """For people and reports."""
        ...

    @property
    def workers(self) -> int:
        """How many tasks are done at a time."""
        ...

    def map(self, tasks: Sequence[Task[T]], take: Callable[[T], None]) -> bool:
        """Do all tasks, in any order; `take` is called with each result, once at a time, in any thread. False if it was stopped."""
        ...

    def stop(self) -> None:
        """Have no more tasks done; `map` returns soon. From any thread, and at once."""
        ...

    def close(self) -> None:
        """Nothing is done any more, and what tasks have held is let go of."""
        ...


async def done_by(engine: Engine, tasks: Sequence[Task[T]], take: Callable[[T], None], workers: Workers) -> None:
    """Have all tasks done, as `Engine.map`, which runs in a thread of `workers`. If this is cancelled they end soon, and it waits for that."""
    was_done = False

    async def stop_if_cancelled() -> None:
        try:
            await trio.sleep_forever()
        finally:
            # It may have other tasks to do after these.
            if not was_done:
                engine.stop()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(stop_if_cancelled)
        was_done = await workers.run(LANE, engine.map, tasks, take)
        if not was_done:
            await trio.sleep_forever()  # We are cancelled, and who stopped it will be told so.
        nursery.cancel_scope.cancel()


class ThreadsEngine:
    """Of this process, by Dask's own scheduler for threads."""

    def __init__(self, threads: int, end: Callable[[], None]) -> None:
        """`end`: what makes tasks end soon. LocalFault without the extra."""
        self._dask = _dask()
        self._end = end
        self._is_stopped = False
        self.workers = threads
        self.name = "threads"
        self._pool = ThreadPoolExecutor(threads)

    def map(self, tasks: Sequence[Task[T]], take: Callable[[T], None]) -> bool:
        """See `Engine`."""
        lock = threading.Lock()

        def taken(result: T) -> None:
            with lock:
                take(result)

        delayed = self._dask.delayed
        # What was taken is dropped; the results of `compute` would all be kept until the last one is there.
        graph = [delayed(taken, traverse=False)(delayed(task, traverse=False)()) for task in tasks]
        try:
            self._dask.compute(*graph, scheduler="threads", pool=self._pool, num_workers=self.workers, optimize_graph=False)
        except RenderEnded:
            assert self._is_stopped, "nobody else ends it"
            self.close()
        except BaseException:
            # Nobody wants what the others do.
            self.close()
            raise
        return not self._is_stopped

    def stop(self) -> None:
        """See `Engine`."""
        self._is_stopped = True
        self._end()

    def close(self) -> None:
        """See `Engine`."""
        self._end()
        # Those that are at work are waited for.
        self._pool.shutdown(cancel_futures=True)


class ClusterEngine:
    """The workers of a Dask cluster. To make one connects, and blocks."""

    def __init__(self, address: str, end: Callable[[], None], *, is_secret: bool = False) -> None:
        """`end`: makes tasks end soon in the process that calls it. `is_secret`: it may be used by tls, or if all of it is on this computer.

        LocalFault without the extra, or if it may not; Unreachable if no scheduler, or no worker, is there.
        """
        self._dask, self._distributed = _dask(), _distributed()
        self._end = end
        self._heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
        """Futures that are done; None: it was stopped."""
        self.name = address
        _silence()
        self._client = self._connected(address)
        try:
            if is_secret and not address.startswith("tls:"):
                self._check_here()
            self.workers = self._threads()
            if not self.workers:
                raise self._no_workers()
        except BaseException:
            self._close_client()
            raise

    def map(self, tasks: Sequence[Task[T]], take: Callable[[T], None]) -> bool:
        """See `Engine`."""
        waiting = iter(tasks)
        at_work: dict[object, Any] = {}
        try:
            self._begin(islice(waiting, TASKS_AT_A_WORKER * self.workers), at_work)
            while at_work:
                try:
                    heard = self._heard.get(timeout=LOOK_S)
                except queue.Empty:
                    if not self._threads():
                        raise self._no_workers() from None
                    continue
                if heard is None:
                    return False
                result = self._result(heard)
                del at_work[heard.key]
                heard.release()
                # What is done and not taken yet lies in memory, so that not all are begun at once.
                self._begin(islice(waiting, 1), at_work)
                take(result)
        finally:
            if at_work:
                self._client.cancel([*at_work.values()], force=True)
        return True

    def _begin(self, tasks: Iterable[Task[T]], at_work: dict[object, Any]) -> None:
        delayed = self._dask.delayed
        graph = [delayed(task, traverse=False)() for task in tasks]
        for future in self._client.compute(graph, optimize_graph=False) if graph else ():
            at_work[future.key] = future
            future.add_done_callback(self._heard.put)

    def stop(self) -> None:
        """See `Engine`."""
        self._heard.put(None)

    def close(self) -> None:
        """See `Engine`."""
        # Of a scheduler that is gone, or does not answer, workers end with their tasks.
        with suppress(Unreachable):
            self._asked(lambda client: client.run(self._end, on_error="ignore"))
        self._close_client()

    def _connected(self, address: str) -> Any:
        security = self._distributed.Security()
        if address.startswith("tls:") and security.get_connection_args("client").get("ssl_context") is None:
            remedy = "name them in Dask's configuration, under distributed.comm.tls"
            raise LocalFault("nothing says which certificates count for an engine by tls", where=address, remedy=remedy)
        try:
            return self._distributed.Client(address, timeout=CONNECT_S, set_as_default=False, security=security)
        except OSError as error:
            remedy = "start one there (dask scheduler), with workers, or give the address that it says"
            raise Unreachable("no Dask scheduler answers", where=address, remedy=remedy) from error

    def _close_client(self) -> None:
        with suppress(OSError):  # that it took too long: the process ends without a word of its scheduler
            self._client.close(timeout=ANSWER_S)

    def _threads(self) -> int:
        return sum(self._asked(lambda client: client.nthreads()).values())

    def _asked(self, question: Callable[[Any], Any]) -> Any:
        """What the client learns from the scheduler; Unreachable if that does not answer."""
        if self._client.scheduler is None:
            raise self._gone()
        try:
            # Called in the client's own loop its methods are awaited, and so have an end.
            return self._client.sync(lambda: question(self._client), callback_timeout=ANSWER_S)
        except OSError as error:
            raise self._gone() from error

    def _check_here(self) -> None:
        """LocalFault unless scheduler and workers can be reached from this computer alone, wherever the address is passed on to."""
        known = self._asked(lambda client: client.scheduler.identity(n_workers=-1))
        for address in (known["address"], *known["workers"]):
            if not _is_here(_host_of(address)):
                what = f"the engine is not of this computer alone, for {address:.200} can be reached from elsewhere"
                remedy = "start its scheduler and all workers with --host 127.0.0.1, or have all of them speak tls"
                raise LocalFault(what, where=self.name, remedy=remedy)

    def _result(self, future: Any) -> Any:
        try:
            return future.result()
        except UsageFault as fault:
            # Not of this command's arguments, but of what the worker found.
            raise LocalFault(fault.what, where=fault.where, remedy=fault.remedy) from fault
        except ScenefoldError:
            raise
        except self._distributed.KilledWorker as error:
            what = "workers of the engine died one after the other over the same part of the render"
            remedy = "see what they logged: they may want more memory for the whole scene, or fewer threads"
            raise LocalFault(what, where=self.name, remedy=remedy) from error
        except (ImportError, AttributeError) as error:
            raise self._unlike(error) from error
        except RuntimeError as error:
            # The scheduler has said that it cannot read a task, and logged why.
            if "deserialization" not in str(error):
                raise
            raise self._unlike(error.__cause__ or error) from error
        except (OSError, self._distributed.CancelledError) as error:
            raise self._gone() from error

    def _unlike(self, error: BaseException) -> LocalFault:
        what = f"the engine cannot do what this version wants of it ({' '.join(str(error).split())[:120]})"
        return LocalFault(what, where=self.name, remedy=f"install the same version of {EXTRA} for its scheduler and for all workers")

    def _gone(self) -> Unreachable:
        return Unreachable("the engine's scheduler has gone", where=self.name, remedy="start it, and render again")

    def _no_workers(self) -> Unreachable:
        return Unreachable("the engine has no worker", where=self.name, remedy=f"start one: dask worker {self.name}")


def check_installed(address: str | None) -> None:
    """LocalFault without the extra, before anything else is done. `address`: of a scheduler; None: none is needed."""
    _dask()
    if address is not None:
        _distributed()


def checked_address(address: str, *, is_secret: bool, is_network_trusted: bool = False) -> str:
    """The address of a scheduler; UsageFault if it is none, or may not be used (specs/32-partitions.md, What is sent).

    `is_network_trusted`: of whoever could answer in its place, by whom any code could be run here. For what is secret it counts for nothing.
    """
    where, remedy = f"--engine {address:.200}", "give it as the scheduler says it, as tcp://10.0.0.5:8786 or tls://10.0.0.5:8786"
    try:
        parts = urlsplit(address)
        scheme, host, port = parts.scheme, parts.hostname or "", parts.port
    except ValueError:
        scheme, host, port = "", "", None
    if scheme not in SCHEMES or not host or port is None:
        raise UsageFault("that is no address of a Dask scheduler", where=where, remedy=remedy)
    if is_secret and scheme != "tls" and not _is_here(host):
        what = "whoever reaches a scheduler by tcp can use its workers, and read their profiles' keys"
        raise UsageFault(what, where=where, remedy="render a scene of a cluster by an engine with tls://, or on this computer")
    if scheme != "tls" and not is_network_trusted and not _is_here(host):
        what = "whoever answers in the place of an engine by tcp, or is one of its workers, can run any code in this process"
        raise UsageFault(what, where=where, remedy="use one with tls://, or add --trust-network if you trust all who are on the way there")
    return address


def _host_of(address: str) -> str:
    try:
        return urlsplit(address).hostname or ""
    except ValueError:
        return ""


def _is_here(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _silence() -> None:
    """What packages of the engine would say of trouble, tracebacks included, is told by our errors. Some of their loggers have a level of their own."""
    for name in {*OF_ENGINES, *logging.root.manager.loggerDict}:
        if name.partition(".")[0] in OF_ENGINES:
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextmanager
def _extra(module: str) -> Iterator[None]:
    """Around the import of a package of the extra: LocalFault if it is not there."""
    try:
        yield
    except ImportError as error:
        what = f"a visual or temporal partition needs the package {module}, which is not installed"
        raise LocalFault(what, where="--partition", remedy=f"pip install '{EXTRA}'") from error


def _dask() -> Any:
    with _extra("dask"):
        import dask

        return dask


def _distributed() -> Any:
    with _extra("distributed"):
        import distributed

        return distributed
