"""`scenectl space`: the spaces of a scene; make, list, move and scale them, and ask what lies in a box of the world, or look after all of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from scenectl.copies import CopiesOption, MinCopiesOption, copies, copies_cell, lacking_text, shortages_document, shortages_of, warn_of
from scenectl.names import NewSpaceName, SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note, table
from scenectl.positions import Box, BoxOption, FactorOption, PositionOption, check_dimensions
from scenectl.rebasing import rebase
from scenectl.repeating import RequestOption, decided_text, one_change
from scenectl.splitting import tidy
from scenectl.values import PlaceOption, SpaceOption, name_or_number, whole
from scenefold.client.requests import Change

if TYPE_CHECKING:
    from scenefold.client import Cluster, Scene, Space
    from scenefold.client.shortages import Shortage
    from scenefold.scene.log import Layouts, LoggedSpace

app = App(name="space", help="Make, move and query the spaces of a scene.", help_format="plaintext")
app.command(copies)
app.command(rebase)
app.command(tidy)


@app.command
def create(
    name: NewSpaceName,
    /,
    *,
    scene: SceneOption,
    box: BoxOption | None = None,
    dimensions: Annotated[int | None, whole(1, 8)] = None,
    curve: Literal["hilbert", "z-order"] | None = None,
    managed: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    parent: SpaceOption | None = None,
    offset: PlaceOption | None = None,
    copies: CopiesOption | None = None,
    min_copies: MinCopiesOption | None = None,
    render_output: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    number: Annotated[int | None, whole(1, 8191)] = None,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Make a space; it is there for ever, and nodes know of it from the next record on.

    The shadows that its copies take are made with it, with the numbers that follow.

    Example: scenectl space create particles --box 0,0,0:4,3,5 --scene kitchen --profile studio

    Parameters
    ----------
    name
        Name of the space, not all digits.
    scene
        Name of the scene.
    box
        Low and high corner of what the space spans in the world, LOW:HIGH; by default the unit box.
    dimensions
        1 to 8; by default as many as the box has, or 3.
    curve
        The curve that maps positions to the line; by default hilbert.
    managed
        The nodes choose where records lie; they have ids instead of positions, so there is no box.
    parent
        Name or number of a space that this one shall be a shadow of, with the same box, dimensions, curve and management.
    offset
        How far along the line from a record the shadow's copy belongs, in hexadecimal: 80 is half of the line; by default where there is most room.
    copies
        How many nodes shall hold each record, 1 to 8; by default 3.
    min_copies
        How many must hold a record before it counts as stored; by default 2, or as many as there are copies.
    render_output
        The space may be written while the scene is being rendered.
    number
        Number of the space; by default the next free one.
    """
    from scenectl.running import run

    options: dict[str, Any] = {
        "dimensions": dimensions,
        "curve": curve,
        "node_managed": managed or None,
        "parent": None if parent is None else name_or_number(parent.text),
        "offset": None if offset is None else offset.first,
        "copies": copies,
        "copies_min": min_copies,
        "render_output": render_output,
        "space_id": number,
    }
    corners, change = None if box is None else (box.low, box.high), Change(request)

    async def make(opened: Scene, cluster: Cluster) -> tuple[LoggedSpace, list[Shortage] | None]:
        made = (await opened.create_space(name, corners, again=change, **options)).made
        assert made is not None
        return made, await shortages_of(cluster, made)

    with one_change("space create", scene, change):
        made, short = run(_in_cluster, output.profile, scene, make)
    document = {"scene": scene, **made.document(), "position": change.position, "shortages": shortages_document(short)}
    emit(output, document, f"Space {made.name} is made; its number is {made.id}.{decided_text(change)}")
    warn_of(made.name, short)


