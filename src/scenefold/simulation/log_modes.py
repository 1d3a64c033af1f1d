"""Where a run shows what becomes of modes: clients that sign and render, nodes that answer them, disks (specs/17-simulation.md, Logs)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial

from scenefold.base.ids import SceneId
from scenefold.client.leases import Leases
from scenefold.client.scene import Scene
from scenefold.peer import NodeContext
from scenefold.simulation.clients import Client
from scenefold.simulation.cluster import Cluster
from scenefold.simulation.disks import found_at, incarnation_of, place_of, version_in
from scenefold.simulation.fencing import see_fenced, see_signed
from scenefold.simulation.history import Digest, Place, Version
from scenefold.simulation.lineage import Holder
from scenefold.simulation.log_frozen import Acting, Frozen
from scenefold.simulation.log_history import Wrong
from scenefold.store.layout import RECORDS
from scenefold.wire import LeaseUse, SceneLogPublic, SceneMode


class ModesWatch:
    """`say` is told what does not hold, and at which nodes."""

    def __init__(self, cluster: Cluster, scene: SceneId, say: Callable[[Iterable[Wrong], int | None], None]) -> None:
        self.frozen = Frozen(cluster.watch.recorder.histories.moment)
        self._cluster, self._scene, self._say = cluster, scene, say
        self._renders: dict[str, tuple[int, Callable[[], int]]] = {}
        """By client: under which floor it renders, and by a lease of which position."""
        cluster.eyes = self
        cluster.watch.recorder.shown = self._shown
        for slot, node in cluster.running.items():
            if node.context is not None:
                self.comes_up(slot, node.context)

    def decided(self, header: SceneLogPublic) -> None:
        self.frozen.decided(header.position, header.mode)

    def looks_at(self, client: Client) -> None:
        """What this client signs is judged from now on."""
        see_signed(client.calls, partial(self._signs, client.name))

    # ------------------------------------------------------------------------------------------------------- nodes

    def comes_up(self, slot: int, context: NodeContext) -> None:
        def fenced(scene: SceneId, floor: int) -> None:
            if scene == self._scene:
                self.frozen.fenced(self._holder(slot), floor)

        see_fenced(context, fenced)

    def committed(self, slot: int) -> None:
        """Something has become durable on a disk."""
        disk = self._cluster.nodes[slot].disk
        changed = [key for key, _ in disk.replaced(RECORDS)]
        if not changed:
            return
        table, holder = disk.peek(RECORDS), self._holder(slot)
        for key in changed:
            place, value = place_of(key), table.get(key)
            version = None if value is None or place.scene != self._scene else version_in(value)
            if version is not None:
                self.frozen.came(holder, place, version)

    def taken(self, slot: int, place: Place, version: Version) -> None:
        if place.scene == self._scene:
            self._say(self.frozen.taken(self._holder(slot), place, version), slot)

    def _holder(self, slot: int) -> Holder:
        return Holder(slot, incarnation_of(self._cluster.nodes[slot].disk) or b"")

    def _active(self) -> Iterator[Acting]:
        """What those who decide take for active just now, each by its own clock."""
        for slot, node in sorted(self._cluster.running.items()):
            modes = None if node.context is None else node.context.participation.modes_of(self._scene)
            if modes is not None and modes.is_active:
                yield Acting(f"n{slot}", modes.public.position)

    # ----------------------------------------------------------------------------------------------------- clients

    def _signs(self, who: str, leased: int) -> None:
        self._say(self.frozen.acts(who, "signs an edit", leased, self._active()), None)

    @contextmanager
    def rendering(self, name: str, scene: Scene, leases: Leases) -> Iterator[None]:
        """This client renders what it reads in here: in render mode, and under a lease where it needs one."""
        access = scene.access
        assert access.identity.mode is SceneMode.RENDER and access.writer is not None
        lease = leases.of(access, access.writer, LeaseUse.RENDER) if access.identity.deciders else None
        floor = access.identity.read_floor

        def leased() -> int:
            held = None if lease is None else lease.loan.held
            return floor if held is None else held.position

        self._renders[name] = floor, leased
        try:
            yield
        finally:
            del self._renders[name]

    def _shown(self, name: str, place: Place, version: Version | None, floor: int) -> None:
        """A client is given what an owner says lies there."""
        mine = self._renders.get(name)
        if mine is None or place.scene != self._scene or floor < mine[0]:
            # It renders nothing, or takes nothing of who goes by an older header.
            return
        self._say(self.frozen.acts(name, "renders", mine[1](), self._active()), None)
        disks = [node.disk for node in self._cluster.nodes.values()]

        def there() -> Iterator[Digest]:
            return (found.digest for disk in disks if (found := found_at(disk, place)) is not None)

        owner = self._cluster.watch.lineage.holder_of(place.home).holder
        self._say(self.frozen.looked(name, mine[0], place, version, there, owner), None)
