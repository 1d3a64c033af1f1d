"""Rendering as a client sees it: choose who renders, seal the keys to them, ask the job's organiser, watch, fetch the image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster, Scene
from scenefold.client.sealing import SceneIdentity
from scenefold.render.choice import Renderers
from scenefold.render.choosing import renderers_of
from scenefold.render.image_files import check_writable
from scenefold.render.job import RenderOptions
from scenefold.render.kept import KeptRender, asked_of, read_kept, write_kept
from scenefold.render.layers import USUAL, Pixels, unpacked
from scenefold.render.lens import lens_of
from scenefold.render.levels import adaptive_of
from scenefold.render.pool.kept_film import PIECE_BYTES, film_size
from scenefold.render.pool.request import Keep, RenderRequest, organiser_of
from scenefold.render.pool.telling import error_of
from scenefold.render.reports import Stand, image_size, numeric_class_of, report_of, stand_of
from scenefold.render.sampling import USUAL_SAMPLING, Sampling
from scenefold.render.sealed_keys import About, seal_keys
from scenefold.render.window import Window
from scenefold.scene.head import NO_HEAD, SceneHead
from scenefold.wire import (
    CancelJob,
    FetchFilm,
    FetchImage,
    FilmPart,
    ImagePart,
    JobAnswer,
    JobState,
    JobStateReply,
    Packet,
    PathSettings,
    RenderSettings,
    StartJob,
)

ASK_S_MAX = 60.0
POLL_S = 0.25
LETTING_GO_S_MAX = 10.0

Progress = Callable[[str, int, int], None]
"""Called with a phase's name, and how much of how much is done."""
A = TypeVar("A", bound=Packet)
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
    algorithm: str = "bounded-radial"
    fixed_cells: bool = False
    """Cells stay where they are at first."""
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
            algorithm=self.algorithm,
            moving=not self.fixed_cells,
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
    organised_by: Callable[[str], None] | None = None,
    lost: Callable[[str], None] | None = None,
    resume: Path | None = None,
) -> StillResult:
    """Render one image and wait for it. LocalFault, Refused or Unreachable say why there is none.

    `resume`: a file in which what is rendered is kept once in a while, until the image is there. If it is there before, the render goes on from it: the
    image has the same bits as if nothing had interrupted it. LocalFault if it is of other options, DamagedData if it is no such file,
    Refused if it is of another scene or renderer. Who has saved the image removes it.

    The nodes are those that the cluster trusts, or that were granted the scene; only they get its keys. They are
    chosen here, for each image anew: who was granted the scene when somebody asked before may have no right to its keys of now. `tell` hears
    of them before anything else happens, `organised_by` then the address of the one whose death ends the render; `lost` those of others that die. LocalFault if there is none.
    """
    options.checked()
    # Who must wait for a node that says nothing hears at least that something goes on.
    progress("prepare", 0, 1)
    said = options.heeded((await scene.render_settings()).settings)
    wanted = options.checked(said)
    kept = None if resume is None else await cluster.in_worker("import", read_kept, resume, wanted)
    keeper = None if resume is None else _Keeper(cluster, resume, wanted, kept)
    chosen = await renderers_of(cluster, scene)
    identity = scene.access.identity  # with nothing awaited between: these are the keys that the choice is for
    if tell is not None:
        tell(chosen)
    chosen.check_any(scene.name)
    token = cluster.calls.world.entropy.token
    job = int.from_bytes(token(8), "big") or 1
    organiser = address_of(organiser_of(job, chosen.nodes))
    if organised_by is not None:
        organised_by(organiser)
    watch = _Watch(cluster, organiser, job)
    about = About(cluster.profile.cluster_id, identity.genesis, job)
    keys = await cluster.in_worker("crypto", seal_keys, identity.keys, chosen.sealing, about, token)
    head = _head(scene, identity)
    # In render mode nobody switches the scene back before the image is there; who renders in edit mode gets what lies there at the moment.
    async with cluster.calls.leases.rendering(scene.access):
        await watch.start(RenderRequest(job, identity.scene, identity.genesis, keys, wanted, head, None if keeper is None else keeper.keep))
        try:
            if kept is not None:
                await watch.send_film(kept.film)
                kept = None
            addresses = [address_of(node) for node in chosen.nodes]
            state = await watch.until_done(progress, keeper, lambda address: lost(address) if lost and address in addresses else None)
            report = report_of(state.document, wanted, addresses, organiser)
            image = await watch.fetch(image_size(wanted), partial(progress, "fetch"))
        finally:
            await watch.let_go()
    exposure = options.exposure if options.exposure is not None else said.exposure
    layers = unpacked(image, wanted.layers, wanted.window.width, wanted.window.height)
    return StillResult(layers, {**report, "left_out": [one.document() for one in chosen.left_out]}, exposure, wanted)


def _head(scene: Scene, identity: SceneIdentity) -> SceneHead:
    """What the nodes must not fall behind of."""
    log = scene.access.log
    return NO_HEAD if log is None else SceneHead(identity.position, log.keys.header_key.raw, identity.read_floor)


