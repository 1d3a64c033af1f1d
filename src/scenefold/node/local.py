"""A cluster on this machine: N node processes at 127.0.0.2 and up, with real sockets, TLS and stores.

For trying things (`scenectl node local 5`), for `render still` without a profile, and for tests. Whoever enters
`local_cluster` gets nodes that know each other; whoever leaves it leaves none behind. A node that dies meanwhile ends the
caller's block with that node's own error, since nothing that waits for it would come to an end by itself; unless it was said
that others do without it (`may_die`): then it is started again, for what it stores.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import AsyncIterator, Collection, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import trio

from scenefold.base.errors import LocalFault, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.node.process import NodeEnded, NodeProcess
from scenefold.peer.settings import machine_memory_bytes, processors
from scenefold.world import Ports, background_tasks
from scenefold.world.profile import ClusterProfile

FIRST_ADDRESS = "127.0.0.2"
START_S_MAX = 60.0
"""For all nodes to be ready and to know each other: 127 interpreters on two cores take about as long."""
LAST_WORDS_S_MAX = 1.0
"""From the end of a node's connections to the end of its process."""
LIVES = 4
"""Of a node that may die: one that dies again and again has a reason for it that everybody should hear."""
_PROFILE = "profile"


class LocalCluster:
    """Nodes of one profile, each a process. Made by `local_cluster`."""

    def __init__(self, folder: Path, known: ClusterProfile, options: Sequence[str], nursery: trio.Nursery, module: str) -> None:
        self.folder = folder
        self.known = known
        self._options = options
        self._module = module
        self._nursery = nursery
        self._nodes: dict[str, NodeProcess] = {}
        self._lives: dict[str, int] = {}
        """Of those that may die, how many are left."""
        self.deaths: dict[str, ScenefoldError] = {}
        """Of those that died though they may, and not on purpose: what they said last; the newest last."""
        self._crashed: set[str] = set()

    @property
    def profile(self) -> Path:
        """The folder to give to `connect` or --profile."""
        return self.known.folder

    @property
    def addresses(self) -> tuple[str, ...]:
        """The founders' addresses, which is their order along the line in the beginning."""
        return tuple(map(address_of, self.known.founders))

    @property
    def spares(self) -> tuple[str, ...]:
        """The addresses of nodes that may join: `start` them."""
        return tuple(member.address for member in self.known.members if member.node_id not in self.known.founders)

    def log(self, address: str) -> Path:
        """What the node wrote to stderr."""
        return self.folder / "logs" / f"{address}.log"

    def pid(self, address: str) -> int | None:
        return self._nodes[address].pid

    def start(self, address: str) -> None:
        """Start a node that is not running; `wait` for it."""
        before = self._nodes.get(address)
        assert before is None or before.ended.is_set(), f"node {address} is running"
        arguments = ["--profile", str(self.profile), "--address", address]
        arguments += ["--data", str(self.folder / "data" / address), *self._options]
        node = self._nodes[address] = NodeProcess(address, arguments, self.log(address), self._module)
        self._nursery.start_soon(self._run, node)

    async def _run(self, node: NodeProcess) -> None:
        try:
            await node.run()
        except NodeEnded as ended:
            if node.address in self._crashed:
                self._crashed.discard(node.address)
            else:
                self.deaths.pop(node.address, None)
                self.deaths[node.address] = ended.error
            lives = self._lives.get(node.address, 1) - 1
            if not lives:
                raise
            self._lives[node.address] = lives
            self.start(node.address)

    def may_die(self, addresses: Collection[str]) -> None:
        """Of these nodes, and no others, one that dies from now on is started again, a few times."""
        self._lives = dict.fromkeys(addresses, LIVES)

    def crash(self, address: str) -> None:
        """Let a node that may die do so now, as in a power cut; it is started again."""
        assert address in self._lives, f"node {address} is needed"
        self._crashed.add(address)
        self._nodes[address].crash()

    async def wait(self, addresses: Sequence[str] | None = None, *, joined: bool = True, seconds: float = START_S_MAX) -> None:
        """Return once these nodes (the founders) listen and, if `joined`, are members that know the others; LocalFault if that
        takes too long."""
        nodes = [self._nodes[address] for address in (self.addresses if addresses is None else addresses)]
        waiting = {node.address: node.joined if joined else node.ready for node in nodes}
        with trio.move_on_after(seconds):
            for event in waiting.values():
                await event.wait()
            return
        late = ", ".join(address for address, event in waiting.items() if not event.is_set())
        raise LocalFault(
            f"nodes are not ready after {seconds:g} s: {late}",
            where=str(self.folder / "logs"),
            remedy="their logs say more",
        )

    async def ended(self, address: str) -> None:
        """Return once a node's process has ended, as that of one does that has left the cluster."""
        await self._nodes[address].ended.wait()

    def expect_end(self, address: str) -> None:
        """This node may die by itself from now on, which ends nothing else; `ended` tells."""
        self._nodes[address].expect_end()

    async def stop(self, address: str) -> None:
        """End one node in order."""
        await self._nodes[address].stop()

    async def kill(self, address: str) -> None:
        """End one node without warning."""
        await self._nodes[address].kill()


