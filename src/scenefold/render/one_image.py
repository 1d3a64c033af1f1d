"""One image that a client wants: it may be begun several times, each time as another job (specs/31-attempts.md, Begun anew)."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster, Scene
from scenefold.client.sealing import SceneIdentity
from scenefold.render.anew import CHOOSE_PAUSE_S, CHOOSE_S_MAX, heard_of, may_pass
from scenefold.render.choice import Renderers
from scenefold.render.choosing import renderers_of
from scenefold.render.job import RenderOptions
from scenefold.render.kept import read_kept
from scenefold.render.pool.request import Keep, RenderRequest, organiser_of
from scenefold.render.pool.unattended import Unattended
from scenefold.render.preview_files import Previewer, Previews
from scenefold.render.reports import image_size, report_of
from scenefold.render.sealed_keys import About, seal_keys
from scenefold.render.watch import Keeper, Progress, Watch
from scenefold.scene.head import NO_HEAD, SceneHead

Told = Callable[[str], object]
"""Hears an address."""


def nobody(_address: str) -> None:
    """Who wants to hear of no node."""


class Choice(NamedTuple):
    """Who renders it, who of these organises that, under which job and with which keys."""

    renderers: Renderers
    organiser: NodeId
    job: int
    identity: SceneIdentity
    without: frozenset[NodeId]
    """Who would render it, too, but cannot be reached, or renders in another numeric class."""


class OneImage:
    """What one call of `render_still` wants."""

    def __init__(
        self,
        cluster: Cluster,
        scene: Scene,
        wanted: RenderOptions,
        resume: Path | None,
        progress: Progress,
        lost: Told = nobody,
        back: Told = nobody,
        organised_by: Told = nobody,
        previews: Previews | None = None,
    ) -> None:
        """`lost`, `back`: told the addresses of nodes that die on the way, and of those that take part again; `organised_by` of who is asked to organise it."""
        self._cluster, self._scene, self._wanted, self._resume = cluster, scene, wanted, resume
        self._progress, self._lost, self._back, self._organised_by = progress, lost, back, organised_by
        self._keeper: Keeper | None = None
        self._previewer = None if previews is None else Previewer(cluster, previews, wanted)
        self.asked: set[NodeId] = set()
        """Who was to render it so far."""

    @property
    def passes_kept(self) -> int:
        """That need not be traced again, whatever happens."""
        return 0 if self._keeper is None else self._keeper.keep.passes

    async def may_render(self) -> Renderers:
        """Who may, as the logs have it now."""
        return await renderers_of(self._cluster, self._scene)

    async def choose(self) -> Choice:
        """Who may render it. Without anybody the organiser is node 0, which is none."""
        return self._choice(await self.may_render(), self._scene.access.identity, frozenset())

    async def pause(self, seconds: float) -> None:
        """Before it is begun anew."""
        await self._cluster.calls.world.clock.sleep(seconds)

    async def choose_again(self) -> Choice:
        """The same, but for those that were asked before and cannot be reached, or render in another numeric class than most. It may take a minute until anybody can say it.

        Unreachable or Refused if nobody does by then, or none of those that may render answers.
        """
        clock = self._cluster.calls.world.clock
        until = clock.now() + CHOOSE_S_MAX
        while True:
            try:
                return await self._chosen_of_those_that_answer()
            except (Unreachable, Refused) as error:
                if not may_pass(error) or clock.now() >= until:
                    raise
            await clock.sleep(CHOOSE_PAUSE_S)

    async def _chosen_of_those_that_answer(self) -> Choice:
        renderers = await self.may_render()
        identity = self._scene.access.identity  # with nothing awaited between: these are the keys that the choice is for
        silent, classes = await heard_of(self._cluster, self.asked.intersection(renderers.nodes))
        if silent and silent >= {*renderers.nodes}:
            raise Unreachable(
                "none of the nodes that may render answers", where=", ".join(map(address_of, sorted(silent))), remedy="start them"
            )
        wanted = "" if self._keeper is None else self._keeper.keep.numeric_class
        said = set(filter(None, classes.values()))
        if silent and wanted and said and wanted not in said:
            # What is kept goes on in its own class alone, and who renders in that may be back in a moment.
            raise Unreachable(
                "none of the nodes that could go on from the kept render answers",
                where=", ".join(map(address_of, sorted(silent))),
                remedy="start them",
            )
        chosen = renderers.without(silent).of_one_class(classes, wanted)
        return self._choice(chosen, identity, frozenset({*renderers.nodes} - {*chosen.nodes}))

    def _choice(self, renderers: Renderers, identity: SceneIdentity, without: frozenset[NodeId]) -> Choice:
        job = int.from_bytes(self._cluster.calls.world.entropy.token(8), "big") or 1
        organiser = organiser_of(job, renderers.nodes) if renderers.nodes else NodeId(0)
        return Choice(renderers, organiser, job, identity, without)

    async def render(self, choice: Choice) -> tuple[bytes, dict[str, Any]]:
        """The image, packed, and its report. Unreachable or Refused (16) if it may be begun anew; Refused (13) if none has a place for it."""
        cluster, wanted = self._cluster, self._wanted
        kept = None if self._resume is None else await cluster.in_worker("import", read_kept, self._resume, wanted)
        self._keeper = keeper = None if self._resume is None else Keeper(cluster, self._resume, wanted, kept)
        addresses, heard = [address_of(node) for node in choice.renderers.nodes], list[Watch]()
        # In render mode nobody switches the scene back before the image is there; who renders in edit mode gets what lies there at the moment.
        async with cluster.calls.leases.rendering(self._scene.access):
            try:
                taken = await self._taken(choice, heard, keep=None if keeper is None else keeper.keep)
                (watch,) = heard
                if kept is not None:
                    await watch.send_film(kept.film)
                    kept = None
                lost, back = (partial(_tell_of, addresses, hears) for hears in (self._lost, self._back))
                state = await watch.until_done(self._progress, keeper, lost, back, previewer=self._previewer)
                report = report_of(state.document, wanted, addresses, address_of(taken.organiser))
                return await watch.fetch(image_size(wanted), partial(self._progress, "fetch")), report
            finally:
                for watch in heard:
                    await watch.let_go()

    async def begin(self, choice: Choice, unattended: Unattended) -> Choice:
        """Have it rendered without us, up to where passes are traced; with whom of those that may organise it had a place for that.

        Unreachable or Refused (16) if it may be begun anew; Refused (13) if none has a place.
        """
        heard = list[Watch]()
        try:
            # As for an image that is waited for, as long as nodes read at first.
            async with self._cluster.calls.leases.rendering(self._scene.access):
                taken = await self._taken(choice, heard, unattended=unattended)
                (watch,) = heard
                stand = await watch.until_traced()
                if stand.document.get("unattended") is None:
                    what = "the node that organises the render is of a version that gives up what nobody waits for"
                    remedy = "run the same version on all nodes, or wait for it: scenectl render still"
                    raise LocalFault(what, where=address_of(taken.organiser), remedy=remedy)
                return taken
        except BaseException:
            # Also if we are interrupted: nobody would know of it, and it would go on.
            for watch in heard:
                await watch.let_go()
            raise

    async def _taken(self, choice: Choice, heard: list[Watch], keep: Keep | None = None, unattended: Unattended | None = None) -> Choice:
        """Ask who shall organise it, or another one if that one has no place. `heard`: gets the one that has heard of it, or may have."""
        busy = set[NodeId]()
        self.asked |= {*choice.renderers.nodes}
        while True:
            address = address_of(choice.organiser)
            self._organised_by(address)
            watch = Watch(self._cluster, address, choice.job)
            request = await self._request(choice, keep, unattended)
            heard[:] = [watch]
            try:
                await watch.start(request)
            except Refused as refused:
                heard.clear()
                busy.add(choice.organiser)
                if refused.reason is not RejectReason.BUSY or busy >= {*choice.renderers.nodes}:
                    raise
                while choice.organiser in busy:
                    choice = self._choice(choice.renderers, choice.identity, choice.without)
            else:
                return choice

    async def _request(self, choice: Choice, keep: Keep | None, unattended: Unattended | None) -> RenderRequest:
        cluster, (renderers, _, job, identity, _) = self._cluster, choice
        about = About(cluster.profile.cluster_id, identity.genesis, job)
        keys = await cluster.in_worker("crypto", seal_keys, identity.keys, renderers.sealing, about, cluster.calls.world.entropy.token)
        head = _head(self._scene, identity)
        return RenderRequest(job, identity.scene, identity.genesis, keys, self._wanted, head, keep, unattended)


def _tell_of(chosen: Collection[str], hears: Told, address: str) -> None:
    """Nobody else is heard of, whatever the organiser says."""
    if address in chosen:
        hears(address)


def _head(scene: Scene, identity: SceneIdentity) -> SceneHead:
    """What the nodes must not fall behind of."""
    log = scene.access.log
    return NO_HEAD if log is None else SceneHead(identity.position, log.keys.header_key.raw, identity.read_floor)