class _Keeper:
    """The file of a kept render."""

    def __init__(self, cluster: Cluster, path: Path, options: RenderOptions, kept: KeptRender | None) -> None:
        check_writable(path)
        self._cluster, self._path, self._options = cluster, path, options
        self.keep = Keep() if kept is None else kept.keep
        """What it holds."""

    def size(self, passes: int) -> int:
        """Of the film of so many passes."""
        return film_size(self._options.plan, self._options.columns, self._options.window.pixels, passes)

    async def write(self, keep: Keep, film: bytes) -> None:
        """In place of what it held."""
        await self._cluster.in_worker("import", write_kept, self._path, KeptRender(asked_of(self._options), keep, film))
        self.keep = keep


class _Watch:
    """One job at its organiser."""

    def __init__(self, cluster: Cluster, address: str, job: int) -> None:
        self._cluster, self._address, self._job = cluster, address, job

    async def start(self, request: RenderRequest) -> None:
        answer = await self._ask(StartJob(job=self._job, document=request.to_bytes()), JobAnswer)
        if answer.reason:
            raise error_of(answer.reason, answer.text, where=self._address)

    async def send_film(self, film: bytes) -> None:
        """What the job goes on from."""
        count = -(-len(film) // PIECE_BYTES)
        for index in range(count):
            payload = film[index * PIECE_BYTES : (index + 1) * PIECE_BYTES]
            answer = await self._ask(FilmPart(job=self._job, gathering=0, part_index=index, part_count=count, payload=payload), JobAnswer)
            if answer.reason:
                raise error_of(answer.reason, answer.text, where=self._address)

    async def until_done(self, progress: Progress, keeper: _Keeper | None = None, lost: Callable[[str], object] = str) -> Stand:
        """How it stands at the end; what it keeps on the way is written down, and who is lost is told. PeerFault if the organiser says what makes no sense."""
        clock, is_prepared, lost_so_far = self._cluster.calls.world.clock, False, 0
        while True:
            try:
                reply = await self._ask(JobState(job=self._job), JobStateReply)
            except Unreachable as error:
                what = f"the node that organises the render is lost: {error.what}"
                remedy = "start it again; with --resume it goes on from what was kept"
                raise Unreachable(what, where=self._address, remedy=remedy) from error
            stand = stand_of(reply.document, self._address)
            if stand.phase == "failed":
                raise error_of(stand.failure_reason, stand.failure, where=self._address, before="the render failed: ")
            for address in stand.lost[lost_so_far:]:
                lost(address)
            lost_so_far = len(stand.lost)
            if stand.phase in ("rendering", "done") and not is_prepared:
                is_prepared = True
                progress("prepare", 1, 1)
            if stand.phase == "rendering":
                progress("render", stand.closed, stand.passes)
                if keeper is not None and stand.kept > keeper.keep.passes:
                    await self._keep(keeper, stand)
                    continue
            if stand.phase == "done":
                progress("render", stand.passes, stand.passes)
                return stand
            await clock.sleep(POLL_S)

    async def _keep(self, keeper: _Keeper, stand: Stand) -> None:
        """Fetch the newest film, and write it down. That it is kept no longer is no fault: there is a newer one, or the image."""
        size = keeper.size(stand.kept)
        try:
            film = await self._fetched(size, lambda at: FetchFilm(job=self._job, passes=stand.kept, offset=at), lambda _done, _all: None)
        except Refused as refused:
            if refused.reason is not RejectReason.NOT_READY:
                raise
            await self._cluster.calls.world.clock.sleep(POLL_S)
            return
        await keeper.write(Keep(stand.kept, stand.content, numeric_class_of(stand, self._address)), film)

    async def fetch(self, size: int, progress: Callable[[int, int], None]) -> bytes:
        """The image, which has this size. PeerFault if it has another one."""
        return await self._fetched(size, lambda at: FetchImage(job=self._job, offset=at), progress)

    async def _fetched(self, size: int, packet: Callable[[int], Packet], progress: Callable[[int, int], None]) -> bytes:
        image = bytearray()
        while len(image) < size:
            part = await self._ask(packet(len(image)), ImagePart)
            if part.total_bytes != size or part.offset != len(image) or not part.payload or len(image) + len(part.payload) > size:
                raise PeerFault("a part of the image does not fit", where=self._address)
            image += part.payload
            progress(len(image), size)
        return bytes(image)

    async def let_go(self) -> None:
        """Free the job also when we are cancelled; a node that does not answer frees it by itself later."""
        with trio.move_on_after(LETTING_GO_S_MAX, shield=True):
            try:
                await self._ask(CancelJob(job=self._job), JobAnswer)
            except ScenefoldError:
                return  # what it is worth is known by now

    async def _ask(self, packet: Packet, answer: type[A]) -> A:
        return await self._cluster.calls.ask(self._address, replace(packet), answer, timeout_s=ASK_S_MAX)
