"""`scenectl render start|list|watch|fetch|cancel`: images that are made while nobody waits."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from scenectl.image_options import USUAL_IMAGE, ImageOptions
from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note, table, time_text
from scenectl.partition_options import PartitionOption, images_of
from scenectl.preview_options import NO_PREVIEWS, PreviewOptions

if TYPE_CHECKING:
    from collections.abc import Callable

    from scenectl.progress import Progress
    from scenefold.client import Cluster, Scene
    from scenefold.render.choice import Renderers
    from scenefold.render.client import Started
    from scenefold.render.preview_files import Previews
    from scenefold.render.reports import NodeStand, Stand
    from scenefold.render.unattended import KnownRender, Listing

    Seen = Callable[[Stand, list[NodeStand]], None]

TITLES = ("render", "scene", "size", "samples", "state", "begun", "organiser")


def start(
    *,
    scene: SceneOption,
    partition: PartitionOption = "spatial",
    image: ImageOptions = USUAL_IMAGE,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Have an image of a scene in the cluster rendered, and do not wait for it: it goes on when this command has ended.

    It ends once all nodes have what they need and trace, and prints the render's name. The image stays with one of the nodes, in
    its memory, for a day: fetch it with `scenectl render fetch`. With that node it is lost; others may die.

    Example: scenectl render start --scene kitchen --samples 4096 --size 1920x1080 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    partition
        How the work is shared out: spatial. The others need somebody who waits, as `scenectl render still` does.
    """
    from scenectl.progress import Progress
    from scenectl.running import connected, run
    from scenectl.still import anew_text, left_out_text, render_progress

    if partition != "spatial":
        from scenefold.base.errors import UsageFault

        what = f"a {partition} partition is put together by who asked for it, and nobody would be there"
        raise UsageFault(what, where="scenectl render start", remedy="use scenectl render still")
    options = image.checked("scenectl render start")

    def tell(renderers: Renderers) -> None:
        if renderers.nodes and renderers.left_out:
            note(left_out_text(scene, len(renderers.nodes), renderers.left_out))

    async def begin(progress: Progress) -> Started:
        from scenefold.render.client import start_still

        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            return await start_still(
                cluster, opened, options, render_progress(progress), tell=tell, anew=lambda begun: note(anew_text(begun))
            )

    with Progress(quiet=output.json) as progress:
        started = run(begin, progress)
    document = {
        "render": started.name,
        "scene": scene,
        "organiser": started.organiser,
        "nodes": len(started.renderers.nodes),
        "left_out": [one.document() for one in started.renderers.left_out],
    }
    text = f"Render {started.name} has begun on {len(started.renderers.nodes)} nodes; {started.organiser} will have the image:"
    emit(output, document, f"{text} scenectl render fetch {started.name} -o image.exr")


