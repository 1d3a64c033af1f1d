"""Nodes that observe a scene: somebody names them and lets them go, and they render by leases of their own (workload `logs`;
specs/17-simulation.md, Logs).
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

import trio

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.peer.modes.own_use import OwnUse
from scenefold.scene.layout import META
from scenefold.scene.log import SceneLog
from scenefold.simulation.clients import Client
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.log_editing import LOOK_PAUSE_S, RENDER_S, complaining
from scenefold.simulation.log_members import is_fit, member_of
from scenefold.simulation.log_modes import ModesWatch
from scenefold.simulation.log_work import LogClient
from scenefold.wire import AddObserver, LogEntry, RemoveObserver, SceneMode

FIRST_S = 1.0
BETWEEN_S = (5.0, 25.0)
"""Between two changes: where one was removed lately a mode becomes active late."""
OBSERVERS_MAX = 2
BETWEEN_RENDERS_S = (6.0, 20.0)
"""Clients render as well, and as long as anybody does the mode stays."""
REMOVED = 0.3
"""Odds that one is let go for no reason, where there might be more."""


class ObserverSteward:
    """He names observers of the nodes in `slots` that do not decide, and lets go those that lost their disks, and now and then another one; any
    while fewer than `count` decide.
    """

    def __init__(self, cluster: Cluster, client: LogClient, seed: int, slots: Sequence[int], count: int) -> None:
        self._cluster, self._client, self._slots, self._count = cluster, client, slots, count
        self.observing: frozenset[NodeId] = frozenset()
        """By the log as he saw it last."""
        self._dice = random.Random(f"observers/{seed}")

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop; a change that has begun is ended, or given up."""
        pause_s = FIRST_S
        while not stop.is_set():
            await trio.sleep(pause_s)
            pause_s = self._dice.uniform(*BETWEEN_S)
            pick, removes = self._dice.random(), self._dice.random() < REMOVED
            await self._client.want(lambda log, pick=pick, removes=removes: self._change(log, pick, removes=removes))  # type: ignore[misc]

    def _change(self, log: SceneLog, pick: float, *, removes: bool) -> LogEntry:
        self.observing = frozenset(entry.member.node for entry in log.roster.observers)
        observers = [(entry.member, self._cluster.nodes[self._cluster.slot_of(entry.member.node)]) for entry in log.roster.observers]
        lost = [member for member, node in observers if not is_fit(node) or member_of(node) != member]
        if lost:
            return RemoveObserver(lost[0])
        too_few = len(log.roster.participants) < self._count
        deciding = {entry.member.node for entry in (*log.roster.participants, *log.roster.observers)}
        nodes = [self._cluster.nodes[slot] for slot in self._slots]
        others = [node for node in nodes if node.node_id not in deciding and is_fit(node) and node.context is not None]
        if others and not too_few and len(observers) < OBSERVERS_MAX and not (observers and removes):
            node = others[int(pick * len(others))]
            return AddObserver(member_of(node), node.secrets.signing.public.raw)
        if observers:
            return RemoveObserver(observers[int(pick * len(observers))][0])
        raise LocalFault("every node that may take part decides already")


class OwnRenders:
    """Images that observing nodes make by their own leases, one after the other. `client` reads for them, and holds no lease for that."""

    def __init__(
        self,
        cluster: Cluster,
        client: Client,
        places: Sequence[Location],
        seed: int,
        modes: ModesWatch,
        nonsense: Callable[[], int],
        wrong: list[str],
    ) -> None:
        self._cluster, self._client, self._places, self._modes = cluster, client, places, modes
        self._nonsense, self._wrong = nonsense, wrong
        self._dice = random.Random(f"own renders/{seed}")
        self._has_begun = False

    async def run(self, stop: trio.Event) -> None:
        while not stop.is_set():
            await trio.sleep(self._dice.random() * 2 * LOOK_PAUSE_S)
            observing = list(self._observing())
            if observing:
                slot, node, use = self._dice.choice(observing)

                async def render(slot: int = slot, node: Node = node, use: OwnUse = use) -> None:
                    await self._render(slot, node, use)

                self._has_begun = False
                await complaining(f"n{slot} for itself", render, self._nonsense, self._wrong)
                if self._has_begun:
                    with trio.move_on_after(self._dice.uniform(*BETWEEN_RENDERS_S)):
                        await stop.wait()

    def _observing(self) -> Sequence[tuple[int, Node, OwnUse]]:
        """Who might begin to render now."""
        scene = self._client.scene
        assert scene is not None
        found = []
        for slot, node in sorted(self._cluster.running.items()):
            use = None if node.context is None else node.context.participation.own_use(scene.id)
            if use is not None and use.modes.public.mode is SceneMode.RENDER:
                found.append((slot, node, use))
        return found

    async def _render(self, slot: int, node: Node, use: OwnUse) -> None:
        scene, context = self._client.scene, node.context
        assert scene is not None
        assert context is not None
        async with use.hold(SceneMode.RENDER):
            self._has_begun = True
            if use.modes.public.position > scene.access.identity.position:
                await scene.access.refresh(use.modes.public.position)
            if scene.access.identity.read_floor != use.modes.public.write_floor:
                # The client has heard of another mode by now: nothing that it reads is of this image.
                return
            with (
                self._modes.observing(slot, context, use.modes, self._client.name) as lives,
                trio.move_on_after(self._dice.uniform(*RENDER_S)),
            ):
                while lives():
                    await scene.access.get([(META, place) for place in self._dice.sample(self._places, len(self._places))])
                    await trio.sleep(self._dice.random() * 2 * LOOK_PAUSE_S)
