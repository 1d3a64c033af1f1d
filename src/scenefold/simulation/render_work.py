"""Clients that have a scene rendered all the time (workload `renders`; specs/17-simulation.md, Renders): each image must be the one in closed form.

They use what people's clients do from the choice on: the request, the watch over it, letting go, and beginning anew. Who may render is known
from the profile, as nobody is let in or out of that meanwhile.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar, cast

import trio

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster as ClientCluster
from scenefold.client import Scene
from scenefold.client.calls import Calls
from scenefold.render.anew import Begun
from scenefold.render.choice import Renderers
from scenefold.render.client import begun_until_it_is
from scenefold.render.job import POOLS_THAT_FIT, RenderOptions
from scenefold.render.layers import unpacked
from scenefold.render.levels import Adaptive
from scenefold.render.one_image import OneImage
from scenefold.render.pool.unattended import Unattended
from scenefold.render.rehearsal.arithmetic_image import image_of
from scenefold.render.reports import image_size, report_of
from scenefold.render.watch import Watch
from scenefold.render.window import Window
from scenefold.simulation import laws
from scenefold.simulation.clients import Client
from scenefold.wire import CancelJob, Packet
from scenefold.world import Links, Priority
from scenefold.world.facts import ClusterFacts

T = TypeVar("T")
PAUSE_S = 4.0
"""Between the renders of one client, on average half of it."""
SIDES, SAMPLES = (6, 28), (4, 28)
ALGORITHMS = ("bounded-radial", "kd", "power", "planar", "swarming", "voronoi")
CROPS, MOVES, ADAPTIVE, UNATTENDED, INTERRUPTED = 0.2, 0.8, 0.25, 0.2, 0.15
"""Shares of renders that make a part of the image, whose cells may move, of which noisy pixels go on for longer than others, whose client goes away
meanwhile, and that their client ends before they are done."""
POOLS = (1, 1, 2, POOLS_THAT_FIT)
"""In which of these the nodes stand the image's seed says."""
INTERRUPTED_S = (0.2, 6.0)
NOISES, FIRST_LEVELS = (0.1, 0.15, 0.2), (4, 8)
"""Errors of pixels that go on no more: a few samples are enough for some, and as many as there are for few."""
AWAY_S_MAX, COMES_BACK_S, PATIENT_S = 12.0, 3.0, 60.0
"""Who leaves a render alone is away for so long at most; then asks again after so long whenever it cannot be reached, for so long in all."""
ENDS_S_MAX = 200.0
"""So long after all has healed nobody waits for an image any more: an organiser that lost its client may keep its place, but no client hangs."""
PASSES = frozenset({RejectReason.NOT_READY, RejectReason.BUSY})
"""Why a render may fail in a storm: somebody is away, or has no place."""


@dataclass(slots=True)
class Gallery:
    """What came of all renders of a run. `violated`: told of a law, and of what broke it."""

    violated: Callable[[str, str], None]
    tell: Callable[[str], None]
    counts: Counter[str] = field(default_factory=Counter)

    @property
    def done(self) -> int:
        """Images that were judged."""
        return self.counts["images"]

    def judge(self, options: RenderOptions, image: bytes, report: dict[str, Any], name: str) -> None:
        """An image was fetched."""
        self.counts["images"] += 1
        self.counts["adaptive"] += options.adaptive is not None
        self.counts["attempts raised"] += report["attempts"] - 1
        self.counts["nodes lost"] += len(report["nodes_lost"])
        self.counts["nodes back"] += len(report["nodes_back"])
        self.counts["passes again"] += report["passes_traced_again"]
        self.counts["cells moved"] += report["cells_moved"]
        for count in ("packets_resent", "late"):
            self.counts[count.replace("_", " ")] += sum(node[count] for node in report["render_nodes"])
        expected = image_of(options)
        if image != expected:
            self.violated(laws.EXACT, f"{name}: {_difference(options, image, expected)}, {report['attempts']} attempts")


