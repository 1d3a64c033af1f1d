"""Who does tasks: threads of this process, or the workers of a Dask cluster. The only door to dask and distributed, an optional extra.

What is handed to either are plain functions without arguments (`functools.partial`), in the same graph. A worker that dies is the scheduler's
business: it gives its tasks to others, and gives a task up whose workers die again and again.
"""

from __future__ import annotations

import ipaddress
import logging
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
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
SCHEMES = ("tcp", "tls")
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

    def map(self, tasks: Sequence[Task[T]], take: Callable[[T], None]) -> bool:
        """See `Engine`."""
        lock = threading.Lock()

        def taken(result: T) -> None:
            with lock:
                take(result)

        delayed = self._dask.delayed
        # What was taken is dropped; the results of `compute` would all be kept until the last one is there.
        graph = [delayed(taken, traverse=False)(delayed(task, traverse=False)()) for task in tasks]
        with ThreadPoolExecutor(self.workers) as pool:
            try:
                self._dask.compute(*graph, scheduler="threads", pool=pool, num_workers=self.workers, optimize_graph=False)
            except RenderEnded:
                assert self._is_stopped, "nobody else ends it"
            except BaseException:
                # Those that are at work are waited for, and nobody wants what they do.
                self._end()
                raise
        return not self._is_stopped

    def stop(self) -> None:
        """See `Engine`."""
        self._is_stopped = True
        self._end()

    def close(self) -> None:
        """See `Engine`."""
        self._end()


class ClusterEngine:
    """The workers of a Dask cluster. To make one connects, and blocks."""

    def __init__(self, address: str, end: Callable[[], None]) -> None:
        """`end`: makes tasks end soon in the process that calls it. LocalFault without the extra; Unreachable if no scheduler, or no worker, is there."""
        self._dask, self._distributed = _dask(), _distributed()
        self._end = end
        self._heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
        """Futures that are done; None: it was stopped."""
        self.name = address
        # What it would say of trouble, tracebacks included, is told by our errors.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self._client = self._connected(address)
        self.workers = self._threads()
        if not self.workers:
            self._client.close()
            raise self._no_workers()

    def map(self, tasks: Sequence[Task[T]], take: Callable[[T], None]) -> bool:
        """See `Engine`."""
        delayed = self._dask.delayed
        futures = self._client.compute([delayed(task, traverse=False)() for task in tasks], optimize_graph=False)
        for future in futures:
            future.add_done_callback(self._heard.put)
        left = len(futures)
        try:
            while left:
                try:
                    heard = self._heard.get(timeout=LOOK_S)
                except queue.Empty:
                    if not self._threads():
                        raise self._no_workers() from None
                    continue
                if heard is None:
                    return False
                left -= 1
                take(self._result(heard))
                heard.release()
        finally:
            if left:
                self._client.cancel(futures, force=True)
        return True

    def stop(self) -> None:
        """See `Engine`."""
        self._heard.put(None)

    def close(self) -> None:
        """See `Engine`."""
        with suppress(OSError):  # of a scheduler that is gone: then its workers end by themselves
            self._client.run(self._end, on_error="ignore")
        self._client.close()

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

    def _threads(self) -> int:
        try:
            return sum(self._client.nthreads().values())
        except OSError as error:
            raise self._gone() from error

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


def checked_address(address: str, *, is_secret: bool) -> str:
    """The address of a scheduler; UsageFault if it is none, or does not hide what is secret (specs/32-partitions.md, What is sent)."""
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
    return address


def _is_here(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


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
