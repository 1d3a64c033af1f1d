"""`scenectl data`: single records of a scene, by space and location; for looking closely and for scripts."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from scenectl.errors import STANDARD_OUTPUT
from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note, size_text, writing_to
from scenectl.splitting import merge, split
from scenectl.values import LINE_END, LINE_START, PlaceOption, SpaceName, SpaceOption, whole

if TYPE_CHECKING:
    from scenefold.client import Scene, Space

app = App(name="data", help="Read and write single records of a scene.", help_format="plaintext")
app.command(split)
app.command(merge)


@app.command
def put(
    space: SpaceOption,
    location: PlaceOption,
    file: Annotated[Path, Parameter(allow_leading_hyphen=True)],
    /,
    *,
    scene: SceneOption,
    new: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Encrypt, sign and store a file of up to 60 KiB as one record; done when it is durable.

    Example: scenectl data put files 0a note.txt --scene kitchen --profile studio

    Parameters
    ----------
    space
        Number or name of the space: yours, or meta, geometry, materials, textures, cameras, lights, instances, groups, files.
    location
        Up to 40 hexadecimal digits; missing ones are 0.
    file
        File to store; - for standard input.
    scene
        Name of the scene.
    new
        Fail if the location holds a record already.
    """
    from scenectl.running import connected, run
    from scenefold.base.errors import LocalFault
    from scenefold.base.limits import PAYLOAD_BYTES_MAX
    from scenefold.client import ABSENT

    payload = _read(file, PAYLOAD_BYTES_MAX + 1)
    if len(payload) > PAYLOAD_BYTES_MAX:
        raise LocalFault(
            "the file does not fit one record", where=str(file), remedy=f"split it into parts of up to {PAYLOAD_BYTES_MAX} bytes"
        )

    async def work() -> int:
        async with connected(output.profile) as cluster:
            target = await _space(await cluster.scenes.open(scene), space)
            await _check_fixed(target, space)
            await target.put(location.first, payload, expect=ABSENT if new else None)
            return target.id

    number = run(work)
    document = {"scene": scene, "space": number, "location": location.first.hex(), "bytes": len(payload)}
    emit(output, document, f"{size_text(len(payload))} stored at {location.first.hex()}.")


