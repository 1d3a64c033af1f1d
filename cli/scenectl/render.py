"""`scenectl render`: from a scene to an image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from scenectl.image_options import USUAL_IMAGE, ImageOptions
from scenectl.memory_values import MemoryOption
from scenectl.moment_values import FpsOption, FrameOption, TimeOption, check_of_a_file, moment_of
from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.own_cluster import check_own_cluster
from scenectl.partition_options import FramesOption, PartitionOption, check_engine, check_frames_alone, check_partition, images_of
from scenectl.preview_options import NO_PREVIEWS, PreviewOptions
from scenectl.render_report import report
from scenectl.unattended import cancel, fetch, list_all, start, watch
from scenectl.values import PortsOption, whole

NODES = 5
"""Of a cluster that is started for one image."""

app = App(name="render", help="Render images.", help_format="plaintext")
VERBS: dict[str, Callable[..., None]] = {
    "start": start,
    "list": list_all,
    "watch": watch,
    "fetch": fetch,
    "cancel": cancel,
    "report": report,
}
for name, verb in VERBS.items():
    app.command(verb, name=name)


@app.command
def still(
    file: Path | None = None,
    /,
    *,
    nodes: Annotated[int | None, whole(1, 127, env_var="SCENEFOLD_NODES")] = None,
    to: Annotated[Path, Parameter(name=("--output", "-o"))] = Path("image.exr"),
    environment: Path | None = None,
    frame: FrameOption = None,
    fps: FpsOption = None,
    time: TimeOption = None,
    animation: str | None = None,
    view: Literal["agx", "filmic", "srgb"] = "agx",
    resume: Path | None = None,
    memory: MemoryOption | None = None,
    partition: PartitionOption = "spatial",
    engine: str | None = None,
    trust_network: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    frames: FramesOption | None = None,
    report_to: Annotated[Path | None, Parameter(name="--report")] = None,
    threads: Annotated[int | None, whole(1, 1024, env_var="SCENEFOLD_THREADS")] = None,
    ports: PortsOption | None = None,
    scene: SceneOption | None = None,
    image: ImageOptions = USUAL_IMAGE,
    pictures: PreviewOptions = NO_PREVIEWS,
    save: str | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Render one image of a scene file, or of a scene in the cluster, and wait for it.

    What is not given here is as the scene says (`scenectl scene settings`).

    Without a profile a cluster of its own is started on this machine, in a temporary folder, and removed at the end.

    Example: scenectl render still kitchen.glb --nodes 5 --samples 64 --size 640x360 -o kitchen.exr

    Example: scenectl render still --scene kitchen --profile studio -o kitchen.exr

    Example: scenectl render still city.glb --memory 512MiB --threads 4 -o city.exr

    Example: scenectl render still fox.glb --frame 12 --animation Run -o fox.0012.exr

    Example: scenectl render still fox.glb --frames 0-47 --animation Run -o fox.exr

    Parameters
    ----------
    file
        glTF, GLB, OBJ, PLY or STL file; without it --scene names a scene that the cluster holds.
    nodes
        Nodes of the cluster that is started when no profile is given; by default 5.
    to
        OpenEXR file to write; a PNG is written beside it.
    environment
        Radiance .hdr or OpenEXR file of what lies infinitely far around the file that is given, to light it by; a --sky takes its place.
    frame
        Frame of a file with animations, from 0 on; without --frame and --time it is shown at rest.
    fps
        Frames in a second, by default 24.
    time
        Seconds since the animations began, instead of a frame.
    animation
        Name of the animation to play; by default all of the file play.
    view
        How the PNG shows light that a screen cannot: agx and filmic roll off what is bright, srgb clips it.
    resume
        File in which what is rendered is kept once in a while; the same command with it goes on from there after an interruption. It is removed once the image is written.
    memory
        Memory that the render of a file may take, as 512MiB, beside 300 MiB for the program itself: what of the scene does not fit lies in files in the folder for temporary files. No cluster is started then; the image is the same.
    partition
        How the work is shared out: spatial, among nodes that each hold a part of the scene and pass rays on; visual, the pixels, or temporal, whole frames, among threads or other workers that each hold all of it. The image is the same. The last two need the extra scenefold[dask].
    engine
        Address of the Dask scheduler whose workers render a visual or temporal partition, as tls://10.0.0.5:8786; by default threads of this process do. The workers open the file, or the profile, themselves, under the same path or name.
    trust_network
        Use an engine at tcp:// on another computer for a file: whoever can answer in its place, or runs one of its workers, can run any program as you.
    frames
        Frames of a file with animations, FIRST-LAST, both included: by nodes one after the other, with --partition temporal several at a time. Their number is put into the names of the files.
    report_to
        File that gets the report as JSON, for `scenectl render report`.
    threads
        Threads that each node renders with, when no profile is given; with --memory or a visual or temporal partition, that this process renders with.
    ports
        Ports of the cluster that is started, LOW,HIGH; by default 17349,17350.
    save
        Name under which the image is kept in the scene, too, for `scenectl image`; with a profile.
    scene
        Name of the scene; by default that of the file without its ending.
    """
    from scenectl.image import check_saved, unsaved
    from scenectl.progress import Progress
    from scenectl.render_report import keep_report
    from scenectl.running import run
    from scenectl.still import ImageFiles, StillJob, check_apart, check_files, make_still, report_text
    from scenectl.waiting import going_on
    from scenefold.base.errors import UsageFault

    if file is None and (scene is None or output.profile is None):
        raise UsageFault("nothing to render", where="scenectl render still", remedy="name a scene file, or --scene and --profile")
    if environment is not None and file is None:
        what = "an environment map is imported together with a scene file"
        raise UsageFault(what, where="--environment", remedy="name the file, or import both: scenectl scene import --environment")
    of_a_cluster = {
        "--nodes": (nodes, "SCENEFOLD_NODES"),
        "--threads": (threads, "SCENEFOLD_THREADS"),
        "--ports": (ports, "SCENEFOLD_PORTS"),
    }
    of_pool: dict[str, tuple[object, str]] = {name: of_a_cluster[name] for name in ("--nodes", "--ports")}
    of_pool |= {"--memory": (memory, ""), "--resume": (resume, ""), "--preview": (pictures.preview, ""), "--save": (save, "")}
    of_pool |= {"--pools": (image.pools, "")}
    check_partition(partition, engine=engine, frames=frames, of_pool=of_pool, frame=frame, time=time)
    check_engine(engine, threads=threads, trust_network=trust_network)
    check_saved("scenectl render still", save, output.profile)
    if file is None:
        check_of_a_file("scenectl render still", frame=frame, frames=frames, fps=fps, time=time, animation=animation)
    check_frames_alone(frames, output.profile)
    moment = None if frames else moment_of("scenectl render still", frame=frame, fps=fps, time=time, animation=animation)
    if partition == "spatial":
        check_own_cluster("scenectl render still", output.profile, of_a_cluster)
    files = ImageFiles.beside(to, view)
    options = image.checked("scenectl render still")
    name = scene_name_of(file) if scene is None else scene
    images = images_of(to, files.png, frames)
    others = {"--resume": resume, "--report": report_to, "--preview": pictures.preview}
    check_apart("scenectl render still", {"the file": file, "--environment": environment, **images, **others})
    check_files(file, *images.values(), *(() if report_to is None else (report_to,)), kept=resume)
    previews = pictures.checked("scenectl render still", view)
    job = StillJob(
        file=file,
        moment=moment,
        environment=environment,
        scene_name=name,
        profile=output.profile,
        nodes=NODES if nodes is None else nodes,
        threads=threads,
        ports=ports,
        options=options,
        files=files,
        resume=resume,
        previews=previews,
        save=save,
    )
    if partition != "spatial":
        from scenectl.still_in_tasks import InTasks, frames_text, make_in_tasks

        how = InTasks(partition=partition, engine=engine, trust_network=trust_network, frames=frames, fps=fps, animation=animation)
        with Progress(quiet=output.json) as progress:
            made = run(make_in_tasks, job, how, progress)
        emit(output, made, frames_text(made) if "frames" in made else report_text(made))
        keep_report(report_to, made)
        return
    if memory is not None:
        of_nodes = {"--nodes": nodes, "--ports": ports, "--pools": image.pools}
        check_alone(file, output.profile, {**of_nodes, "--resume": resume, "--preview": pictures.preview})
        from scenectl.still_within import make_within

        with Progress(quiet=output.json) as progress:
            made = run(make_within, memory.bytes, job, progress)
        emit(output, made, report_text(made))
        keep_report(report_to, made)
        return
    if frames is not None:
        from scenectl.still_frames import FrameTimes, make_frames
        from scenectl.still_in_tasks import frames_text

        with Progress(quiet=output.json) as progress:
            made = run(make_frames, job, FrameTimes(frames=frames, fps=fps, animation=animation), progress)
        emit(output, made, frames_text(made))
        keep_report(report_to, made)
        return
    again = nullcontext() if output.profile is None else going_on("render again")
    with again, Progress(quiet=output.json) as progress:
        made = run(make_still, job, progress)
    problem = unsaved(made)
    emit(output, made, report_text(made))
    keep_report(report_to, made)
    if problem is not None:
        raise problem


def check_alone(file: Path | None, profile: str | None, given: Mapping[str, object]) -> None:
    """UsageFault for what cannot be beside --memory: it is for files, and this process alone."""
    from scenefold.base.errors import UsageFault

    where = "scenectl render still"
    if file is None or profile is not None:
        what = "--memory is for a file that this process renders alone"
        raise UsageFault(what, where=where, remedy="leave it out, or name a file, and no profile")
    for option, value in given.items():
        if value is not None:
            raise UsageFault(f"{option} does not go with --memory", where=where, remedy="leave out one of them")


def scene_name_of(file: Path | None) -> str:
    """A scene's name from a file's: what a name may not hold becomes '_'."""
    from scenefold.client import scene_name_of as named

    return named(file.stem if file is not None else "scene")
