"""`scenectl scene`: make scenes, list them, look into them, import files, say who may use them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.member_values import GranteeOption, shown_member
from scenectl.names import SceneName, SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, size_text, table

if TYPE_CHECKING:
    from scenefold.client import Access, ImportReport, SceneInfo, SceneListing

app = App(name="scene", help="Make scenes, fill them, and say who may use them.", help_format="plaintext")


@app.command
def create(name: SceneName, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Make an empty scene; its keys go into the profile's keyring before any node hears of it.

    Example: scenectl scene create kitchen --profile studio

    Parameters
    ----------
    name
        Name of the scene in this profile: letters, digits, '-', '_' and '.'.
    """
    from scenectl.running import connected, run

    async def make() -> dict[str, Any]:
        async with connected(output.profile) as cluster:
            scene = await cluster.scenes.create(name)
            return {"name": name, "scene": f"{scene.id:08x}", "genesis": scene.genesis.hex()}

    document = run(make)
    emit(output, document, f"Scene {name} is made; its id is {document['scene']}.")


@app.command(name="list")
def list_(*, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List the scenes of the cluster, also those whose keys this profile does not hold.

    Example: scenectl scene list --profile studio --json
    """
    from scenectl.running import connected, run

    async def ask() -> list[SceneListing]:
        async with connected(output.profile) as cluster:
            return await cluster.scenes.list()

    found = run(ask)
    rows = [(scene.name or "-", f"{scene.id:08x}", "yes" if scene.has_key else "no", scene.granted_by or "") for scene in found]
    document = {"scenes": [scene.document() for scene in found]}
    emit(output, document, table(("name", "id", "key held", "granted by"), rows) if rows else "No scene yet.")


@app.command
def info(name: SceneName, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show what a scene holds.

    Example: scenectl scene info kitchen --profile studio

    Parameters
    ----------
    name
        Name of the scene in this profile.
    """
    from scenectl.running import connected, run

    async def ask() -> SceneInfo:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(name)).info()

    found = run(ask)
    lines = [f"{key.replace('_', ' ')}: {_plain(value)}" for key, value in found.document().items()]
    emit(output, found.document(), "\n".join(lines))


@app.command(name="import")
def import_(
    file: Path,
    /,
    *,
    scene: SceneOption | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Import a glTF, GLB, OBJ, PLY or STL file into a scene, which is made if it does not exist.

    The scene shows its content only when the import is complete; an interrupted import is repeated by the same command.

    Example: scenectl scene import kitchen.glb --scene kitchen --profile studio

    Parameters
    ----------
    file
        The file to import.
    scene
        Name of the scene; by default that of the file without its ending.
    """
    from scenectl.progress import Progress
    from scenectl.running import connected, run
    from scenefold.client import scene_name_of

    name = scene_name_of(file.stem) if scene is None else scene

    async def work(progress: Progress) -> ImportReport:
        async with connected(output.profile) as cluster:
            _, report = await cluster.scenes.import_file(name, file, progress)
            return report

    with Progress(quiet=output.json) as progress:
        report = run(work, progress)
    text = f"{file} is in scene {name}: {report.records} records, {size_text(report.bytes)}, {report.seconds:.1f} s."
    text += "".join(f"\nnot carried over: {line}" for line in report.not_carried)
    emit(output, {"scene": name, "file": str(file), **report.document()}, text)


@app.command
def grant(
    scene: SceneName,
    who: GranteeOption,
    /,
    *,
    role: Annotated[str, Parameter(name=("--role", "-r"))] = "reader",
    card: Path | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Let somebody use a scene: a user, or a node that shall read it for itself. Only owners of the scene can.

    Again with a higher role raises it. To take some of it away, revoke it and grant less.

    Example: scenectl scene grant kitchen user:ada --role writer --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    who
        user:NAME, node:ID or the address of a node.
    role
        reader (reads), writer (writes, too) or owner (grants and revokes, too).
    card
        Certificate of the member; by default the one that the cluster knows.
    """
    from scenectl.running import connected, run
    from scenefold.client import card_for, role_named

    wanted = role_named(role)

    async def do() -> Access:
        async with connected(output.profile) as cluster:
            member = await card_for(cluster, who.text, card)
            return await (await cluster.scenes.open(scene)).grant(member, wanted)

    access = run(do)
    emit(output, {"scene": scene, **access.document()}, f"{shown_member(who.text)} may use {scene} as {role}.\n{_members(access)}")


@app.command
def access(scene: SceneName, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show who may use a scene, and in which role.

    Example: scenectl scene access kitchen --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    """
    from scenectl.running import connected, run

    async def ask() -> Access:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).members()

    found = run(ask)
    emit(output, {"scene": scene, **found.document()}, f"{_members(found)}\nkey epoch {found.key_epoch}")


@app.command
def revoke(scene: SceneName, who: GranteeOption, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """End somebody's access to a scene. Only owners of the scene can; the last owner stays.

    From now on everything is sealed under a new key. What lies there already was open to the member, and stays under the key that the member may have kept, until `scene rotate-key --resume` has sealed it anew.

    Example: scenectl scene revoke kitchen user:ada --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    who
        user:NAME, node:ID or the address of a node.
    """
    from scenectl.running import connected, run
    from scenefold.client import member_name

    name = member_name(who.text)

    async def do() -> Access:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).revoke(name)

    left = run(do)
    hint = f"`scenectl scene rotate-key {scene} --resume` seals anew what lies there already."
    emit(
        output,
        {"scene": scene, **left.document()},
        f"{shown_member(who.text)} has no access to {scene} any more.\n{_members(left)}\n{hint}",
    )


@app.command(name="rotate-key")
def rotate_key(
    scene: SceneName,
    /,
    *,
    resume: Annotated[bool, Parameter(show_default=False)] = False,
    rate: float | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Change a scene's key, and seal everything in it anew while others read and write.

    May be interrupted at any time; what is done stays done, and --resume goes on. Exit code 5 if something is left under an older key.

    Example: scenectl scene rotate-key kitchen --rate 20 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    resume
        Make no new key: seal anew what still lies under older ones. Writers can do this, too.
    rate
        MiB of records that are looked at in a second, at most; by default as fast as it goes.
    """
    from scenectl.progress import Progress
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault
    from scenefold.client import Reencryption

    if rate is not None and not 0.001 <= rate <= 1e6:
        raise UsageFault(f"a rate of {rate:g} MiB/s", where="--rate", remedy="give a number from 0.001 to 1000000")

    async def do(progress: Progress) -> Reencryption:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            if not resume:
                await opened.rotate_key()
            return await opened.reencrypt(progress, None if rate is None else rate * 2**20)

    with Progress(quiet=output.json) as progress:
        report = run(do, progress)
    text = f"{scene} is under key epoch {report.key_epoch}: {report.renewed} records, {size_text(report.bytes)} sealed anew, {report.seconds:.1f} s."
    if report.unreadable:
        text += f"\n{report.unreadable} records stay as they are, among them:" + "".join(f"\n  {line}" for line in report.complaints)
    if not report.ended:
        text += "\nRecords under older keys were still found in the last walk: go on with --resume."
    emit(output, {"scene": scene, **report.document()}, text)
    return DONE if report.is_complete else DEGRADED


def _members(access: Access) -> str:
    rows = [(shown_member(row["name"]), row["role"], str(row["since"])) for row in access.document()["members"]]
    return table(("member", "role", "since"), rows)


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return ", ".join(f"{key} {inner}" for key, inner in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(_plain(inner) for inner in value) or "none"
    return str(value)
