"""Where a run shows what becomes of modes: clients that sign and render, nodes that answer them, disks (specs/17-simulation.md, Logs)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

from scenefold.base.ids import SceneId
from scenefold.client.leases import Leases
from scenefold.client.scene import Scene
from scenefold.peer import NodeContext
from scenefold.peer.modes.scene_modes import SceneModes
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


class _Rendering(NamedTuple):
    """Under which floor somebody renders, and by a lease of which position; whether it is still there."""

    floor: int
    leased: Callable[[], int]
    lives: Callable[[], bool] = lambda: True
    is_leased: bool = True
    """Else a switch back is not held up by it: it ends, as jobs do, with the first record that it reads of behind that."""


class ModesWatch:
    """`say` is told what does not hold, and at which nodes."""

    def __init__(self, cluster: Cluster, scene: SceneId, say: Callable[[Iterable[Wrong], int | None], None]) -> None:
        self.frozen = Frozen(cluster.watch.recorder.histories.moment)
        self._cluster, self._scene, self._say = cluster, scene, say
        self._renders: dict[str, dict[str, _Rendering]] = {}
        """By client that reads: who renders what it reads."""
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

    @property
    def newest_is_active(self) -> bool:
        """Whether somebody acts by the last change of the mode that anybody knows."""
        newest = max(self.frozen.switches, default=0)
        return any(mode.position >= newest for mode in self._active())

    def _active(self) -> Iterator[Acting]:
        """What those who decide or observe take for active just now, each by its own clock."""
        for slot, node in sorted(self._cluster.running.items()):
            if node.context is None:
                continue
            use = node.context.participation.own_use(self._scene)
            modes = node.context.participation.modes_of(self._scene) if use is None else use.modes
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

        def lives() -> bool:
            # What is read behind its end, before that is noticed, counts for nothing: no image comes of it.
            return lease is None or lease.holds

        with self._renders_as(name, name, _Rendering(floor, leased, lives, is_leased=lease is not None)):
            yield

    @contextmanager
    def observing(self, slot: int, context: NodeContext, modes: SceneModes, reader: str) -> Iterator[Callable[[], bool]]:
        """This node renders, by its own lease, what the client reads for it in here; gives whether it still runs."""
        floor, clock = modes.public.write_floor, context.world.clock

        def leased() -> int:
            held = modes.standing.holder.lease(clock.now())
            return floor if held is None else held.position

        def lives() -> bool:
            node = self._cluster.running.get(slot)
            # As a client's: behind the end of its lease nothing that it reads counts.
            return node is not None and node.context is context and modes.acts_in is SceneMode.RENDER

        with self._renders_as(reader, f"n{slot}", _Rendering(floor, leased, lives)):
            yield lives

    @contextmanager
    def _renders_as(self, reader: str, who: str, one: _Rendering) -> Iterator[None]:
        reading = self._renders.setdefault(reader, {})
        reading[who] = one
        try:
            yield
        finally:
            del reading[who]

    def _shown(self, name: str, place: Place, version: Version | None, floor: int) -> None:
        """A client is given what an owner says lies there."""
        if place.scene != self._scene:
            return
        renders = self._renders.get(name, {})
        for who, mine in list(renders.items()):
            if not mine.is_leased and version is not None and version.order[0] >= mine.floor:
                renders[who] = mine._replace(lives=lambda: False)
            elif floor >= mine.floor and mine.lives():
                self._judge(who, mine, place, version)
            # Else nothing is rendered of it: nobody takes the word of who goes by an older header.

    def _judge(self, who: str, mine: _Rendering, place: Place, version: Version | None) -> None:
        self._say(self.frozen.acts(who, "renders", mine.leased(), self._active()), None)
        disks = [node.disk for node in self._cluster.nodes.values()]

        def there() -> Iterator[Digest]:
            return (found.digest for disk in disks if (found := found_at(disk, place)) is not None)

        owner = self._cluster.watch.lineage.holder_of(place.home).holder
        self._say(self.frozen.looked(who, mine.floor, place, version, there, owner), None)