@asynccontextmanager
async def local_cluster(
    count: int,
    folder: Path | None = None,
    *,
    spares: int = 0,
    name: str = "local",
    ports: Ports | None = None,
    threads: int | None = None,
    memory_bytes: int = 0,
    first_address: str = FIRST_ADDRESS,
    options: Sequence[str] = (),
    module: str = "scenefold.node",
    start_s_max: float = START_S_MAX,
    trust: bool = False,
) -> AsyncIterator[LocalCluster]:
    """`count` nodes that are ready and know each other, and `spares` more that can be started to join them.

    `folder` gets profile/, data/ and logs/, and keeps them; one that holds such a cluster already is run again. None: a
    temporary folder, removed at the end. `threads` render in each node; by default the machine's are shared out,
    and so are three quarters of its memory.
    `options` are further arguments of `python -m scenefold.node`, or of another `module` that runs one. `trust`: a cluster that is made here trusts all its nodes, so that they
    render; else its first node only.
    """
    if not 1 <= count <= POOL_NODES_MAX:
        raise LocalFault(f"a local cluster of {count} nodes", remedy=f"choose a number from 1 to {POOL_NODES_MAX}")
    place = Path(tempfile.mkdtemp(prefix="scenefold-")) if folder is None else folder
    try:
        known = _profile(place, count, spares, name, ports, first_address, trust=trust)
        arguments = ["--threads", str(threads or max(1, processors() // count)), *options]
        arguments += ["--memory", str(memory_bytes or machine_memory_bytes() * 3 // 4 // count)]
        async with _nodes_end_with_the_block() as nursery:
            cluster = LocalCluster(place, known, arguments, nursery, module)
            for address in cluster.addresses:
                cluster.start(address)
            await cluster.wait(seconds=start_s_max)
            yield cluster
    except ScenefoldError as error:
        if folder is None and error.where.startswith(str(place)):
            error.where = "its folder was a temporary one"
        raise
    finally:
        if folder is None:
            shutil.rmtree(place, ignore_errors=True)


@asynccontextmanager
async def _nodes_end_with_the_block() -> AsyncIterator[trio.Nursery]:
    """A nursery for nodes. If one ends by itself, that is the error, whatever else fails because of it."""
    try:
        async with background_tasks() as nursery:
            try:
                yield nursery
            except (Unreachable, ExceptionGroup):
                # A node that dies closes its connections first. Its own words, which come a moment later, tell more.
                with trio.move_on_after(LAST_WORDS_S_MAX):
                    await trio.sleep_forever()
                raise
    except NodeEnded as ended:
        raise ended.error from None
    except BaseExceptionGroup as group:
        ends = group.subgroup(NodeEnded)
        if ends is None:
            raise
        raise _first(ends).error from group


def _first(group: BaseExceptionGroup[NodeEnded]) -> NodeEnded:
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    assert isinstance(error, NodeEnded)
    return error


def _profile(folder: Path, count: int, spares: int, name: str, ports: Ports | None, first_address: str, *, trust: bool) -> ClusterProfile:
    """The cluster in `folder`, made if there is none; LocalFault if there is one of another size."""
    first = node_id_of(first_address)
    addresses = [address_of(NodeId(first + index)) for index in range(count + spares)]
    where = folder / _PROFILE
    try:
        (folder / "logs").mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        words = problem.strerror or str(problem)
        raise LocalFault(f"the folder cannot be used: {words}", where=str(folder), remedy="choose another folder") from problem
    if not where.exists():
        return ClusterProfile.create(where, name, addresses[:count], spares=addresses[count:], ports=ports, trust_all=trust)
    known = ClusterProfile.load(where)
    founders = [address_of(node) for node in known.founders]
    if founders != addresses[:count] or [member.address for member in known.members] != addresses:
        raise LocalFault(
            f"the folder holds a cluster of {len(founders)} nodes and {len(known.members) - len(founders)} spares",
            where=str(folder),
            remedy="start as many, or choose another folder",
        )
    return known