class RenderClient:
    """One user who wants one image after the other."""

    def __init__(self, client: Client, facts: ClusterFacts, seed: int, gallery: Gallery) -> None:
        assert client.scene is not None
        self.name, self._scene, self._gallery = client.name, client.scene, gallery
        self._ends = _Ends(client.calls._links)
        client.calls._links = cast(Links, self._ends)
        self._reach = _Reach(client.calls, facts)
        self._dice = random.Random(f"renders/{seed}/{client.name}")
        self._ended = trio.Event()
        self._wants = ""

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop; the image that is wanted then is waited for, but not for ever."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._work, stop)
            await stop.wait()
            with trio.move_on_after(ENDS_S_MAX):
                await self._ended.wait()
            if not self._ended.is_set():
                self._gallery.violated(laws.ENDED, f"{self.name} still waits {ENDS_S_MAX:g} s after all has healed: {self._wants}")
                nursery.cancel_scope.cancel()

    async def _work(self, stop: trio.Event) -> None:
        while not stop.is_set():
            await trio.sleep(self._dice.random() * PAUSE_S)
            patience = self._dice.uniform(*INTERRUPTED_S) if self._dice.random() < INTERRUPTED else None
            await self.want(self._options(), patience, attended=self._dice.random() >= UNATTENDED)
        self._ended.set()

    async def want(self, options: RenderOptions, patience_s: float | None = None, *, attended: bool = True) -> None:
        """One image, and whether it is right. Attended: its client waits for it."""
        counts = self._gallery.counts
        self._wants = f"{options.width} x {options.height}, {options.samples} samples, seed {options.seed}, {options.algorithm}"
        self._gallery.tell(f"{self.name} wants {self._wants}, {'and waits' if attended else 'some time'}")
        wish = _Wish(self._reach, self._scene, options)
        counts["renders"] += 1
        with trio.move_on_after(float("inf") if patience_s is None else patience_s) as scope:
            try:
                image, report, begun = await (self._wait_for(wish) if attended else self._leave_alone(wish, options))
            except (Unreachable, Refused) as error:
                self._failed(error)
                return
            counts["begun anew"] += begun - 1
            self._gallery.tell(f"{self.name} has its image, {report['attempts']} attempts, {report['cells_moved']} moves")
            self._gallery.judge(options, image, report, f"{self.name}'s image of {self._wants}")
        counts["interrupted"] += scope.cancelled_caught

    async def _wait_for(self, wish: _Wish) -> tuple[bytes, dict[str, Any], int]:
        """The image, its report, and how often it was begun."""
        (image, report), _, begun = await begun_until_it_is(wish, self._scene, wish.render, _unseen, None, self._begun_anew)
        return image, report, begun

    async def _leave_alone(self, wish: _Wish, options: RenderOptions) -> tuple[bytes, dict[str, Any], int]:
        """The same of a render that goes on without us; Unreachable or Refused if there is none when we are back."""
        begin = partial(wish.begin, unattended=Unattended(self._scene.name))
        taken, _, begun = await begun_until_it_is(wish, self._scene, begin, _unseen, None, self._begun_anew)
        organiser = address_of(taken.organiser)
        watch = Watch(cast(ClientCluster, self._reach), organiser, taken.job)
        try:
            await trio.sleep(self._dice.random() * AWAY_S_MAX)
            stand = await self._patiently(lambda: watch.until_done(_unseen))
            report = report_of(stand.document, options, None, organiser)
            image = await self._patiently(lambda: watch.fetch(image_size(options), _unseen_parts))
        finally:
            await watch.let_go()
        self._gallery.counts["unattended"] += 1
        return image, report, begun

    async def _patiently(self, ask: Callable[[], Awaitable[T]]) -> T:
        """A render goes on while its organiser cannot be reached."""
        until = trio.current_time() + PATIENT_S
        while True:
            try:
                return await ask()
            except Unreachable:
                if trio.current_time() >= until:
                    raise
            await trio.sleep(COMES_BACK_S)

    async def let_go(self) -> None:
        """Everything has healed: end again what nobody answered for when it was to end, as its user would; and nothing else."""
        for address, job in sorted(self._ends.unheard):
            await Watch(cast(ClientCluster, self._reach), address, job).let_go()

    @staticmethod
    def options(seed: int) -> RenderOptions:
        """A small image, which takes a few passes."""
        return RenderOptions(width=12, height=8, samples=16, seed=seed, layers=("samples",), algorithm="kd")

    def _options(self) -> RenderOptions:
        dice = self._dice
        width, height, samples = dice.randint(*SIDES), dice.randint(*SIDES), dice.randint(*SAMPLES)
        crop = None
        if dice.random() < CROPS:
            x, y = dice.randrange(width), dice.randrange(height)
            crop = Window(x, y, dice.randint(1, width - x), dice.randint(1, height - y))
        seed = dice.getrandbits(63)
        return RenderOptions(
            width=width,
            height=height,
            samples=samples,
            seed=seed,
            pools=POOLS[seed % len(POOLS)],
            layers=("albedo", "samples") if dice.random() < 0.5 else ("samples",),
            algorithm=dice.choice(ALGORITHMS),
            moving=dice.random() < MOVES,
            crop=crop,
            adaptive=Adaptive(dice.choice(NOISES), dice.choice(FIRST_LEVELS)) if dice.random() < ADAPTIVE else None,
        )

    def _failed(self, error: ScenefoldError) -> None:
        self._gallery.counts["failed"] += 1
        self._gallery.tell(f"{self.name} gets no image: {error}")
        if isinstance(error, Refused) and error.reason not in PASSES:
            self._gallery.violated(laws.SOUND, f"{self.name} is told of {self._wants}: {error.reason.name}, {error}")

    def _begun_anew(self, begun: Begun) -> None:
        self._gallery.tell(f"{self.name} begins anew: {begun.error}; without {', '.join(begun.without) or 'nobody'}")


