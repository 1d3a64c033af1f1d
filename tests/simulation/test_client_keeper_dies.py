"""If this fails, the keeper of a scene's log dies behind its decision, and a user is told that nothing happened."""

from __future__ import annotations

import pytest
import trio

from scenectl.errors import ending_of
from scenefold.base.errors import Unreachable
from scenefold.simulation.clients import Client, MemoryKeyring, open_client
from scenefold.simulation.cluster import Cluster, key_of
from scenefold.simulation.removals import watch_removals
from scenefold.simulation.speed import remembered_signatures
from scenefold.world.sim import Point, SimNet, run_simulated
from simulation.steps import Stage

AWAY_S = 60.0
BOX = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


class Play:
    """Three nodes and a client; the first of them keeps the log."""

    def __init__(self) -> None:
        self.net = SimNet(1)

    def run(self, what: str) -> None:
        with remembered_signatures():
            run_simulated(1, self._play, what, virtual_s_max=2000.0)

    async def _play(self, what: str) -> None:
        async with trio.open_nursery() as nursery:
            self.cluster = cluster = Cluster(self.net, 3, 1, nursery)
            for slot in range(3):
                cluster.start(slot)
            nursery.start_soon(watch_removals, cluster)
            keys = MemoryKeyring()
            writer = key_of(1, "the writer")
            async with open_client("c", self.net.world("user:c"), cluster.facts, keys, writer, cluster.watch.recorder) as client:
                stage = Stage(cluster, client, nursery, None)
                await stage.until(stage.is_quiet, 30.0)
                await (self._create(client, nursery) if what == "create" else self._move(client, nursery))
            nursery.cancel_scope.cancel()

    def _dies_after_its_next_commit(self, nursery: trio.Nursery) -> None:
        def die() -> None:
            self.cluster.crash(0)
            nursery.start_soon(self.cluster.restart, 0, AWAY_S)

        self.net.trap(self.cluster.nodes[0].address, Point.AFTER_COMMIT, 1, die)

    async def _create(self, client: Client, nursery: trio.Nursery) -> None:
        self._dies_after_its_next_commit(nursery)
        with pytest.raises(Unreachable, match="may have happened") as told:
            await client.scenes.create("kitchen")
        assert ending_of(told.value).exit_code == 3
        await trio.sleep(2 * AWAY_S)
        assert (await client.scenes.open("kitchen")).name == "kitchen"

    async def _move(self, client: Client, nursery: trio.Nursery) -> None:
        scene = await client.scenes.create("kitchen")
        hall = await scene.create_space("hall", BOX)
        await trio.sleep(3.0)
        self._dies_after_its_next_commit(nursery)
        with pytest.raises(Unreachable, match="may have happened") as told:
            await hall.translate((1.0, 0.0, 0.0))
        assert ending_of(told.value).exit_code == 3
        await trio.sleep(2 * AWAY_S)
        assert (await hall.info()).world_box[0] == (1.0, 0.0, 0.0)


@pytest.mark.expect_log("connection was cut|connection was reset|no connection to the node|no lease from the voter")
@pytest.mark.parametrize("what", ["create", "move"])
def test_a_keeper_that_dies_behind_its_decision_has_not_refused(what: str) -> None:
    Play().run(what)
