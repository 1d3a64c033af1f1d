"""What `bench store` does: how fast a cluster takes records for good, and gives them back, with so many copies of each.

The whole way counts: sealed and signed by a client, sent, verified, stored durably by as many nodes as must have it, and back, every
byte compared. How many copies there really are is not taken from what the space shall have: it is counted in what the nodes report
that they hold.
"""

from __future__ import annotations

import gc
import os
import statistics
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import trio

from scenectl import bench_weather
from scenectl.output import table

if TYPE_CHECKING:
    from scenefold.base.location import Location
    from scenefold.client import Cluster, Space
    from scenefold.client.new_space import SpaceOptions
    from scenefold.node.local import LocalCluster
    from scenefold.world import Ports

MIB = 1 << 20
LARGE_BYTES = 60 * 1024
SMALL_BYTES = 8 * 1024
CALLERS = 3
"""At a time: so there is always something to be sealed, something on its way, and something being stored."""
LARGE_BATCH = 68
"""Records of one call, some 4 MiB."""
SMALL_BATCH = 256
WARM_RECORDS = 64
SETTLE_S_MAX = 30.0
"""For what is owed to holders that were not waited for; and before, until the nodes have found out who holds what."""
GRACE_S = 12.0
"""A new cluster has all of its holders by then, or will not have them."""
LOOK_S = 0.1
_MIX = 0x9E3779B97F4A7C15
"""An odd number, so that multiples of it spread the records over the line, and no two meet."""
_LOW_BYTES = 12
"""Of a location, behind the 64 bits that are chosen."""


@dataclass(frozen=True, kw_only=True)
class StoreBench:
    """What to measure."""

    mib: int
    """Of large records."""
    small_records: int
    copies: int
    min_copies: int | None
    seconds: float
    """Most for each measurement: what was done until then counts."""
    weather: bool = False
    """Whether reads are measured in bad weather, too: of a cluster of its own."""


@dataclass(frozen=True)
class Turn:
    """One measurement: what was done, and what that took."""

    records: int
    seconds: float
    cpu_s: float | None
    waits_s: Sequence[float]
    """Of each call, until all of its records were durable, or there."""

    @property
    def rate(self) -> float:
        return self.records / self.seconds


class StoreWork:
    """Records of one size, numbered, each with a place and bytes of its own, written and read by several callers at once."""

    def __init__(self, space: Space, size: int, batch: int, first: int, cpu_s: Callable[[], float | None]) -> None:
        self._space = space
        self._batch = batch
        self._first = first
        self._cpu_s = cpu_s
        self._bytes = os.urandom(size)

    def payload(self, number: int) -> bytes:
        return number.to_bytes(8, "big") + self._bytes[8:]

    async def write(self, records: int, seconds: float) -> Turn:
        async def call(numbers: Sequence[int]) -> None:
            await self._space.put_many([(place(number), self.payload(number)) for number in numbers])

        return await self._turn(call, records, seconds)

    async def read(self, records: int, seconds: float) -> Turn:
        return await self._turn(self.check, records, seconds)

    async def check(self, numbers: Sequence[int]) -> None:
        """Read these; LocalFault if one is not what was written."""
        from scenefold.base.errors import LocalFault

        found = await self._space.get_many([place(number) for number in numbers])
        if any(one != self.payload(number) for one, number in zip(found, numbers, strict=True)):
            raise LocalFault("a record that was read is not what was written", remedy="that is a bug: please report it")

    async def _turn(self, call: Callable[[Sequence[int]], Awaitable[None]], records: int, seconds: float) -> Turn:
        left: Iterator[int] = iter(range(self._first, self._first + records))
        waits: list[float] = []
        done = 0
        cpu_s, begun = self._cpu_s(), time.monotonic()

        async def caller() -> None:
            nonlocal done
            while time.monotonic() - begun < seconds and (numbers := list(islice(left, self._batch))):
                asked = time.monotonic()
                await call(numbers)
                waits.append(time.monotonic() - asked)
                done += len(numbers)

        async with trio.open_nursery() as nursery:
            for _ in range(CALLERS):
                nursery.start_soon(caller)
        took, spent = time.monotonic() - begun, self._cpu_s()
        return Turn(done, took, None if cpu_s is None or spent is None else spent - cpu_s, waits)


