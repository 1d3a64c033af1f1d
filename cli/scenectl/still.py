"""From a scene file to an image: what `render still` and `demo` share.

With a profile the work is done by that cluster. Without one a cluster is started for the occasion, one process
a node, in a temporary folder, and is stopped and removed at the end, however that comes about.
"""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from scenectl.output import note, size_text
from scenectl.replacing import replaced_text, tell_replaced
from scenectl.values import cluster_ports

if TYPE_CHECKING:
    from scenectl.striking import Strike
    from scenectl.values import PortPair
    from scenefold.client import Cluster, ImportReport, PreparedImport, Scene
    from scenefold.client.progress import ProgressCallback
    from scenefold.node.local import LocalCluster
    from scenefold.render.anew import Begun
    from scenefold.render.choice import LeftOut, Renderers
    from scenefold.render.client import StillOptions, StillResult
    from scenefold.render.job import RenderOptions
    from scenefold.render.layers import Pixels
    from scenefold.render.preview_files import Previews
    from scenefold.scene.importers import Moment

ADDRESSES_SHOWN = 8
COPIES_OF_STRUCK = 2
"""Of a scene in whose render a node is killed: the others go on at once, and need not wait until it has started again."""


@dataclass(frozen=True, slots=True)
class ImageFiles:
    """Where an image goes."""

    exr: Path
    png: Path
    view: str = "agx"
    """Of the PNG: one of `scenefold.render.view.VIEWS`."""

    @classmethod
    def beside(cls, exr: Path, view: str = "agx") -> Self:
        """The PNG beside it; UsageFault if the output is not named as the EXR file that it will be."""
        from scenefold.base.errors import UsageFault

        if exr.suffix.lower() != ".exr":
            raise UsageFault(
                "the output is an EXR file", where=f"-o {exr}", remedy="give it a name that ends in .exr; a PNG goes beside it"
            )
        return cls(exr, exr.with_suffix(".png"), view)


@dataclass(frozen=True, kw_only=True)
class StillJob:
    """What to render, where, and into which files."""

    file: Path | None
    """Scene file to import first; None for a scene that the cluster holds already."""
    environment: Path | None = None
    """Image file of what lies around it."""
    scene_name: str
    profile: str | None
    nodes: int
    threads: int | None
    ports: PortPair | None
    options: StillOptions
    files: ImageFiles
    moment: Moment | None = None
    """Of the file; None: at rest."""
    resume: Path | None = None
    """The file of the kept render."""
    previews: Previews | None = None
    """Pictures on the way."""
    save: str | None = None
    """The image's name in its scene, which keeps it, too."""
    kill: bool = False
    """Whether a node dies on the way, of those that are started for this; with one node none does."""


