"""Renders that go on without their client: find them again, watch them, fetch their images, end them (specs/19-jobs.md, Unattended renders).

`scenefold.render.client.start_still` begins one. Who organises it is asked of all nodes, so nothing about it need be kept here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from scenefold.base.errors import LocalFault, PeerFault, Refused, Unreachable, UsageFault
from scenefold.base.plain_values import number, text, whole
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster
from scenefold.client.together import together
from scenefold.render.algorithms import USUAL_ALGORITHM
from scenefold.render.anew import ANSWER_S_MAX
from scenefold.render.client import StillResult, name_of
from scenefold.render.job import RenderOptions
from scenefold.render.layers import unpacked
from scenefold.render.one_image import Told, nobody
from scenefold.render.pool.request import options_of
from scenefold.render.pool.telling import error_of
from scenefold.render.pool.unattended import ALL_JOBS, Unattended
from scenefold.render.preview_files import Previewer, Previews
from scenefold.render.reports import PHASES, NodeStand, Stand, believed, image_size, nodes_of, report_of
from scenefold.render.watch import Progress, Watch
from scenefold.wire import JobState, JobStateReply, unpack_value

JOBS_OF_A_NODE_MAX = 16
_COUNT_MAX = 2**64 - 1


@dataclass(frozen=True, slots=True)
class KnownRender:
    """A render of this user, as the node that organises it tells of it."""

    job: int
    organiser: str
    """Its address."""
    phase: str
    """preparing, rendering, merging, done or failed."""
    closed: int
    passes: int
    """Until everything is prepared both are 0."""
    age_s: float
    """Seconds since it was asked for."""
    failure: str
    """Why there is no image; empty if nothing failed."""
    options: RenderOptions
    unattended: Unattended | None
    """None: a client waits for it."""

    @property
    def name(self) -> str:
        """The job's id, as it is printed and typed."""
        return name_of(self.job)

    @property
    def scene(self) -> str | None:
        """The name under which whoever began it knows the scene; None of one that a client waits for."""
        return None if self.unattended is None else self.unattended.scene

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        window = self.options.window
        return {
            "render": self.name,
            "scene": self.scene,
            "organiser": self.organiser,
            "phase": self.phase,
            "passes_done": self.closed,
            "passes": self.passes,
            "size": [window.width, window.height],
            "samples": self.options.samples,
            "age_s": round(self.age_s, 1),
            "is_attended": self.unattended is None,
            "failure": self.failure or None,
        }


@dataclass(frozen=True, slots=True)
class Listing:
    """`silent`: addresses of nodes that do not answer, or not what makes sense, of whose renders nothing is known."""

    renders: tuple[KnownRender, ...]
    silent: tuple[str, ...]


async def list_renders(cluster: Cluster) -> Listing:
    """All renders of this user, the oldest first. Unreachable if no node answers."""
    found, silent = list[KnownRender](), list[str]()

    async def ask(address: str) -> None:
        try:
            reply = await cluster.calls.ask(address, JobState(job=ALL_JOBS), JobStateReply, timeout_s=ANSWER_S_MAX)
            found.extend(_renders_of(reply.document, address))
        except (Unreachable, PeerFault):
            # Also if it makes no sense: one node keeps nobody from what the others have.
            silent.append(address)
        except Refused as refused:
            # A node of a version that knows no such question.
            if refused.reason is not RejectReason.NOT_READY:
                raise

    nodes = [node.address for node in await cluster.nodes()]
    await together(partial(ask, address) for address in nodes)
    if len(silent) == len(nodes):
        raise Unreachable("no node answers", where=", ".join(silent[:8]), remedy="see that they run, then try again")
    return Listing(tuple(sorted(found, key=lambda one: -one.age_s)), tuple(sorted(silent)))


