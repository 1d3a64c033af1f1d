"""The workload `renders` in a run: a scene in the store, clients that have it rendered, and at the end the judge (specs/17-simulation.md, Renders)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import trio

from scenefold.client.importing import PreparedImport, _Marks, store_import
from scenefold.render.rehearsal.lattice import lattice
from scenefold.scene.importers.plan import ImportPlan
from scenefold.simulation import laws
from scenefold.simulation.clients import Client
from scenefold.simulation.cluster import Cluster
from scenefold.simulation.outcome import IMAGES_MIN, Order, Renders
from scenefold.simulation.render_bounds import beyond, left_of_jobs
from scenefold.simulation.render_nodes import RenderNodes
from scenefold.simulation.render_work import Gallery, RenderClient

LOOK_S = 0.25
"""Between two looks at what nodes hold."""
LET_GO_S_MAX = 150.0
"""A part whose organiser died ends within 65 s; an organiser that is told to end asks silent nodes for half a minute, and again."""
CALM_TRIES, CALM_S_MAX = 3, 60.0
"""A small image takes a few seconds; a node that has just come back may cost an attempt."""


class RenderDrama:
    """One for a run. Made before the nodes start; `begin` is called once the scene is there."""

    def __init__(self, cluster: Cluster, order: Order) -> None:
        self._cluster, self._order = cluster, order
        self._nodes = RenderNodes(cluster)
        cluster.extensions = (*cluster.extensions, self._nodes.extension)
        self.gallery = Gallery(self._violated, partial(cluster.watch.tell, None, "{}"))
        self._clients: list[RenderClient] = []
        self._told: set[str] = set()

    @property
    def renders(self) -> Renders:
        """What came of what clients wanted."""
        return Renders(*(self.gallery.counts[name.replace("_", " ")] for name in Renders._fields))

    @property
    def is_enough(self) -> bool:
        """Whether there is something to judge."""
        return self.gallery.done >= IMAGES_MIN

    async def begin(self, clients: Sequence[Client], nursery: trio.Nursery) -> None:
        """Store the scene; from now on it may be rendered."""
        scene = clients[0].scene
        assert scene is not None
        await store_import(scene.access, PreparedImport(ImportPlan(lattice()), _Marks(), 0.0), lambda _state: None)
        self._clients = [RenderClient(client, self._cluster.facts, self._order.seed, self.gallery) for client in clients]
        nursery.start_soon(self._look)

    def start(self, nursery: trio.Nursery, stop: trio.Event) -> None:
        """Everybody begins to work."""
        for client in self._clients:
            nursery.start_soon(client.run, stop)

    async def settle(self) -> None:
        """All has healed: an image comes soon, and nothing is left of any render."""
        for client in self._clients:
            await client.let_go()
        if not await self._has_image():
            self._violated(laws.ENDED, f"in calm weather there is no image, wanted {CALM_TRIES} times for {CALM_S_MAX:g} s")
        with trio.move_on_after(LET_GO_S_MAX):
            while any(left_of_jobs(self._nodes.services)):  # noqa: ASYNC110 - jobs tell nobody that they are over
                await trio.sleep(1.0)
        for slot, what in left_of_jobs(self._nodes.services):
            self._violated(laws.LET_GO, f"{LET_GO_S_MAX:g} s after all renders have ended n{slot} {what}", slot)

    async def _has_image(self) -> bool:
        before = self.gallery.done
        for _ in range(CALM_TRIES):
            await self._clients[0].want(self._clients[0].options(self._order.seed), CALM_S_MAX)
            if self.gallery.done > before:
                return True
        return False

    async def _look(self) -> None:
        """Each kind of excess is told once."""
        while True:
            for slot, what in beyond(self._nodes.services):
                kind = "".join(letter for letter in what if not letter.isdigit())
                if kind not in self._told:
                    self._told.add(kind)
                    self._violated(laws.CREDIT, f"n{slot}: {what}", slot)
            await trio.sleep(LOOK_S)

    def _violated(self, law: str, what: str, *slots: int) -> None:
        self._cluster.watch.violated(law, what, slots=slots)