class _Wish(OneImage):
    """Who may render it, its client knows."""

    def __init__(self, reach: _Reach, scene: Scene, wanted: RenderOptions) -> None:
        super().__init__(cast(ClientCluster, reach), scene, wanted, None, _unseen)
        self._reach = reach

    async def may_render(self) -> Renderers:
        credentials = filter(None, (self._reach.profile.credential(node) for node in self._reach.profile.founders))
        return Renderers({one.node_id: one.sealing_key for one in credentials})


class _Ends:
    """A client's links, which see what ends of its renders. Has what `Calls` uses of `Links`."""

    def __init__(self, links: Links) -> None:
        self._links = links
        self.unheard: set[tuple[str, int]] = set()
        """Renders that were to end, and whether they have nobody said: who organises them, and the job."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout_s: float) -> Packet:
        if not isinstance(packet, CancelJob):
            return await self._links.request(address, priority, packet, timeout_s)
        ended = address, packet.job
        self.unheard.add(ended)
        try:
            answer = await self._links.request(address, priority, packet, timeout_s)
        except Refused:
            self.unheard.discard(ended)
            raise
        self.unheard.discard(ended)
        return answer


@dataclass(frozen=True, slots=True)
class _Reach:
    """What renders use of a client's cluster."""

    calls: Calls
    profile: ClusterFacts

    async def in_worker(self, lane: str, function: Callable[..., T], *arguments: object) -> T:
        return await self.calls.world.workers.run(lane, function, *arguments)


def _difference(options: RenderOptions, image: bytes, expected: bytes) -> str:
    shape = options.layers, options.window.width, options.window.height
    mine, right = unpacked(image, *shape), unpacked(expected, *shape)
    wrong = {name: int((values != right[name]).reshape(options.window.pixels, -1).any(axis=1).sum()) for name, values in mine.items()}
    found = ", ".join(f"{count} in {name}" for name, count in wrong.items() if count)
    return f"of {options.window.pixels} pixels are wrong: {found}"


def _unseen(_phase: str, _done: int, _total: int) -> None:
    """Nobody looks on."""


def _unseen_parts(_done: int, _total: int) -> None:
    """Nor when it is fetched."""
