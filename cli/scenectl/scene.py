"""`scenectl scene`: make scenes, list them, look into them, import files, archive them, say who may use them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from scenectl.archives import export, import_archive
from scenectl.copies import CopiesOption, MinCopiesOption, lacking_text
from scenectl.deciding import ParticipantsOption, add_participant, even_warning, participants, relieve, remove_participant
from scenectl.ending import rm
from scenectl.modes import mode
from scenectl.moment_values import FpsOption, FrameOption, TimeOption, moment_of
from scenectl.names import SceneName, SceneOption
from scenectl.observing import add_observer, remove_observer
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note, size_text, table
from scenectl.purging import purge, strays
from scenectl.replacing import replaced_text, tell_replaced
from scenectl.scene_log import log
from scenectl.settings import settings
from scenectl.sharing import access, former_keys_text, grant, revoke, rotate_key, seconds_to_look
from scenectl.standing import status
from scenefold.base.ids import address_of

if TYPE_CHECKING:
    from scenefold.client import Deciders, FormerKeys, ImportReport, SceneInfo, SceneListing
    from scenefold.scene.importers import Moment

app = App(name="scene", help="Make scenes, fill them, and say who may use them.", help_format="plaintext")
VERBS: tuple[Callable[..., int | None], ...] = (
    export,
    import_archive,
    grant,
    access,
    revoke,
    rotate_key,
    log,
    status,
    mode,
    settings,
    rm,
    participants,
    add_participant,
    remove_participant,
    add_observer,
    remove_observer,
    relieve,
    purge,
    strays,
)
for verb in VERBS:
    app.command(verb)


@app.command
def create(
    name: SceneName,
    /,
    *,
    copies: CopiesOption | None = None,
    min_copies: MinCopiesOption | None = None,
    participants: ParticipantsOption | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Make an empty scene; its keys go into the profile's keyring before any node hears of it.

    Example: scenectl scene create kitchen --profile studio

    Parameters
    ----------
    name
        Name of the scene in this profile: letters, digits, '-', '_' and '.'.
    copies
        How many nodes shall hold each record of the spaces that it begins with, 1 to 8; by default 3.
    min_copies
        How many must hold a record before it counts as stored; by default 2, or as many as there are copies.
    participants
        How many trusted nodes decide what becomes of the scene, or their addresses, separated by commas; by default up to seven, an odd number. With origin, and where fewer than three are trusted, the cluster's first voter decides alone.
    """
    from scenectl.running import connected, run

    deciding: dict[str, Any] = {} if participants is None else {"participants": participants.wanted}

    async def make() -> dict[str, Any]:
        async with connected(output.profile) as cluster:
            scene = await cluster.scenes.create(name, copies=copies, copies_min=min_copies, **deciding)
            return {"name": name, "scene": f"{scene.id:08x}", "genesis": scene.genesis.hex()}

    document = run(make)
    if participants is not None and (warning := even_warning(participants.count)):
        note(f"warning: {warning}")
    emit(output, document, f"Scene {name} is made; its id is {document['scene']}.")


