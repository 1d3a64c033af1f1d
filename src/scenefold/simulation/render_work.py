"""Clients that have a scene rendered all the time (workload `renders`; specs/17-simulation.md, Renders): each image must be the one in closed form.

They use what people's clients do from the choice on: the request, the watch over it, letting go, and beginning anew. Who may render is known
from the profile, as nobody is let in or out of that meanwhile.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
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
from scenefold.render.job import RenderOptions
from scenefold.render.layers import unpacked
from scenefold.render.one_image import Choice, OneImage
from scenefold.render.rehearsal.arithmetic_image import image_of
from scenefold.render.watch import Watch
from scenefold.render.window import Window
from scenefold.simulation import laws
from scenefold.simulation.clients import Client
from scenefold.world.facts import ClusterFacts

T = TypeVar("T")
PAUSE_S = 4.0
"""Between the renders of one client, on average half of it."""
SIDES, SAMPLES = (6, 28), (4, 28)
ALGORITHMS = ("bounded-radial", "kd", "power", "planar", "swarming", "voronoi")
CROPS, MOVES, INTERRUPTED = 0.2, 0.8, 0.15
"""Shares of renders that make a part of the image, whose cells may move, and that their client ends before they are done."""
INTERRUPTED_S = (0.2, 6.0)
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
        self._reach = _Reach(client.calls, facts)
        self._dice = random.Random(f"renders/{seed}/{client.name}")
        self._asked: list[tuple[str, int]] = []
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
            await self.want(self._options(), patience)
        self._ended.set()

    async def want(self, options: RenderOptions, patience_s: float | None = None) -> None:
        """One image, and whether it is right."""
        counts = self._gallery.counts
        self._wants = f"{options.width} x {options.height}, {options.samples} samples, seed {options.seed}, {options.algorithm}"
        self._gallery.tell(f"{self.name} wants {self._wants}")
        wish = _Wish(self._reach, self._scene, options, self._asked)
        counts["renders"] += 1
        with trio.move_on_after(float("inf") if patience_s is None else patience_s) as scope:
            try:
                (image, report), _, begun = await begun_until_it_is(wish, self._scene, wish.render, _unseen, None, self._begun_anew)
            except (Unreachable, Refused) as error:
                self._failed(error)
                return
            counts["begun anew"] += begun - 1
            self._gallery.tell(f"{self.name} has its image, {report['attempts']} attempts, {report['cells_moved']} moves")
            self._gallery.judge(options, image, report, f"{self.name}'s image of {self._wants}")
        counts["interrupted"] += scope.cancelled_caught

    async def let_go(self) -> None:
        """Everything has healed: end what could not be told then that it is not wanted any more, as its user would."""
        for address, job in self._asked:
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
        return RenderOptions(
            width=width,
            height=height,
            samples=samples,
            seed=dice.getrandbits(63),
            layers=("albedo", "samples") if dice.random() < 0.5 else ("samples",),
            algorithm=dice.choice(ALGORITHMS),
            moving=dice.random() < MOVES,
            crop=crop,
        )

    def _failed(self, error: ScenefoldError) -> None:
        self._gallery.counts["failed"] += 1
        self._gallery.tell(f"{self.name} gets no image: {error}")
        if isinstance(error, Refused) and error.reason not in PASSES:
            self._gallery.violated(laws.SOUND, f"{self.name} is told of {self._wants}: {error.reason.name}, {error}")

    def _begun_anew(self, begun: Begun) -> None:
        self._gallery.tell(f"{self.name} begins anew: {begun.error}; without {', '.join(begun.without) or 'nobody'}")


class _Wish(OneImage):
    """`asked`: gets who was asked to organise it, and as which job."""

    def __init__(self, reach: _Reach, scene: Scene, wanted: RenderOptions, asked: list[tuple[str, int]]) -> None:
        super().__init__(cast(ClientCluster, reach), scene, wanted, None, _unseen)
        self._reach, self._noted = reach, asked

    async def may_render(self) -> Renderers:
        credentials = filter(None, (self._reach.profile.credential(node) for node in self._reach.profile.founders))
        return Renderers({one.node_id: one.sealing_key for one in credentials})

    def _choice(self, *given: Any) -> Choice:
        choice = super()._choice(*given)
        self._noted.append((address_of(choice.organiser), choice.job))
        return choice


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