async def find_render(cluster: Cluster, name: str) -> KnownRender:
    """The one whose name begins so. LocalFault if that is none, or none alone; Unreachable if a node that does not answer may know it."""
    listing = await list_renders(cluster)
    found = [one for one in listing.renders if name and one.name.startswith(name.lower())]
    if len(found) == 1:
        return found[0]
    if found:
        raise LocalFault("several renders of yours begin so", where=", ".join(one.name for one in found), remedy="give more of its name")
    if listing.silent:
        where = f"{name!r:.40}; silent: {', '.join(listing.silent[:8])}"
        raise Unreachable("none of the nodes that answer knows such a render", where=where, remedy="start the others")
    raise LocalFault(
        "there is no such render of yours: it was fetched or cancelled, or was done for a day, or its node was started anew",
        where=f"{name!r:.40}",
        remedy="`scenectl render list` shows those that there are",
    )


async def watch_render(
    cluster: Cluster,
    render: KnownRender,
    progress: Progress,
    *,
    lost: Told = nobody,
    back: Told = nobody,
    seen: Callable[[Stand, list[NodeStand]], object] | None = None,
    previews: Previews | None = None,
) -> None:
    """Wait until its image is there; told as in `render_still`, and `seen`, several times a second, how it and its nodes stand. `previews`: pictures on the way.

    What it failed of is raised.
    """

    def look(stand: Stand) -> None:
        if seen is not None:
            seen(stand, nodes_of(stand, render.organiser))

    previewer = None if previews is None else Previewer(cluster, previews, render.options)
    await Watch(cluster, render.organiser, render.job).until_done(progress, None, lost, back, look, previewer)


async def fetch_render(cluster: Cluster, render: KnownRender, progress: Progress) -> StillResult:
    """Its image. Refused (16) if it is not there yet; what it failed of is raised. It stays where it is until `end_render`."""
    report = await report_of_render(cluster, render)
    options = render.options
    image = await Watch(cluster, render.organiser, render.job).fetch(image_size(options), partial(progress, "fetch"))
    layers = unpacked(image, options.layers, options.window.width, options.window.height)
    return StillResult(layers, report, None if render.unattended is None else render.unattended.exposure, options)


async def report_of_render(cluster: Cluster, render: KnownRender) -> dict[str, Any]:
    """How its image came about. Refused (16) if that is not there yet; what it failed of is raised."""
    stand = await Watch(cluster, render.organiser, render.job).stand()
    if stand.phase != "done":
        what = f"the image is not there yet: {stand.closed:,} of {stand.passes:,} passes are done"
        raise Refused(RejectReason.NOT_READY, what, where=render.name, remedy=f"wait for it: scenectl render watch {render.name}")
    return report_of(stand.document, render.options, None, render.organiser)


async def end_render(cluster: Cluster, render: KnownRender) -> None:
    """End it, wherever it stands, and free its image. Unreachable; Refused (16) if it is gone already."""
    await Watch(cluster, render.organiser, render.job).cancel()


def _renders_of(packed: bytes, organiser: str) -> list[KnownRender]:
    """What a node tells of the jobs that it organises. PeerFault if that is ill-formed."""
    with believed(organiser):
        document = unpack_value(packed, what="a list of jobs")
        rows = document["jobs"] if isinstance(document, dict) else None
        if not isinstance(rows, list) or len(rows) > JOBS_OF_A_NODE_MAX:
            raise ValueError("a list of few jobs is expected")
        return [_render_of(row, organiser) for row in rows]


def _render_of(row: Any, organiser: str) -> KnownRender:
    phase, passes = text(row["phase"]), whole(row["passes"], 0, _COUNT_MAX)
    if phase not in PHASES:
        raise ValueError("a phase is expected")
    words, reason = text(row["failure"]), whole(row["failure_reason"], 0, 255)
    try:
        options = options_of(row["options"])
        # By which rule cells move is the nodes' affair: it may be of a package that this client has not.
        replace(options, algorithm=USUAL_ALGORITHM).check()
    except UsageFault as fault:
        raise ValueError(str(fault)) from fault
    return KnownRender(
        job=whole(row["job"], 1, _COUNT_MAX),
        organiser=organiser,
        phase=phase,
        closed=whole(row["closed"], 0, passes),
        passes=passes,
        age_s=number(row["age"]),
        failure=str(error_of(reason, words)) if words else "",
        options=options,
        unattended=Unattended.of_row(row["unattended"]),
    )