@app.command
def get(
    space: SpaceOption,
    location: PlaceOption,
    /,
    *,
    scene: SceneOption,
    to: Annotated[Path | None, Parameter(name=("--output", "-o"))] = None,
    any_copy: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Fetch a record, verify and decrypt it, and write it to a file or to standard output.

    Example: scenectl data get files 0a -o note.txt --scene kitchen --profile studio

    Parameters
    ----------
    space
        Number or name of the space.
    location
        Up to 40 hexadecimal digits; missing ones are 0.
    scene
        Name of the scene.
    to
        File to write; by default standard output, with --json the field data_base64.
    any_copy
        Take what any one node has, also if something newer may have been written since: for when too many nodes are away.
    """
    from scenectl.running import connected, run
    from scenefold.base.errors import LocalFault

    async def work() -> tuple[int, bytes | None]:
        async with connected(output.profile) as cluster:
            asked = await _space(await cluster.scenes.open(scene), space)
            return asked.id, await asked.get(location.first, any_copy=any_copy)

    number, payload = run(work)
    if payload is None:
        place = f"scene {scene}, space {space}, {location.first.hex()}"
        raise LocalFault("there is no record", where=place, remedy="`scenectl data ls` lists those that are there")
    document: dict[str, Any] = {"scene": scene, "space": number, "location": location.first.hex(), "bytes": len(payload)}
    if to is not None:
        _write(to, payload)
        emit(output, document | {"file": str(to)}, f"{size_text(len(payload))} written to {to}.")
    elif output.json:
        import base64

        emit(output, document | {"data_base64": base64.b64encode(payload).decode()}, "")
    else:
        with writing_to(STANDARD_OUTPUT):
            sys.stdout.buffer.write(payload)


@app.command
def delete(
    space: SpaceOption,
    location: PlaceOption,
    /,
    *,
    scene: SceneOption,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Delete a record: its place counts as empty once this is durable. It takes up some space until it is purged.

    Example: scenectl data delete files 0a --scene kitchen --profile studio

    Parameters
    ----------
    space
        Number or name of the space.
    location
        Up to 40 hexadecimal digits; missing ones are 0.
    scene
        Name of the scene.
    """
    from scenectl.running import connected, run
    from scenefold.base.errors import LocalFault

    async def work() -> tuple[int, bool]:
        async with connected(output.profile) as cluster:
            target = await _space(await cluster.scenes.open(scene), space)
            # Exactly what is found goes, not what somebody else puts there in this moment.
            return target.id, await target.remove(location.first)

    number, was_there = run(work)
    if not was_there:
        place = f"scene {scene}, space {space}, {location.first.hex()}"
        raise LocalFault("there is no record", where=place, remedy="`scenectl data ls` lists those that are there")
    emit(output, {"scene": scene, "space": number, "location": location.first.hex()}, f"{location.first.hex()} deleted.")


@app.command
def ls(
    space: SpaceOption,
    /,
    *,
    scene: SceneOption,
    first: PlaceOption = LINE_START,
    last: PlaceOption = LINE_END,
    limit: Annotated[int, whole(1, 2**63 - 1)] = 1000,
    deleted: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """List locations that hold records, in the order of the line; deleted ones are left out.

    Example: scenectl data ls geometry --scene kitchen --first 40 --last 7f --profile studio

    Parameters
    ----------
    space
        Number or name of the space.
    scene
        Name of the scene.
    first
        Leading digits of the first location to list.
    last
        Leading digits of the last one; what is missing is filled with f.
    limit
        Most locations to list.
    deleted
        List those of deleted records, and of parts of split ones, too. That is faster, since who leaves them out must read all records.
    """
    from scenectl.running import connected, run
    from scenectl.waiting import going_on
    from scenefold.base.errors import UsageFault

    if first.first > last.last:
        raise UsageFault("the first location lies behind the last", where=f"--first {first} --last {last}", remedy="exchange them")

    async def work() -> tuple[int, list[str], bool]:
        found: list[str] = []
        async with connected(output.profile) as cluster:
            asked = await _space(await cluster.scenes.open(scene), space)
            async for location in asked.query(first.first, last.last, deleted=deleted):
                if len(found) == limit:
                    return asked.id, found, True
                found.append(location.hex())
        return asked.id, found, False

    with going_on("list again"):
        number, locations, more = run(work)
    text = "\n".join(locations)
    if more and not output.json:
        note(f"more than {limit}: go on with --first, or raise --limit")
    emit(output, {"scene": scene, "space": number, "locations": locations, "more": more}, text)


async def _space(scene: Scene, space: SpaceName) -> Space:
    """The space; only of one that has a name of its own the log is asked, whose keeper may be away."""
    return await scene.space_named(space.text) if space.number is None else scene.space(space.number)


async def _check_fixed(target: Space, space: SpaceName) -> None:
    from scenefold.base.errors import UsageFault
    from scenefold.scene.layout import SPACES

    by_nodes = [one.id for one in SPACES if one.node_managed]
    if target.id in by_nodes or (space.number is None and (await target.info()).node_managed):
        remedy = "use `put_managed` of the Python client"
        raise UsageFault("the nodes choose the places in this space", where=f"space {space}", remedy=remedy)


def _read(file: Path, count: int) -> bytes:
    from scenefold.base.errors import LocalFault

    if str(file) == "-" and sys.stdin is None:
        raise LocalFault("there is nothing to read", where="standard input is closed", remedy="name a file, or send it one")
    if str(file) == "-":
        return sys.stdin.buffer.read(count)
    try:
        with file.open("rb") as source:
            return source.read(count)
    except OSError as error:
        raise LocalFault(f"cannot read the file: {error.strerror}", where=str(file), remedy="check the path") from error


def _write(file: Path, payload: bytes) -> None:
    from scenefold.base.errors import LocalFault

    try:
        file.write_bytes(payload)
    except OSError as error:
        remedy = "choose another file, in a folder that is there and has room"
        raise LocalFault(f"cannot write the file: {error.strerror}", where=str(file), remedy=remedy) from error
