"""Rendering as a client sees it: choose who renders, seal the keys to them, ask the job's organiser, watch, fetch the image."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from scenefold.base.errors import Refused, Unreachable, UsageFault
from scenefold.base.ids import address_of
from scenefold.client import Cluster, Scene
from scenefold.render.anew import Begun, Tries
from scenefold.render.choice import Renderers
from scenefold.render.job import POOLS_THAT_FIT, RenderOptions
from scenefold.render.layers import USUAL, Pixels, unpacked
from scenefold.render.lens import lens_of
from scenefold.render.levels import adaptive_of
from scenefold.render.one_image import Choice, OneImage, Told, nobody
from scenefold.render.pool.unattended import Unattended
from scenefold.render.preview_files import Previews
from scenefold.render.sampling import USUAL_SAMPLING, Sampling
from scenefold.render.watch import Progress
from scenefold.render.window import Window
from scenefold.wire import PathSettings, RenderSettings

T = TypeVar("T")
NOTHING_SAID = RenderSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class StillOptions:
    """What a still shall be; see `RenderOptions`. None: as the scene's log says, or else as usual."""

    width: int | None = None
    height: int | None = None
    samples: int | None = None
    seed: int = 1
    depth: int | None = None
    algorithm: str | None = None
    """By which cells move, usually bounded-radial."""
    fixed_cells: bool = False
    """Cells stay where they are at first."""
    pools: int | None = None
    """In how many render pools the nodes stand (`scenefold.render.job.POOLS_THAT_FIT`: in as many as hold the scene, as is usual).

    Who says how cells shall be (`algorithm`, `fixed_cells`, `skip_empty`), and not this, has one pool, as only there everybody has a cell.
    """
    skip_empty: bool = False
    """Rays are passed over cells in which they meet nothing."""
    sky: tuple[float, float, float] | None = None
    """Usually black."""
    camera: str | None = None
    exposure: float | None = None
    """Of the picture for people, in stops; usually as the image asks."""
    layers: tuple[str, ...] = USUAL
    """Of the image, beside its beauty (`scenefold.render.layers.BESIDE`), in that order."""
    scale: float = 1.0
    """For a preview: the image has so much of its width and of its height, in whole pixels, as if that were its size."""
    crop: Window | None = None
    """The part of the image to make, in pixels of what it is before `scale`; None: all of it."""
    aperture: float | None = None
    """Radius of the camera's lens in the world's unit; None: it is a pinhole."""
    focus: float | None = None
    """How far from the camera everything is sharp; with an aperture only."""
    sampler: str | None = None
    roulette_from: int | None = None
    clamp_direct: float | None = None
    clamp_indirect: float | None = None
    environment_rotation: float | None = None
    """Degrees; usually 0."""
    adaptive: float | None = None
    """Expected error, relative to its brightness, at which a pixel has enough samples; usually all have all."""
    min_samples: int | None = None
    """How many every pixel has before; with `adaptive` only."""
    mips: bool = True
    """Whether far textures are read from their coarser levels."""
    ignore_settings: bool = False
    """All that is None is as usual, whatever the scene's log says."""

    def heeded(self, said: RenderSettings) -> RenderSettings:
        """What counts of it for what is None here."""
        return NOTHING_SAID if self.ignore_settings else said

    def checked(self, said: RenderSettings = NOTHING_SAID) -> RenderOptions:
        """The options of the job; UsageFault if one is out of range. `said`: what the scene's log says."""
        said, usual = self.heeded(said), RenderOptions()
        red, green, blue = _first(self.sky, said.sky, usual.sky)
        width, height, crop = self._scaled(_first(self.width, said.width, usual.width), _first(self.height, said.height, usual.height))
        options = RenderOptions(
            width=width,
            height=height,
            samples=_first(self.samples, said.samples, usual.samples),
            seed=self.seed,
            depth=_first(self.depth, said.depth, usual.depth),
            sky=(red, green, blue),
            camera=self.camera if self.camera is not None else said.camera,
            algorithm=usual.algorithm if self.algorithm is None else self.algorithm,
            moving=not self.fixed_cells,
            pools=self._pools(),
            skips=self.skip_empty,
            layers=self.layers,
            crop=crop,
            lens=lens_of(self.aperture, self.focus) or lens_of(said.paths.aperture, said.paths.focus),
            sampling=self._sampling(said.paths),
            environment_rotation=_first(self.environment_rotation, said.paths.environment_rotation, usual.environment_rotation),
            adaptive=adaptive_of(self.adaptive, self.min_samples) or adaptive_of(said.paths.adaptive, said.paths.min_samples),
            mips=self.mips,
        )
        options.check()
        return options

    def _pools(self) -> int:
        if self.pools is not None:
            return self.pools
        return 1 if self.algorithm is not None or self.fixed_cells or self.skip_empty else POOLS_THAT_FIT

    def _sampling(self, said: PathSettings) -> Sampling:
        return Sampling(
            _first(self.sampler, said.sampler, USUAL_SAMPLING.sampler),
            _first(self.roulette_from, said.roulette_from, USUAL_SAMPLING.roulette_from),
            said.clamp_direct if self.clamp_direct is None else self.clamp_direct,
            said.clamp_indirect if self.clamp_indirect is None else self.clamp_indirect,
        )

    def _scaled(self, width: int, height: int) -> tuple[int, int, Window | None]:
        if not 0.0 < self.scale <= 1.0:
            raise UsageFault(f"scale is {self.scale}", where="scale", remedy="give a number above 0, and up to 1")
        if self.crop is not None:
            self.crop.check(width, height)
        if self.scale == 1.0:
            return width, height, self.crop
        small_width, small_height = max(round(width * self.scale), 1), max(round(height * self.scale), 1)
        return small_width, small_height, None if self.crop is None else self.crop.scaled(self.scale, small_width, small_height)