async def bench_store(bench: StoreBench, profile: str | None, nodes: int, ports: Ports | None) -> dict[str, Any]:
    """Measure, in a cluster of its own if no profile is given, and return the report (docs/reference/scenectl.md)."""
    from scenectl.running import connected
    from scenefold.client import connect
    from scenefold.node.local import local_cluster

    async with AsyncExitStack() as stack:
        own: LocalCluster | None = None
        if profile is None:
            more: dict[str, Any] = {"module": bench_weather.NODE, "options": bench_weather.OPTIONS} if bench.weather else {}
            own = await stack.enter_async_context(local_cluster(nodes, ports=ports, **more))
            cluster = await stack.enter_async_context(connect(own.profile))
            gc.freeze()  # as in `connected`
        else:
            cluster = await stack.enter_async_context(connected(profile))
        # Its own spaces stay empty: nodes shall place holders for what is measured alone.
        scene = await cluster.scenes.create(f"bench-{os.urandom(4).hex()}", copies=1)
        options: SpaceOptions = {"copies": bench.copies}
        if bench.min_copies is not None:
            options["copies_min"] = bench.min_copies
        space = await scene.create_space("bench", **options)
        info, count = await space.info(), len(await cluster.nodes())
        report: dict[str, Any] = {"nodes": count, "copies": info.copies, "copies_min": info.copies_min}
        report |= await _measure(bench, cluster, space, min(bench.copies, count), clock_of(own))
        if own is not None and bench.weather:
            work = StoreWork(space, SMALL_BYTES, SMALL_BATCH, bench_weather.FIRST, lambda: None)
            report["weather"] = await bench_weather.weather(own, work)
        return report


