"""`scenectl render`: from a scene to an image."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from scenectl.image_values import USUAL_LAYERS, CropOption, LayersOption
from scenectl.memory_values import MemoryOption
from scenectl.moment_values import FpsOption, FrameOption, TimeOption, check_of_a_file, moment_of
from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.own_cluster import check_own_cluster
from scenectl.values import ColourOption, PortsOption, SizeOption, whole
from scenefold.base.image_limits import (
    CLAMP_MAX,
    DEPTH_MAX,
    EXPOSURE_MAX,
    MIN_SAMPLES_LEAST,
    ROTATION_MAX,
    SAMPLES_MAX,
)

NODES = 5
"""Of a cluster that is started for one image."""

app = App(name="render", help="Render images.", help_format="plaintext")


@app.command
def still(
    file: Path | None = None,
    /,
    *,
    nodes: Annotated[int | None, whole(1, 127, env_var="SCENEFOLD_NODES")] = None,
    algorithm: str = "bounded-radial",
    fixed_cells: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    to: Annotated[Path, Parameter(name=("--output", "-o"))] = Path("image.exr"),
    samples: Annotated[int | None, whole(1, SAMPLES_MAX)] = None,
    adaptive: Annotated[float | None, Parameter(validator=Number(gt=0, lte=1))] = None,
    min_samples: Annotated[int | None, whole(MIN_SAMPLES_LEAST, SAMPLES_MAX)] = None,
    size: SizeOption | None = None,
    scale: Annotated[float, Parameter(validator=Number(gt=0, lte=1))] = 1.0,
    crop: CropOption | None = None,
    seed: Annotated[int, whole(0, 2**32 - 1)] = 1,
    depth: Annotated[int | None, whole(1, DEPTH_MAX)] = None,
    sky: ColourOption | None = None,
    environment: Path | None = None,
    environment_rotation: Annotated[float | None, Parameter(validator=Number(gte=-ROTATION_MAX, lte=ROTATION_MAX))] = None,
    camera: str | None = None,
    aperture: Annotated[float | None, Parameter(validator=Number(gt=0, lte=1e9))] = None,
    focus: Annotated[float | None, Parameter(validator=Number(gt=0, lte=1e9))] = None,
    sampler: Literal["sobol", "independent"] | None = None,
    roulette_from: Annotated[int | None, whole(1, DEPTH_MAX)] = None,
    clamp_direct: Annotated[float | None, Parameter(validator=Number(gt=0, lte=CLAMP_MAX))] = None,
    clamp_indirect: Annotated[float | None, Parameter(validator=Number(gt=0, lte=CLAMP_MAX))] = None,
    mips: bool = True,
    frame: FrameOption = None,
    fps: FpsOption = None,
    time: TimeOption = None,
    animation: str | None = None,
    layers: LayersOption = USUAL_LAYERS,
    exposure: Annotated[float | None, Parameter(validator=Number(gte=-EXPOSURE_MAX, lte=EXPOSURE_MAX))] = None,
    view: Literal["agx", "filmic", "srgb"] = "agx",
    ignore_settings: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    resume: Path | None = None,
    memory: MemoryOption | None = None,
    threads: Annotated[int | None, whole(1, 1024, env_var="SCENEFOLD_THREADS")] = None,
    ports: PortsOption | None = None,
    scene: SceneOption | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Render one image of a scene file, or of a scene in the cluster, and wait for it.

    What is not given here is as the scene says (`scenectl scene settings`).

    Without a profile a cluster of its own is started on this machine, in a temporary folder, and removed at the end.

    Example: scenectl render still kitchen.glb --nodes 5 --samples 64 --size 640x360 -o kitchen.exr

    Example: scenectl render still --scene kitchen --profile studio -o kitchen.exr

    Example: scenectl render still city.glb --memory 512MiB --threads 4 -o city.exr

    Example: scenectl render still fox.glb --frame 12 --animation Run -o fox.0012.exr

    Parameters
    ----------
    file
        glTF, GLB, OBJ, PLY or STL file; without it --scene names a scene that the cluster holds.
    nodes
        Nodes of the cluster that is started when no profile is given; by default 5.
    algorithm
        How cells move: vivaldi, no-certainty, swarming, no-backtracking, voxelised-swarming, planar, radial, bounded-radial, power, kd; voronoi never do.
    fixed_cells
        Leave the cells where they are at first.
    to
        OpenEXR file to write; a PNG is written beside it.
    samples
        Paths for each pixel, by default 64, or as many as the scene says.
    adaptive
        Stop early where the expected error is this share of a pixel's brightness, as 0.05; --samples are then the most.
    min_samples
        With --adaptive: paths that every pixel has before any stops, by default 16.
    size
        Width and height in pixels, by default 640x360, or as the scene says.
    scale
        For a preview: make the image so much smaller, as 0.25.
    crop
        Make only this part of the image: X,Y,WIDTH,HEIGHT in its pixels, from the upper left corner; it is equal to that part of the whole.
    seed
        Seed of the random numbers; the same seed gives the same image.
    depth
        Most segments of a path, the camera ray being the first; by default 8, or as the scene says.
    sky
        Colour of a uniform sky as R,G,B, linear; without it, and unless the scene says one, only the scene's own lights shine.
    environment
        Radiance .hdr or OpenEXR file of what lies infinitely far around the file that is given, to light it by; a --sky takes its place.
    environment_rotation
        Degrees by which the scene's environment map is turned about the vertical axis, counter-clockwise seen from above.
    camera
        Name of the camera; by default the one that the scene says, or its default one.
    aperture
        Radius of the camera's lens in the scene's unit: what is nearer or farther than the focus is blurred; by default everything is sharp.
    focus
        How far from the camera everything is sharp, in the scene's unit, measured along the way that it looks; goes with --aperture.
    sampler
        How the random numbers of a pixel's paths are drawn: sobol, the usual one, spreads them evenly, independent draws each by itself.
    roulette_from
        Bounce from which on a path that carries little light may end by chance, by default 3; as large as --depth, and none does.
    clamp_direct
        Most that one contribution of direct light may be, as the mean of red, green and blue; against fireflies, at the cost of light.
    clamp_indirect
        The same of light that was reflected more than once; 10 is a usual value.
    mips
        Read far textures from coarser levels, as their file says; --no-mips reads only the finest.
    frame
        Frame of a file with animations, from 0 on; without --frame and --time it is shown at rest.
    fps
        Frames in a second, by default 24.
    time
        Seconds since the animations began, instead of a frame.
    animation
        Name of the animation to play; by default all of the file play.
    layers
        What the EXR file holds beside the beauty, some of emission, direct, indirect, albedo, normal, depth, position, object_id, material_id, samples and variance, with commas between; or all, or none.
    exposure
        Brightness of the PNG in stops, by default as the scene says, or the image asks; the EXR is not changed.
    view
        How the PNG shows light that a screen cannot: agx and filmic roll off what is bright, srgb clips it.
    ignore_settings
        Take all that is not given here as usual, whatever the scene says.
    resume
        File in which what is rendered is kept once in a while; the same command with it goes on from there after an interruption. It is removed once the image is written.
    memory
        Memory that the render of a file may take, as 512MiB, beside 300 MiB for the program itself: what of the scene does not fit lies in files in the folder for temporary files. No cluster is started then; the image is the same.
    threads
        Threads that each node renders with, when no profile is given; with --memory, that this process renders with.
    ports
        Ports of the cluster that is started, LOW,HIGH; by default 17349,17350.
    scene
        Name of the scene; by default that of the file without its ending.
    """
    from scenectl.progress import Progress
    from scenectl.running import run
    from scenectl.still import StillJob, check_files, make_still, png_beside, report_text
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
    if file is None:
        check_of_a_file("scenectl render still", frame=frame, fps=fps, time=time, animation=animation)
    moment = moment_of("scenectl render still", frame=frame, fps=fps, time=time, animation=animation)
    check_own_cluster("scenectl render still", output.profile, of_a_cluster)
    if min_samples is not None and adaptive is None:
        raise UsageFault("--min-samples counts with --adaptive only", where="scenectl render still", remedy="give both, or none")
    png = png_beside(to)
    from scenefold.render.client import StillOptions
    from scenefold.render.window import Window

    options = StillOptions(
        width=None if size is None else size.width,
        height=None if size is None else size.height,
        samples=samples,
        seed=seed,
        depth=depth,
        algorithm=algorithm,
        fixed_cells=fixed_cells,
        sky=None if sky is None else sky.rgb,
        camera=camera,
        exposure=exposure,
        aperture=aperture,
        focus=focus,
        environment_rotation=environment_rotation,
        sampler=sampler,
        roulette_from=roulette_from,
        clamp_direct=clamp_direct,
        clamp_indirect=clamp_indirect,
        mips=mips,
        layers=layers.names,
        scale=scale,
        crop=None if crop is None else Window(*crop.numbers),
        adaptive=adaptive,
        min_samples=min_samples,
        ignore_settings=ignore_settings,
    )
    options.checked()
    name = scene_name_of(file) if scene is None else scene
    check_files(file, to, png, *(() if resume is None else (resume,)))
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
        exr=to,
        png=png,
        view=view,
        resume=resume,
    )
    if memory is not None:
        check_alone(file, output.profile, {"--nodes": nodes, "--ports": ports, "--resume": resume})
        from scenectl.still_within import make_within

        with Progress(quiet=output.json) as progress:
            report = run(make_within, memory.bytes, job, progress)
        emit(output, report, report_text(report))
        return
    again = nullcontext() if output.profile is None else going_on("render again")
    with again, Progress(quiet=output.json) as progress:
        report = run(make_still, job, progress)
    emit(output, report, report_text(report))


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