@dataclass
class Phases:
    """Seconds that each phase took, in the order of their beginning."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def time(self, name: str) -> Iterator[None]:
        begun = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = round(self.seconds.get(name, 0.0) + time.monotonic() - begun, 3)


def check_files(file: Path | None, *outputs: Path, kept: Path | None = None) -> None:
    """Find what would fail only after minutes of work: a missing file, an output that cannot be written. `kept`: the file of a kept render."""
    from scenefold.base.errors import LocalFault
    from scenefold.render.image_files import check_writable

    if file is not None and file.is_dir():
        raise LocalFault("that is a folder", where=str(file), remedy="name a scene file in it")
    if file is not None and not file.is_file():
        raise LocalFault("there is no such scene file", where=str(file), remedy="check the path")
    check_writable(*outputs)
    if kept is not None:
        from scenefold.render.kept import check_keepable

        check_keepable(kept)


def check_apart(where: str, named: Mapping[str, Path | None]) -> None:
    """UsageFault if two of the files that a verb reads and writes are one. `named`: by what each is called; None: there is none."""
    from scenefold.base.errors import UsageFault

    folders: dict[Path, Path] = {}
    seen: dict[Path, str] = {}
    for name, path in named.items():
        if path is None:
            continue
        if path.parent not in folders:
            folders[path.parent] = path.parent.resolve()
        real = path.resolve() if path.is_symlink() else folders[path.parent] / path.name
        if real in seen:
            raise UsageFault(f"{seen[real]} and {name} are one file, {real}", where=where, remedy="name another one for one of them")
        seen[real] = name


async def make_still(job: StillJob, progress: ProgressCallback) -> dict[str, Any]:
    """Do the whole job and return its report (docs/reference/scenectl.md, *Report of an image*)."""
    from scenectl.image import keep_written
    from scenefold.client import prepare_import
    from scenefold.render.one_image import nobody
    from scenefold.world import offline_world

    phases = Phases()
    prepared: PreparedImport | None = None
    imported: ImportReport | None = None
    if job.file is not None:
        # Before any node is started: a file that cannot be used should not cost more than its reading.
        with phases.time("read"):
            prepared = await prepare_import(offline_world(), job.file, progress, job.moment, job.environment)
        prepared.check_camera(job.options.camera)
    async with cluster_of(job, phases) as (cluster, embedded), _struck(job, embedded) as strike:
        if prepared is None:
            scene = await cluster.scenes.open(job.scene_name)
            if job.save is not None:
                scene.access.check_writer()
        else:
            with phases.time("import"):
                if job.profile is None:
                    # It ends with this cluster, whose nodes have one disk: copies save from nothing but the death of a single node.
                    await cluster.scenes.create(job.scene_name, copies=1 if strike is None else COPIES_OF_STRUCK)
                scene, imported = await cluster.scenes.import_prepared(
                    job.scene_name, prepared, progress, replacing=tell_replaced(job.scene_name)
                )
                prepared = None  # The file's meshes need not stay in memory while the nodes render.
        if embedded is not None:
            embedded.may_die(embedded.addresses)
        with phases.time("render"):
            result = await rendered(
                job,
                embedded,
                cluster,
                scene,
                told_to(strike, render_progress(progress)),
                organised_by=nobody if strike is None else strike.spare,
                resume=job.resume,
                previews=job.previews,
            )
        if embedded is not None:
            embedded.may_die(())
        with phases.time("write"):
            written = await cluster.in_worker(
                "import", write_image, job.scene_name, job.files, result.options, result.layers, result.exposure
            )
            if job.resume is not None:
                job.resume.unlink(missing_ok=True)
            written |= await keep_written(cluster, scene, job.save, job.files.exr, progress)
        nodes = [node.address for node in await cluster.nodes()]
    return {
        "scene": job.scene_name,
        "file": None if job.file is None else str(job.file),
        "time": None if job.moment is None else job.moment.time_s,
        "nodes": len(nodes),
        "records_per_node": None if imported is None else {node: imported.records_by_node.get(node, 0) for node in nodes},
        "import": None if imported is None else imported.document(),
        **({} if strike is None else {"nodes_killed": strike.killed}),
        **result.report,
        **written,
        "seconds": phases.seconds,
    }


def report_text(report: dict[str, Any]) -> str:
    """The report as a short table for people."""
    kept = f" The image is kept in {report['scene']} as {report['saved']}." if report.get("saved") else ""
    lines = [f"{report['exr']} and {report['png']} are written.{kept}"]
    for key, label in (
        *((("nodes", "nodes"),) if report["nodes"] else ()),
        ("passes", "passes"),
        ("samples_per_pixel", "samples per pixel"),
        ("paths_per_second", "paths/s"),
        ("rays_per_second", "rays/s"),
        ("rays_passed", "rays passed between nodes"),
        ("rays_passed_per_path", "rays passed per path"),
        ("bytes_passed", "bytes passed between nodes"),
        ("cells_moved", "moves of cells"),
        *((("pools", "render pools"),) if report.get("pools", 1) > 1 else ()),
        *(
            (("nodes_lost", "nodes lost on the way"), ("nodes_back", "of them back"), ("passes_traced_again", "passes traced again"))
            if report.get("nodes_lost")
            else ()
        ),
        ("efficiency", "efficiency"),
    ):
        if report.get(key) is not None:
            lines.append(f"  {label + ':':<28}{_value_text(key, report[key])}")
        if key == "nodes" and report["render_nodes"]:
            who = "nodes" if report.get("partition", "spatial") == "spatial" else "processes"
            lines.append(f"  {who + ' that rendered:':<28}{len(report['render_nodes'])}")
    memory = report.get("memory")
    if memory is not None:
        lines.append(f"  {'memory budget:':<28}{size_text(memory['budget'])}, {size_text(memory['trees_most'])} in trees at most")
        lines.append(f"  {'parts of the scene:':<28}{memory['cells']}, built {memory['trees_built']} times")
    seconds = ", ".join(f"{phase} {value:.1f}" for phase, value in report["seconds"].items())
    lines.append(f"  {'seconds:':<28}{seconds}")
    imported = report.get("import") or {}
    lines += [f"  not carried over: {missing}" for missing in imported.get("not_carried", [])]
    lines += [f"  {replaced_text(imported['replaced'])}"] if imported.get("replaced") else []
    lines.append(f"  {'image sha256:':<28}{report['image_sha256']}")
    return "\n".join(lines)


def left_out_text(scene: str, count: int, left_out: Sequence[LeftOut]) -> str:
    """Who does not render, why, and how to change that, while `count` nodes do."""
    from scenefold.base.ids import address_of
    from scenefold.render.choice import how_to_admit

    by_reason: dict[str, list[str]] = {}
    for one in left_out:
        by_reason.setdefault(one.why, []).append(address_of(one.node))
    reasons = "; ".join(f"{_few(addresses)}: {why}" for why, addresses in by_reason.items())
    return f"note: {count} of {count + len(left_out)} nodes render ({reasons}): {how_to_admit(scene)}"


def _tell_left_out(job: StillJob, renderers: Renderers) -> None:
    if renderers.nodes and renderers.left_out:
        note(left_out_text(job.scene_name, len(renderers.nodes), renderers.left_out))


async def rendered(
    job: StillJob, embedded: LocalCluster | None, cluster: Cluster, scene: Scene, progress: Callable[[str, int, int], None], **options: Any
) -> StillResult:
    """As `render_still`, telling people what happens on the way. If nodes that were started for it died, and it failed over that, their own words tell more."""
    from scenefold.base.errors import Refused, Unreachable
    from scenefold.render.anew import may_pass
    from scenefold.render.client import render_still

    try:
        return await render_still(
            cluster,
            scene,
            job.options,
            progress,
            tell=partial(_tell_left_out, job),
            lost=partial(_tell_lost, embedded),
            back=_tell_back,
            anew=partial(_tell_anew, embedded),
            **options,
        )
    except (Unreachable, Refused) as error:
        if embedded is None or not embedded.deaths or not may_pass(error):
            raise
        raise next(reversed(embedded.deaths.values())) from error


def _tell_lost(embedded: LocalCluster | None, address: str) -> None:
    death = None if embedded is None else embedded.deaths.get(address)
    words = "" if death is None else f" ({death.what})"
    note(f"note: node {address} is lost{words}: the others take its part of the scene over, and trace again what only it had")


def _tell_back(address: str) -> None:
    note(f"note: node {address} is back, and takes part again")


def _tell_anew(embedded: LocalCluster | None, begun: Begun) -> None:
    note(anew_text(begun))
    if embedded is not None and embedded.deaths:
        note(f"note: {next(reversed(embedded.deaths.values())).what}")


def anew_text(begun: Begun) -> str:
    """Why a render is begun anew, by whom, and from where on."""
    where = f" ({begun.error.where})" if begun.error.where else ""
    without = f" without {_few(begun.without)}" if begun.without else ""
    passes = f" behind the {begun.passes:,} passes that were kept" if begun.passes else ""
    return f"note: {begun.error.what}{where}: it is begun anew{without}{passes}"


def _few(addresses: Sequence[str]) -> str:
    return ", ".join(addresses[:ADDRESSES_SHOWN]) + (
        f" and {len(addresses) - ADDRESSES_SHOWN} more" if len(addresses) > ADDRESSES_SHOWN else ""
    )


@asynccontextmanager
async def _struck(job: StillJob, embedded: LocalCluster | None) -> AsyncIterator[Strike | None]:
    """While a node may be killed on purpose; None if none is."""
    if not job.kill or embedded is None or len(embedded.addresses) < 2:
        yield None
        return
    from scenectl.striking import Strike
    from scenefold.world import background_tasks

    strike = Strike(embedded)
    async with background_tasks() as nursery:
        nursery.start_soon(strike.run)
        yield strike


@asynccontextmanager
async def cluster_of(job: StillJob, phases: Phases) -> AsyncIterator[tuple[Cluster, LocalCluster | None]]:
    """And the nodes, if they are started for this."""
    from scenectl.running import connected
    from scenefold.client import connect

    if job.profile is not None:
        async with connected(job.profile) as cluster:
            yield cluster, None
        return
    from scenefold.node.local import local_cluster

    begun = time.monotonic()
    stopping = begun
    async with local_cluster(job.nodes, threads=job.threads, ports=cluster_ports(job.ports), trust=True) as embedded:
        async with connect(embedded.profile) as cluster:
            phases.seconds["start"] = round(time.monotonic() - begun, 3)
            yield cluster, embedded
            stopping = time.monotonic()
    phases.seconds["stop"] = round(time.monotonic() - stopping, 3)


def write_image(scene: str, files: ImageFiles, options: RenderOptions, layers: dict[str, Pixels], exposure: float | None) -> dict[str, Any]:
    """Write the files; what the report says of them. In a worker."""
    from scenefold.render.image_files import image_sha256, write_exr, write_png

    sha256 = image_sha256(layers["beauty"])
    said = {name: value for name, value in asdict(options.sampling).items() if value is not None}
    if options.lens is not None:
        said |= asdict(options.lens)
    metadata = {"scenefold.scene": scene, "scenefold.image_sha256": sha256, **{f"scenefold.{name}": said[name] for name in said}}
    write_exr(files.exr, layers, metadata, options.crop, (options.width, options.height))
    shown = write_png(files.png, layers["beauty"], exposure, files.view)
    return {
        "image_sha256": sha256,
        "exr": str(files.exr),
        "size": [options.width, options.height],
        "crop": None if options.crop is None else options.crop.row(),
        "lens": None if options.lens is None else options.lens.row(),
        **asdict(options.sampling),
        "environment_rotation": options.environment_rotation,
        "mips": options.mips,
        "layers": list(layers),
        "png": str(files.png),
        "view": files.view,
        "exposure": shown.exposure,
        "pixels_not_finite": shown.not_finite,
    }


def render_progress(progress: ProgressCallback) -> Callable[[str, int, int], None]:
    """A render's progress as that of a command."""
    from scenefold.client import ProgressState

    units = {"prepare": "scene", "render": "passes", "fetch": "bytes"}
    return lambda phase, done, total: progress(ProgressState(phase, done, total, units.get(phase, "")))


def told_to(strike: Strike | None, progress: Callable[[str, int, int], None]) -> Callable[[str, int, int], None]:
    """A render's progress, for both."""
    if strike is None:
        return progress

    def both(phase: str, done: int, total: int) -> None:
        progress(phase, done, total)
        strike.seen(phase, done, total)

    return both


def _value_text(key: str, value: Any) -> str:
    if key == "bytes_passed":
        return size_text(value)
    if isinstance(value, list):
        return ", ".join(value) or "none"
    if isinstance(value, float):
        return f"{value:,.3f}" if value < 100 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