@app.command(name="list")
def list_(
    *,
    scene: SceneOption,
    all_: Annotated[bool, Parameter(name="--all", negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """List the spaces of a scene, with what its log has done to them. Shadows, which hold their copies, are left out.

    Example: scenectl space list --scene kitchen --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    all_
        List shadows, too. With --json they are always there.
    """
    from scenectl.running import run
    from scenefold.scene.log import Layouts

    async def ask(opened: Scene) -> tuple[int, list[LoggedSpace]]:
        spaces = await opened.spaces()
        return opened.access.identity.position, spaces

    position, spaces = run(_in_scene, output.profile, scene, ask)
    titles = ("number", "name", "D", "curve", "places", "copies", "box in the world", "scaled by", "moved by")
    layouts = Layouts.of(space.public() for space in spaces)
    listed = [{**space.document(), "shadows": list(layouts.shadows.get(space.id, ()))} for space in spaces]
    names = {space.id: space.name for space in spaces}
    rows = [_row(space, names, layouts) for space in spaces if all_ or not space.parent]
    emit(output, {"scene": scene, "position": position, "spaces": listed}, table(titles, rows) + lacking_text(scene, layouts.lacking()))


@app.command
def translate(
    space: SpaceOption,
    /,
    *,
    by: PositionOption,
    scene: SceneOption,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Move a whole space in the world. No record is moved: its addresses mean other positions from now on.

    Example: scenectl space translate particles --by 0,0,-1.5 --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    by
        How far, one number for each dimension.
    scene
        Name of the scene.
    """
    from scenectl.running import run

    change = Change(request)

    async def move(opened: Scene) -> LoggedSpace:
        moved = await opened.space_named(name_or_number(space.text))
        known = await moved.info()
        if not known.node_managed and not known.parent:  # else it cannot be moved at all, which the log says
            check_dimensions(len(by.coordinates), known.dimensions, "an offset", f"space {space}")
        return await moved.translate(by.coordinates, again=change)

    with one_change("space translate", scene, change):
        found = run(_in_scene, output.profile, scene, move)
    _emit_moved(output, scene, found, change)


@app.command
def scale(
    space: SpaceOption,
    /,
    *,
    by: FactorOption,
    scene: SceneOption,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Scale a whole space about the world's origin, along all axes alike. No record is moved.

    Example: scenectl space scale particles --by 2.5 --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    by
        The factor, above 0.
    scene
        Name of the scene.
    """
    from scenectl.running import run

    change = Change(request)

    async def grow(opened: Scene) -> LoggedSpace:
        return await (await opened.space_named(name_or_number(space.text))).scale(by, again=change)

    with one_change("space scale", scene, change):
        found = run(_in_scene, output.profile, scene, grow)
    _emit_moved(output, scene, found, change)


@app.command
def query(
    space: SpaceOption,
    /,
    *,
    box: BoxOption | None = None,
    scene: SceneOption,
    limit: Annotated[int, whole(1, 2**63 - 1)] = 1000,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """List the records in a box of the world with their positions as they are now; in a managed space, all with their ids.

    Example: scenectl space query particles --box 0,0,0:1,1,1 --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    box
        Low and high corner, LOW:HIGH; by default the whole space.
    scene
        Name of the scene.
    limit
        Most records to list.
    """
    from scenectl.running import run

    async def ask(opened: Scene) -> tuple[dict[str, Any], list[dict[str, Any]], bool]:
        asked = await opened.space_named(name_or_number(space.text))
        return await _records(asked, box, limit)

    about, records, more = run(_in_scene, output.profile, scene, ask)
    if more and not output.json:
        note(f"more than {limit}: ask for a smaller box, or raise --limit")
    rows = [(record["location"], _position_or_id(record)) for record in records]
    titles = ("location", "id" if about["low"] is None else "position")
    document = {"scene": scene, **about, "records": records, "more": more}
    emit(output, document, table(titles, rows) if rows else "Nothing lies there.")


async def _records(space: Space, box: Box | None, limit: int) -> tuple[dict[str, Any], list[dict[str, Any]], bool]:
    """What was asked, at most `limit` records, and whether there are more."""
    known = await space.info()
    if box is not None and not known.node_managed:
        check_dimensions(len(box.low), known.dimensions, "a corner of the box", f"space {known.name}")
    records: list[dict[str, Any]] = []
    if known.node_managed and box is None:
        about: dict[str, Any] = {"space": space.id, "low": None, "high": None}
        async for place in space.managed.query():
            if len(records) == limit:
                return about, records, True
            records.append({"location": place.location.hex(), "object": place.object.hex()})
        return about, records, False
    low, high = known.world_box if box is None else (box.low, box.high)
    about = {"space": space.id, "low": list(low), "high": list(high)}
    async for found in space.query_box(low, high):
        if len(records) == limit:
            return about, records, True
        records.append({"location": found.location.hex(), "position": list(found.position)})
    return about, records, False


def _position_or_id(record: dict[str, Any]) -> str:
    return str(record["object"]) if "object" in record else " ".join(f"{part:.6g}" for part in record["position"])


async def _in_cluster(profile: str | None, scene: str, work: Any) -> Any:
    from scenectl.running import connected

    async with connected(profile) as cluster:
        return await work(await cluster.scenes.open(scene), cluster)


async def _in_scene(profile: str | None, scene: str, work: Any) -> Any:
    return await _in_cluster(profile, scene, lambda opened, _cluster: work(opened))


def _emit_moved(output: ProfileOutput, scene: str, space: LoggedSpace, change: Change) -> None:
    low, high = space.world_box
    text = f"Space {space.name} spans {_corner(low)} to {_corner(high)} from now on.{decided_text(change)}"
    emit(output, {"scene": scene, **space.document(), "position": change.position}, text)


def _row(space: LoggedSpace, names: Mapping[int, str], layouts: Layouts) -> tuple[object, ...]:
    low, high = space.world_box
    places = "nodes choose" if space.node_managed else "fixed"
    if space.parent:
        places = f"shadow of {names[space.parent]}"
    known = space.id, space.name, space.dimensions, space.curve, places, copies_cell(space, layouts)
    if space.node_managed:
        return *known, "-", "-", "-"
    moved = _corner(space.transform.offset) if any(space.transform.offset) else "-"
    factor = f"{space.transform.factor:g}" if space.transform.factor != 1.0 else "-"
    return *known, f"{_corner(low)} to {_corner(high)}", factor, moved


def _corner(corner: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{part:g}" for part in corner) + ")"
