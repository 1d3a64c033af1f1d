"""If this fails, a node that dies in the middle of a proposal leaves two histories behind, or holds up those who are left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest
import trio

from integration.dying_node import PARTICIPANT, POINTS, VARIABLE
from integration.log_disks import check_one_history
from loopback import addresses, free_ports
from scenefold.base.ids import NodeId, node_id_of
from scenefold.client import connect
from scenefold.client.scene import Scene
from scenefold.client.scene_log import LogAccess
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.scene.log import SceneLog
from scenefold.wire import RequestSceneLog, RespondSceneLog, SceneLogPublic, TranslateSpace, Want
from scenefold.world import Links, Priority, open_links, real_world

NODES = 5
TESTS = Path(__file__).resolve().parents[1]
PATIENCE_S = 30.0
"""For a change to be decided by those who are left. How long it takes on a machine at rest, docs/benchmarks.md says."""
LOOK_S = 0.05

pytestmark = pytest.mark.slow


class Author:
    """An owner of the scene, who begins at a node of the test's choice."""

    def __init__(self, scene: Scene, space: int, name: bytes) -> None:
        self.scene = scene
        self.acknowledged: dict[bytes, int] = {}
        self._space, self._name, self._numbers = space, name, count(1)

    @property
    def log(self) -> LogAccess:
        return self.scene.access.log_or_fault()

    async def move(self) -> None:
        """One more change, until it is acknowledged."""
        request = (self._name + b"%d" % next(self._numbers)).rjust(16, b"-")
        with trio.fail_after(PATIENCE_S):
            read = await self.log.propose(self._moved, request_id=request)
        self.acknowledged[request] = read.state.requests[request]

    def _moved(self, log: SceneLog) -> TranslateSpace:
        return TranslateSpace(log.space(self._space).id, (1.0, 0.0, 0.0))

    @contextmanager
    def beginning_at(self, chosen: NodeId) -> Iterator[None]:
        """Meanwhile this one is asked before all others."""
        keepers = self.log.keepers
        plain: Callable[[SceneLogPublic], list[NodeId]] = keepers.to_propose

        def to_propose(public: SceneLogPublic) -> list[NodeId]:
            return sorted(plain(public), key=lambda node: node != chosen)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(keepers, "to_propose", to_propose)
            yield


class Ward:
    """The nodes, one of which dies again and again; and how far each is."""

    def __init__(self, nodes: LocalCluster, links: Links, first: SceneLogPublic, dooms: Path) -> None:
        self.nodes, self._links, self._first, self._dooms = nodes, links, first, dooms

    async def position(self, address: str) -> int:
        request = RequestSceneLog(self._first.scene, self._first.genesis, 0, 1, Want.HEADER)
        reply = await self._links.request(address, Priority.HIGH, request, PATIENCE_S)
        assert isinstance(reply, RespondSceneLog) and reply.answer is not None
        return reply.answer.public.position

    async def all_at(self, position: int) -> None:
        with trio.fail_after(PATIENCE_S):
            for address in self.nodes.addresses:
                while await self.position(address) < position:  # noqa: ASYNC110 - another process gets there, and tells nobody
                    await trio.sleep(LOOK_S)

    async def dies(self, victim: str, point: str, asked: str, one: Author, two: Author) -> tuple[float, float]:
        """The first author begins at a node, and one dies of it, which lacks nothing. Seconds until the second author's next change is
        acknowledged, and until the first one's is. Then the dead one runs again."""
        own_done, dead = trio.Event(), trio.Event()
        own_s = next_s = 0.0

        async def go_on() -> None:
            nonlocal own_s
            await one.move()
            while point in PARTICIPANT and not dead.is_set():
                # A majority needs not all of them: it may have heard of the decision before it was to vote.
                await one.move()
            own_s = trio.current_time()
            own_done.set()

        doom = self._dooms / victim
        self.nodes.expect_end(victim)
        doom.write_text(point)
        async with trio.open_nursery() as nursery:
            with one.beginning_at(node_id_of(asked)):
                nursery.start_soon(go_on)
                with trio.fail_after(PATIENCE_S):
                    await self.nodes.ended(victim)
                died_at = trio.current_time()
                dead.set()
                await two.move()
                next_s = trio.current_time()
                await own_done.wait()
        doom.unlink()
        self.nodes.start(victim)
        await self.nodes.wait([victim])
        return next_s - died_at, own_s - died_at


@pytest.mark.timeout(600)
async def test_whoever_dies_in_a_proposal_the_others_go_on_with_one_history(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dooms = tmp_path / "dooms"
    dooms.mkdir()
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    monkeypatch.setenv(VARIABLE, str(dooms))
    running = local_cluster(NODES, tmp_path, ports=free_ports(addresses(NODES)), module="integration.dying_node", trust=True)
    async with running as nodes, connect(nodes.profile) as cluster, connect(nodes.profile) as other:
        scene = await cluster.scenes.create("stage", participants=NODES)
        space = await scene.create_space("moving", dimensions=3)
        one, two = Author(scene, space.id, b"one"), Author(await other.scenes.open("stage"), space.id, b"two")
        first = (await one.log.newest()).header

        def newest() -> int:
            return max([first.position, *one.acknowledged.values(), *two.acknowledged.values()])

        world = real_world(nodes.known.user_identity(), nodes.known.authority_certificate(), ports=nodes.known.ports)
        async with open_links(world) as links:
            ward = Ward(nodes, links, first, dooms)
            for turn, point in enumerate(POINTS):
                # The one in the middle asks for no promises: it is asked where its vote is the first that is durable, and where all are told.
                victim, neighbour = (nodes.addresses[(turn + more) % NODES] for more in (-1, 0))
                await ward.all_at(newest())
                asked = neighbour if point in PARTICIPANT else victim
                next_s, own_s = await ward.dies(victim, point, asked, one, two)
                print(f"{point:18} next change after {next_s:5.2f} s, the one in which it died after {own_s:5.2f} s", flush=True)
            await ward.all_at(newest())
            for address in nodes.addresses:
                await nodes.stop(address)
        folders = [nodes.folder / "data" / address for address in nodes.addresses]
        check_one_history(folders, first.genesis, {**one.acknowledged, **two.acknowledged})
        assert len(one.acknowledged) >= len(two.acknowledged) == len(POINTS)
