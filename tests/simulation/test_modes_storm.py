"""If this fails, somebody holds a lease of a mode that another one, on whole nodes, holds to be over (I7)."""

from __future__ import annotations

from random import Random

import pytest
import trio

from scenefold.wire import SceneMode, SetMode
from simulation.assembly import Assembly, assembled

NODES = 3
ROUNDS = 10


class Judge:
    """Looks at all nodes that run, all the time."""

    def __init__(self, them: Assembly) -> None:
        self.them = them
        self.leased = self.switched = 0

    async def run(self) -> None:
        while True:
            self.look()
            await trio.sleep(0.1)

    def look(self) -> None:
        leases, active = [], 0
        for slot in range(NODES):
            context = self.them.node(slot).context
            one = None if context is None else context.participation.of(self.them.scene)
            if context is None or one is None:
                continue
            now, standing = context.world.clock.now(), one.modes.standing
            lease = standing.holder.lease(now)
            leases += [] if lease is None else [lease.position]
            if standing.activation.switch is not None and standing.is_active(now):
                active = max(active, standing.activation.switch.position)
        self.leased += bool(leases)
        self.switched = max(self.switched, active)
        assert all(position >= active for position in leases), (leases, active)


@pytest.mark.parametrize("seed", range(3))
def test_41_switches_while_nodes_die_and_are_cut_off(seed: int) -> None:
    async def main(them: Assembly) -> None:
        random = Random(seed)
        await them.create(*range(NODES))
        judge = Judge(them)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(judge.run)
            mode = SceneMode.EDIT
            for _ in range(ROUNDS):
                victim = random.randrange(NODES)
                others = [slot for slot in range(NODES) if slot != victim]
                for slot in range(NODES):
                    one = them.of(slot).participation.of(them.scene)
                    assert one is not None
                    nursery.start_soon(one.modes.acting, 2.0)
                await trio.sleep(random.choice([0.5, 3.0, 14.0]))
                mode = SceneMode(1 - mode)
                if random.random() < 0.5:
                    parted = them.cluster.net.partition([them.node(slot).address for slot in others], [them.node(victim).address])
                    await them.commits(others[0], SetMode(mode), tries=80)
                    await trio.sleep(random.choice([0.5, 6.0, 14.0]))
                    them.cluster.net.unite(parted)
                else:
                    them.crash(victim)
                    await them.commits(others[0], SetMode(mode), tries=80)
                    await trio.sleep(random.choice([0.5, 6.0]))
                    await them.start(victim)
                await them.until(lambda victim=victim: them.takes_part(victim))
            nursery.cancel_scope.cancel()
        assert judge.leased > 50 and judge.switched > ROUNDS / 2

    assembled(NODES, main, seed + 1)