def list_all(*, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List your renders in the cluster: those that go on by themselves, and those that a client waits for.

    Example: scenectl render list --profile studio
    """
    from scenectl.running import connected, run

    async def look() -> Listing:
        from scenefold.render.unattended import list_renders

        async with connected(output.profile) as cluster:
            return await list_renders(cluster)

    listing = run(look)
    if listing.silent:
        note(f"note: renders that these organise are not listed, for they do not answer: {', '.join(listing.silent)}")
    rows = [one.document() for one in listing.renders]
    text = table(TITLES, map(_row, listing.renders)) if rows else "There are no renders of yours."
    emit(output, {"renders": rows, "silent": list(listing.silent)}, text)


def watch(render: str, /, *, pictures: PreviewOptions = NO_PREVIEWS, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Wait until a render's image is there. Ctrl-C ends the waiting, and not the render.

    Example: scenectl render watch 3f9a --profile studio

    Parameters
    ----------
    render
        Its name, or how that begins, as `scenectl render list` shows it.
    """
    from contextlib import nullcontext

    from scenectl.progress import Progress
    from scenectl.render_nodes import live_table
    from scenectl.running import connected, run

    previews = pictures.checked("scenectl render watch")

    async def wait(progress: Progress, seen: Seen | None) -> KnownRender:
        from scenefold.render.unattended import find_render

        async with connected(output.profile) as cluster:
            await _wait(cluster, await find_render(cluster, render), progress, seen, previews)
            return await find_render(cluster, render)

    # Where the table is shown it says how far the render is, too.
    with nullcontext() if output.json else live_table() as seen, Progress(quiet=output.json or seen is not None) as progress:
        done = run(wait, progress, seen)
    emit(output, done.document(), f"The image of render {done.name} is there: scenectl render fetch {done.name} -o image.exr")


def fetch(
    render: str,
    /,
    *,
    to: Annotated[Path, Parameter(name=("--output", "-o"))] = Path("image.exr"),
    view: Literal["agx", "filmic", "srgb"] = "agx",
    wait: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    keep: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    report_to: Annotated[Path | None, Parameter(name="--report")] = None,
    save: str | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Fetch a render's image, and let its node forget it once it is written.

    Example: scenectl render fetch 3f9a -o kitchen.exr --wait --profile studio

    Parameters
    ----------
    render
        Its name, or how that begins, as `scenectl render list` shows it.
    to
        OpenEXR file to write; a PNG is written beside it.
    view
        How the PNG shows light that a screen cannot: agx and filmic roll off what is bright, srgb clips it.
    wait
        Wait for the image if it is not there yet.
    keep
        Leave the image where it is, too, for as long as it would have been there.
    report_to
        File that gets the report as JSON, for `scenectl render report`.
    save
        Name under which the image is kept in its scene, too, for `scenectl image`.
    """
    from scenectl.image import check_saved, keep_written, unsaved
    from scenectl.progress import Progress
    from scenectl.render_report import keep_report
    from scenectl.running import connected, run
    from scenectl.still import ImageFiles, check_apart, check_files, render_progress, report_text, write_image

    check_saved("scenectl render fetch", save, output.profile or "usual")
    files = ImageFiles.beside(to, view)
    check_apart("scenectl render fetch", {**images_of(files.exr, files.png, None), "--report": report_to})
    check_files(None, files.exr, files.png, *(() if report_to is None else (report_to,)))

    async def get(progress: Progress) -> dict[str, Any]:
        from scenefold.render.unattended import fetch_render, find_render

        async with connected(output.profile) as cluster:
            known = await find_render(cluster, render)
            kept_in = None if save is None else await _scene_of(cluster, known)
            if wait:
                await _wait(cluster, known, progress)
            result = await fetch_render(cluster, known, render_progress(progress))
            scene = known.scene or ""
            nodes = len(await cluster.nodes())
            written = await cluster.in_worker("import", write_image, scene, files, result.options, result.layers, result.exposure)
            if kept_in is not None:
                written |= await keep_written(cluster, kept_in, save, files.exr, progress)
            if not keep and written.get("saved", "") is not None:
                await _let_go(cluster, known)
        return {
            "render": known.name,
            "scene": known.scene,
            "nodes": nodes,
            **result.report,
            **written,
            "seconds": result.report["render_seconds"],
        }

    with Progress(quiet=output.json) as progress:
        report = run(get, progress)
    problem = unsaved(report)
    emit(output, report, report_text(report))
    keep_report(report_to, report)
    if problem is not None:
        raise problem


def cancel(render: str, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """End a render, wherever it stands, also one that a client waits for, and have its image forgotten.

    Example: scenectl render cancel 3f9a --profile studio

    Parameters
    ----------
    render
        Its name, or how that begins, as `scenectl render list` shows it.
    """
    from scenectl.running import connected, run

    async def end() -> KnownRender:
        from scenefold.render.unattended import end_render, find_render

        async with connected(output.profile) as cluster:
            known = await find_render(cluster, render)
            await end_render(cluster, known)
            return known

    known = run(end)
    emit(output, known.document() | {"phase": "cancelled"}, f"Render {known.name} has ended, and its image is gone.")


async def _wait(
    cluster: Cluster, known: KnownRender, progress: Progress, seen: Seen | None = None, previews: Previews | None = None
) -> None:
    from scenectl.still import render_progress
    from scenefold.render.unattended import watch_render

    lost = partial(_tell, "is lost: the others take its part of the scene over, and trace again what only it had")
    back = partial(_tell, "is back, and takes part again")
    if previews is not None and known.unattended is not None:
        previews = replace(previews, exposure=known.unattended.exposure)
    await watch_render(cluster, known, render_progress(progress), lost=lost, back=back, seen=seen, previews=previews)


async def _scene_of(cluster: Cluster, known: KnownRender) -> Scene:
    """The one that it is of. LocalFault if it is not known by name."""
    if known.scene is None:
        from scenefold.base.errors import LocalFault

        what = "a client waits for that render, and it alone knows which scene it is of"
        raise LocalFault(what, where=known.name, remedy="save the file: scenectl image save")
    return await cluster.scenes.open(known.scene)


async def _let_go(cluster: Cluster, known: KnownRender) -> None:
    """Once it is written. That this fails is no fault of the image, which may be gone already."""
    from scenefold.base.errors import ScenefoldError
    from scenefold.render.unattended import end_render

    try:
        await end_render(cluster, known)
    except ScenefoldError as error:
        note(f"note: the image is written, and its node could not be told to forget it: {error}")


def _tell(what: str, address: str) -> None:
    note(f"note: node {address} {what}")


def _row(one: KnownRender) -> tuple[object, ...]:
    window = one.options.window
    return (
        one.name,
        one.scene or "",
        f"{window.width}x{window.height}",
        one.options.samples,
        _state_text(one),
        f"{time_text(one.age_s)} ago",
        one.organiser,
    )


def _state_text(one: KnownRender) -> str:
    """Where it stands, for people."""
    waited = " (a client waits for it)" if one.unattended is None else ""
    if one.phase == "failed":
        return f"failed: {one.failure}"
    if one.phase == "rendering":
        return f"rendering, {one.closed / max(one.passes, 1):.0%}{waited}"
    return f"{one.phase}{waited}"