async def _measure(bench: StoreBench, cluster: Cluster, space: Space, copies: int, cpu_s: Callable[[], float | None]) -> dict[str, Any]:
    """`copies`: how many there can be."""
    await _until_holders_are_found(cluster, space, copies, cpu_s)
    large = StoreWork(space, LARGE_BYTES, LARGE_BATCH, 1 << 32, cpu_s)
    small = StoreWork(space, SMALL_BYTES, SMALL_BATCH, 1 << 33, cpu_s)
    before, begun = await held(cluster), time.monotonic()
    written = await large.write(max(1, bench.mib * MIB // LARGE_BYTES), bench.seconds)
    found = await _copies_after(cluster, before, written.records, copies)
    copied_s = time.monotonic() - begun
    read = await large.read(written.records, bench.seconds)
    before = await held(cluster)
    small_written = await small.write(bench.small_records, bench.seconds)
    small_found = await _copies_after(cluster, before, small_written.records, copies)
    small_read = await small.read(small_written.records, bench.seconds)
    mib = written.records * LARGE_BYTES / MIB
    read_mib = read.records * LARGE_BYTES / MIB
    return {
        "mib": mib,
        "record_bytes": LARGE_BYTES,
        "small_records": small_written.records,
        "small_record_bytes": SMALL_BYTES,
        "callers": CALLERS,
        "small_records_per_call": SMALL_BATCH,
        "write_mib_s": mib / written.seconds,
        "read_mib_s": read_mib / read.seconds,
        "small_writes_per_s": small_written.rate,
        "small_reads_per_s": small_read.rate,
        "p50_ms": 1000 * _part(small_written.waits_s, 0.5),
        "p99_ms": 1000 * _part(small_written.waits_s, 0.99),
        "cpu_s_per_mib": None if written.cpu_s is None else written.cpu_s / mib,
        "read_cpu_s_per_mib": None if read.cpu_s is None else read.cpu_s / read_mib,
        "copies_found": min(found, small_found),
        "copied_mib_s": mib / copied_s if found >= copies else None,
    }


def place(number: int) -> Location:
    """Anywhere on the line: neighbours by number are none by place."""
    from scenefold.base.location import Location

    return Location((number * _MIX % (1 << 64)).to_bytes(8, "big") + bytes(_LOW_BYTES))


async def held(cluster: Cluster) -> int:
    """Records on all nodes together, as they report themselves. Raises what kept one of them from saying: no answer is no count of zero."""
    from scenefold.base.errors import ScenefoldError

    total = 0
    for report in (await cluster.reports()).values():
        if isinstance(report, ScenefoldError):
            raise report
        total += report.records
    return total


async def _copies_after(cluster: Cluster, before: int, records: int, copies: int) -> float:
    """How many there are of each record, on average, once all that is wanted is there, or nothing more has come for long."""
    found = most = 0
    with trio.move_on_after(SETTLE_S_MAX):
        changed = time.monotonic()
        while found < copies * records and time.monotonic() - changed < GRACE_S:
            await trio.sleep(LOOK_S if found else 0)
            found = await held(cluster) - before
            if found > most:
                most, changed = found, time.monotonic()
    return found / records


async def _until_holders_are_found(cluster: Cluster, space: Space, copies: int, cpu_s: Callable[[], float | None]) -> None:
    """Write a few records until they are everywhere: a new cluster gives placement some time before it believes it."""
    from scenefold.base.errors import Refused

    work = StoreWork(space, SMALL_BYTES, SMALL_BATCH, 0, cpu_s)
    before = await held(cluster)
    with trio.move_on_after(SETTLE_S_MAX):
        while True:
            try:
                await work.write(WARM_RECORDS, SETTLE_S_MAX)
                break
            except* Refused:
                # Too few holders as yet.
                await trio.sleep(LOOK_S)
    await _copies_after(cluster, before, WARM_RECORDS, copies)


def clock_of(nodes: LocalCluster | None) -> Callable[[], float | None]:
    """Processor seconds of this process and all nodes; None where nobody says, as of a cluster that runs elsewhere."""

    def spent() -> float | None:
        stats = [] if nodes is None else [Path(f"/proc/{nodes.pid(address)}/stat") for address in nodes.addresses]
        if not stats or not all(stat.exists() for stat in stats):
            return None
        ticks = sum(sum(map(int, stat.read_text().rpartition(")")[2].split()[11:13])) for stat in stats)
        return ticks / os.sysconf("SC_CLK_TCK") + time.process_time()

    return spent


def _part(waits_s: Sequence[float], part: float) -> float:
    """So long, or less, took this part of all calls."""
    return waits_s[0] if len(waits_s) == 1 else statistics.quantiles(waits_s, n=100, method="inclusive")[round(part * 100) - 1]


def bench_text(report: dict[str, Any]) -> str:
    """The report for people."""
    cpu = {key: "" if report[key] is None else f"{1000 * report[key]:.1f}" for key in ("cpu_s_per_mib", "read_cpu_s_per_mib")}
    small = {way: report[f"small_{way}s_per_s"] for way in ("write", "read")}
    rows = [
        (way, "60 KiB", f"{report[f'{way}_mib_s'] * MIB / LARGE_BYTES:,.0f}", f"{report[f'{way}_mib_s']:,.1f}", cpu[key])
        for way, key in (("write", "cpu_s_per_mib"), ("read", "read_cpu_s_per_mib"))
    ]
    rows += [(way, "8 KiB", f"{rate:,.0f}", f"{rate * SMALL_BYTES / MIB:,.1f}", "") for way, rate in small.items()]
    wanted = f"{report['copies']} copies wanted, {report['copies_min']} waited for, {report['copies_found']:.2f} found on {report['nodes']} nodes"
    late = "" if report["copied_mib_s"] is None else f"; with all copies there, {report['copied_mib_s']:,.1f} MiB/s"
    waits = f"8 KiB, {report['small_records_per_call']} a call: durable after {report['p50_ms']:,.0f} ms (median), {report['p99_ms']:,.0f} ms (99 %)"
    told = f"{table(('direction', 'record', 'records/s', 'MiB/s', 'processor ms/MiB'), rows)}\n{wanted}{late}\n{waits}"
    return f"{told}\n\n{bench_weather.weather_text(report['weather'])}" if "weather" in report else told
