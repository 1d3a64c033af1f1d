"""`scenectl image`: finished images that stay in their scene."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, date_text, emit, note, size_text, table

if TYPE_CHECKING:
    from scenectl.progress import Progress
    from scenefold.base.errors import ScenefoldError
    from scenefold.client import Cluster, Scene
    from scenefold.client.progress import ProgressCallback
    from scenefold.render.scene_images import Images, SceneImage

app = App(name="image", help="Keep finished images in their scene, and fetch them.", help_format="plaintext")
UNSAVED = "why it is not saved"
TITLES = ("image", "size", "file", "saved")
ImageName = Annotated[str, Parameter(allow_leading_hyphen=True)]


@app.command(name="list")
def list_all(*, scene: SceneOption, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List the images that are kept in a scene.

    Example: scenectl image list --scene kitchen --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    """
    from scenectl.running import connected, run

    async def look() -> Images:
        from scenefold.render.scene_images import list_images

        async with connected(output.profile) as cluster:
            return await list_images(await cluster.scenes.open(scene))

    images = run(look)
    for names, what in ((images.unfinished, "not whole: somebody saves or deletes them, or was interrupted"), (images.damaged, "damaged")):
        if names:
            note(f"note: these are {what}: {', '.join(names)}")
    rows = [(one.name, f"{one.width}x{one.height}", size_text(one.size), date_text(one.saved_at)) for one in images.whole]
    text = table(TITLES, rows) if rows else f"There are no images in {scene}."
    document = {"images": [one.document() for one in images.whole], "unfinished": list(images.unfinished), "damaged": list(images.damaged)}
    emit(output, {"scene": scene, **document}, text)


@app.command
def save(name: ImageName, file: Path, /, *, scene: SceneOption, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Keep an OpenEXR file in a scene under a name: encrypted as the scene is, and with as many copies. One of that name is replaced.

    Example: scenectl image save final kitchen.exr --scene kitchen --profile studio

    Parameters
    ----------
    name
        Up to 64 letters, digits, '-', '_' or '.'.
    file
        An image that a render has written.
    scene
        Name of the scene.
    """
    from scenefold.render.scene_images import save_image

    image = _moved(save_image, name, file, scene, "save", output)
    emit(output, {"scene": scene, **image.document()}, saved_text(scene, image))


@app.command
def get(
    name: ImageName,
    /,
    *,
    scene: SceneOption,
    to: Annotated[Path, Parameter(name=("--output", "-o"))] = Path("image.exr"),
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Write an image that is kept in a scene as the OpenEXR file that it was.

    Example: scenectl image get final --scene kitchen -o kitchen.exr --profile studio

    Parameters
    ----------
    name
        Its name, as `scenectl image list` shows it.
    scene
        Name of the scene.
    to
        OpenEXR file to write.
    """
    from scenefold.render.image_files import check_writable
    from scenefold.render.scene_images import fetch_image

    check_writable(to)
    image = _moved(fetch_image, name, to, scene, "fetch", output)
    emit(output, {"scene": scene, **image.document(), "exr": str(to)}, f"{to} is written: {image.width}x{image.height}.")


@app.command
def rm(name: ImageName, /, *, scene: SceneOption, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Delete an image from its scene.

    Example: scenectl image rm draft --scene kitchen --profile studio

    Parameters
    ----------
    name
        Its name, as `scenectl image list` shows it.
    scene
        Name of the scene.
    """
    from scenectl.running import connected, run

    async def work() -> None:
        from scenefold.render.scene_images import remove_image

        async with connected(output.profile) as cluster:
            await remove_image(await cluster.scenes.open(scene), name)

    run(work)
    emit(output, {"scene": scene, "image": name, "removed": True}, f"The image {name} is deleted from {scene}.")


def _moved(
    move: Callable[[Cluster, Scene, str, Path, Callable[[int, int], Any]], Awaitable[SceneImage]],
    name: str,
    path: Path,
    scene: str,
    phase: str,
    output: ProfileOutput,
) -> SceneImage:
    """Save or fetch one, and show how far that is."""
    from scenectl.progress import Progress
    from scenectl.running import connected, run

    async def work(progress: Progress) -> SceneImage:
        async with connected(output.profile) as cluster:
            return await move(cluster, await cluster.scenes.open(scene), name, path, bytes_of(progress, phase))

    with Progress(quiet=output.json) as progress:
        return run(work, progress)


def check_saved(where: str, save: str | None, profile: str | None) -> None:
    """UsageFault for a name that no image can have, or where there is no scene that it could be kept in. Asked before the work."""
    from scenefold.base.errors import UsageFault
    from scenefold.base.names import is_name, name_rule

    if save is None:
        return
    if profile is None:
        raise UsageFault("--save keeps an image in a scene of a cluster", where=where, remedy="give --profile, or leave it out")
    if not is_name(save):
        raise UsageFault("no image can be called so", where=f"--save {save[:80]}", remedy=f"give {name_rule()}")


async def keep_written(cluster: Cluster, scene: Scene, name: str | None, exr: Path, progress: ProgressCallback) -> dict[str, Any]:
    """Keep a file that was written just now, if it has a name; what the report says of that."""
    if name is None:
        return {}
    from scenefold.base.errors import ScenefoldError
    from scenefold.render.scene_images import save_image

    try:
        return {"saved": (await save_image(cluster, scene, name, exr, bytes_of(progress, "save"))).name}
    except ScenefoldError as error:
        # The report of what was made is worth more than this, and is told first.
        note(f"note: {exr} is written, and could not be kept in the scene: scenectl image save {name} {exr} --scene {scene.name}")
        return {"saved": None, UNSAVED: error}


def unsaved(report: dict[str, Any]) -> ScenefoldError | None:
    """Why an image could not be kept; taken out of the report."""
    error: ScenefoldError | None = report.pop(UNSAVED, None)
    return error


def saved_text(scene: str, image: SceneImage) -> str:
    """What was kept, and how to have it back."""
    return f"{image.name} is kept in {scene}: scenectl image get {image.name} --scene {scene} -o image.exr"


def bytes_of(progress: ProgressCallback, phase: str) -> Callable[[int, int], Any]:
    """Bytes of a phase as the progress of a command."""
    from scenefold.client import ProgressState

    return lambda done, total: progress(ProgressState(phase, done, total, "bytes"))