@app.command(name="list")
def list_(
    *,
    ended: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """List the scenes of the cluster, also those whose keys this profile does not hold.

    Example: scenectl scene list --profile studio --json

    Parameters
    ----------
    ended
        Also those that were ended (`scene rm`), of which nothing is left but that.
    """
    from scenectl.running import connected, run

    async def ask() -> list[SceneListing]:
        async with connected(output.profile) as cluster:
            return await cluster.scenes.list(ended=ended)

    found = run(ask)
    rows = [_row(scene, ended=ended) for scene in found]
    document = {"scenes": [scene.document() for scene in found]}
    titles = ("name", "id", "key held", "granted by", *(("ended",) if ended else ()))
    emit(output, document, table(titles, rows) if rows else "No scene yet.")


def _row(scene: SceneListing, *, ended: bool) -> tuple[str, ...]:
    shown = scene.name or "-", f"{scene.id:08x}", "yes" if scene.has_key else "no", scene.granted_by or ""
    return (*shown, "yes" if scene.is_ended else "no") if ended else shown


@app.command
def info(name: SceneName, /, *, look: float | None = None, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show what a scene holds.

    Example: scenectl scene info kitchen --profile studio

    Parameters
    ----------
    name
        Name of the scene in this profile.
    look
        Seconds to look for records under former keys, at most; by default 3.
    """
    from scenectl.running import connected, run

    look_s = seconds_to_look(look)

    async def ask() -> tuple[SceneInfo, FormerKeys, Deciders]:
        async with connected(output.profile) as cluster:
            scene = await cluster.scenes.open(name)
            return await scene.info(), await scene.former_keys(look_s), await scene.deciders()

    found, former, deciders = run(ask)
    document = found.document() | {"former_keys": former.value, "decided_by": [address_of(node) for node in deciders.nodes]}
    lines = [f"{key.replace('_', ' ')}: {_plain(value)}" for key, value in document.items()]
    emit(output, document, "\n".join(lines) + former_keys_text(name, former) + lacking_text(name, found.lacking))


@app.command(name="import")
def import_(
    file: Path,
    /,
    *,
    scene: SceneOption | None = None,
    frame: FrameOption = None,
    fps: FpsOption = None,
    time: TimeOption = None,
    animation: str | None = None,
    environment: Path | None = None,
    rate: float | None = None,
    dry_run: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Import a glTF, GLB, OBJ, PLY or STL file into a scene, which is made if it does not exist.

    The scene shows its content only when the import is complete; an interrupted import is repeated by the same command. What a scene showed before is replaced; its records stay, unseen, until they are deleted, and are exported with the scene: for another file rather take another scene.

    Example: scenectl scene import kitchen.glb --scene kitchen --profile studio

    Parameters
    ----------
    file
        The file to import.
    scene
        Name of the scene; by default that of the file without its ending.
    frame
        Frame of a file with animations, from 0 on; without --frame and --time it is shown at rest.
    fps
        Frames in a second, by default 24.
    time
        Seconds since the animations began, instead of a frame.
    animation
        Name of the animation to play; by default all of the file play.
    environment
        Radiance .hdr or OpenEXR file of what lies infinitely far around, to light the scene by; its middle is seen along -Z.
    rate
        MiB that are stored in a second, at most, so that others can work meanwhile; by default as fast as it goes.
    dry_run
        Read the file and say what it would make, and store nothing; no node is asked.
    """
    from scenectl.progress import Progress
    from scenectl.rates import bytes_per_s
    from scenectl.running import connected, run
    from scenectl.waiting import going_on
    from scenefold.client import scene_name_of

    name, speed = scene_name_of(file.stem) if scene is None else scene, bytes_per_s(rate)
    moment = moment_of("scenectl scene import", frame=frame, fps=fps, time=time, animation=animation)
    if dry_run:
        _plan_import(name, file, moment, environment, output)
        return

    async def work(progress: Progress) -> ImportReport:
        async with connected(output.profile) as cluster:
            _, report = await cluster.scenes.import_file(
                name, file, progress, speed, environment=environment, replacing=tell_replaced(name), moment=moment
            )
            return report

    with going_on("the same command goes on where it was"), Progress(quiet=output.json) as progress:
        report = run(work, progress)
    text = f"{file} is in scene {name}: {report.records} records, {size_text(report.bytes)}, {report.seconds:.1f} s."
    text += "".join(f"\nnot carried over: {line}" for line in report.not_carried)
    if report.replaced:
        text += f"\n{replaced_text(report.replaced)}"
    emit(output, {"scene": name, "file": str(file), **report.document()}, text)


def _plan_import(name: str, file: Path, moment: Moment | None, environment: Path | None, output: ProfileOutput) -> None:
    """Say what an import would store."""
    from scenectl.progress import Progress
    from scenectl.running import run
    from scenefold.client import PreparedImport, prepare_import
    from scenefold.world import offline_world

    async def plan(progress: Progress) -> tuple[PreparedImport, int, int]:
        world = offline_world()
        prepared = await prepare_import(world, file, progress, moment, environment)
        return prepared, *await world.workers.run("import", prepared.totals)

    with Progress(quiet=output.json) as progress:
        prepared, records, size = run(plan, progress)
    left_out = list(prepared.plan.not_carried)
    text = f"{file} would be {records} records in scene {name}, {size_text(size)}, for each of its copies."
    text += "".join(f"\nnot carried over: {line}" for line in left_out)
    emit(output, {"scene": name, "file": str(file), "dry_run": True, "records": records, "bytes": size, "not_carried": left_out}, text)


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return ", ".join(f"{key} {inner}" for key, inner in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(_plain(inner) for inner in value) or "none"
    return str(value)