def _first(own: T | None, said: T | None, usual: T) -> T:
    return own if own is not None else said if said is not None else usual


@dataclass(frozen=True, slots=True)
class StillResult:
    """A finished image and how it came about."""

    layers: dict[str, Pixels]
    """beauty [H, W, 3] and those that were asked for, top row first; float32, or uint32 where they count or number something."""
    report: dict[str, Any]
    exposure: float | None
    """Of the picture for people, in stops; None: as the image asks."""
    options: RenderOptions
    """As it was rendered, with all that was not given."""


async def render_still(
    cluster: Cluster,
    scene: Scene,
    options: StillOptions,
    progress: Progress,
    *,
    tell: Callable[[Renderers], None] | None = None,
    organised_by: Told = nobody,
    lost: Told = nobody,
    back: Told = nobody,
    anew: Callable[[Begun], None] | None = None,
    resume: Path | None = None,
    previews: Previews | None = None,
) -> StillResult:
    """Render one image and wait for it. LocalFault, Refused or Unreachable say why there is none.

    `resume`: a file in which what is rendered is kept once in a while, until the image is there. If it is there before, the render goes on from it: the
    image has the same bits as if nothing had interrupted it. LocalFault if it is of other options, DamagedData if it is no such file,
    Refused if it is of another scene or renderer. Who has saved the image removes it.

    `previews`: pictures that are written on the way, with the exposure of the image.

    The nodes are those that the cluster trusts, or that were granted the scene; only they get its keys. They are
    chosen here, for each image anew: who was granted the scene when somebody asked before may have no right to its keys of now. `tell` hears
    of them before anything else happens, `organised_by` then the address of the one that is asked to organise the render; `lost` those of others that die
    on the way, `back` those of them that take part again, and `anew` why the render is begun anew. LocalFault if there is none.
    """
    options.checked()
    # Who must wait for a node that says nothing hears at least that something goes on.
    progress("prepare", 0, 1)
    said = options.heeded((await scene.render_settings()).settings)
    wanted = options.checked(said)
    exposure = options.exposure if options.exposure is not None else said.exposure
    looks = None if previews is None else replace(previews, exposure=exposure)
    wish = OneImage(cluster, scene, wanted, resume, progress, lost, back, organised_by, looks)
    (image, report), choice, begun = await begun_until_it_is(wish, scene, wish.render, progress, tell, anew)
    layers = unpacked(image, wanted.layers, wanted.window.width, wanted.window.height)
    report |= {"begun": begun, "left_out": [one.document() for one in choice.renderers.left_out]}
    return StillResult(layers, report, exposure, wanted)


@dataclass(frozen=True, slots=True)
class Started:
    """A render that goes on without its client."""

    job: int
    organiser: str
    """Address of the node that organises it, and will have the image."""
    renderers: Renderers
    """Who makes it, and who does not."""

    @property
    def name(self) -> str:
        """The job's id, as it is printed and typed."""
        return name_of(self.job)


def name_of(job: int) -> str:
    """What a user calls it: 16 hex digits."""
    return f"{job:016x}"


async def start_still(
    cluster: Cluster,
    scene: Scene,
    options: StillOptions,
    progress: Progress,
    *,
    tell: Callable[[Renderers], None] | None = None,
    anew: Callable[[Begun], None] | None = None,
) -> Started:
    """Have one image rendered, and wait until all nodes are ready and trace; `scenefold.render.unattended` has the rest. Errors as of `render_still`.

    It holds no lease: a scene in render mode may be switched to edit mode meanwhile, which fails it where nodes still read. It goes on
    without nodes that die, but for the one that organises it.
    """
    options.checked()
    said = options.heeded((await scene.render_settings()).settings)
    wish = OneImage(cluster, scene, options.checked(said), None, progress)
    unattended = Unattended(scene.name, options.exposure if options.exposure is not None else said.exposure)
    taken, _, _ = await begun_until_it_is(wish, scene, lambda choice: wish.begin(choice, unattended), progress, tell, anew)
    progress("prepare", 1, 1)
    return Started(taken.job, address_of(taken.organiser), taken.renderers)


async def begun_until_it_is(
    wish: OneImage,
    scene: Scene,
    do: Callable[[Choice], Awaitable[T]],
    progress: Progress,
    tell: Callable[[Renderers], None] | None,
    anew: Callable[[Begun], None] | None,
) -> tuple[T, Choice, int]:
    """Do it with who may render, and with others where these are lost; with the last of them, and how often it was begun."""
    tries, choice = Tries(), await wish.choose()
    if tell is not None:
        tell(choice.renderers)
    choice.renderers.check_any(scene.name)
    while True:
        try:
            return await do(choice), choice, tries.begun
        except (Unreachable, Refused) as error:
            if not tries.may_begin_anew(error, wish.passes_kept):
                raise
            why = error
        await wish.pause(tries.pause_s)
        choice = await wish.choose_again()
        choice.renderers.check_any(scene.name)
        if anew is not None:
            anew(Begun(why, tuple(sorted(map(address_of, choice.without))), wish.passes_kept))
        progress("prepare", 0, 1)
