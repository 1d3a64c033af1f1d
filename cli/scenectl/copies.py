"""What is told of a space's copies, and `scenectl space copies`: say how many there shall be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, counted, emit, note
from scenectl.repeating import RequestOption, decided_text, one_change
from scenectl.values import SpaceOption, name_or_number, whole
from scenefold.base.errors import ScenefoldError
from scenefold.base.limits import COPIES_MAX
from scenefold.client.requests import Change

if TYPE_CHECKING:
    from scenefold.base.ids import SpaceId
    from scenefold.client import Cluster, CopiesPlan, Scene
    from scenefold.client.shortages import Shortage
    from scenefold.scene.log import Layouts, LoggedSpace

CopiesOption = Annotated[int, whole(1, COPIES_MAX)]
MinCopiesOption = Annotated[int, whole(1, COPIES_MAX), Parameter(name=("--min-copies", "--copies-min"))]


def copies(
    space: SpaceOption,
    number: CopiesOption,
    /,
    *,
    min_copies: MinCopiesOption | None = None,
    scene: SceneOption,
    dry_run: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Say how many nodes shall hold each record of a space from now on; an owner's to do.

    What is there already is copied, or copies of it go, while it is read and written; `cluster health` tells how far that is.

    Example: scenectl space copies particles 3 --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    number
        How many nodes shall hold each record, the one that decides about it among them.
    min_copies
        How many must hold a record before it counts as stored; by default as it was, or 2 if there was one copy.
    scene
        Name of the scene.
    dry_run
        Say what would be copied, or which copies would go, and change nothing.
    """
    from scenectl.progress import Progress
    from scenectl.running import connected, run

    wanted = Change(request)

    async def plan(progress: Progress) -> CopiesPlan:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            return await (await opened.space_named(name_or_number(space.text))).plan_copies(number, min_copies, progress)

    if dry_run:
        with one_change("space copies", scene, wanted, is_none=True), Progress(quiet=output.json) as progress:
            planned = run(plan, progress)
        emit(output, {"scene": scene, **planned.document()}, plan_text(planned))
        return

    async def change() -> tuple[LoggedSpace, list[Shortage] | None]:
        async with connected(output.profile) as cluster:
            opened: Scene = await cluster.scenes.open(scene)
            said = await (await opened.space_named(name_or_number(space.text))).set_copies(number, min_copies, again=wanted)
            return said, await shortages_of(cluster, said)

    with one_change("space copies", scene, wanted):
        said, short = run(change)
    document = {"scene": scene, **said.document(), "position": wanted.position, "shortages": shortages_document(short)}
    emit(output, document, f"Space {said.name} shall have {copies_text(said.copies, said.copies_min)}.{decided_text(wanted)}")
    warn_of(said.name, short)


async def shortages_of(cluster: Cluster, space: LoggedSpace) -> list[Shortage] | None:
    """Why the space cannot have all of its copies now; None, with a line on standard error, if nobody can tell. What was changed before stays so."""
    try:
        return await cluster.shortages(space.copies, space.copies_min)
    except ScenefoldError as problem:
        note(f"warning: whether space {space.name} can have all of its copies now is not known: {problem}; scenectl cluster health tells")
        return None


def shortages_document(shortages: Sequence[Shortage] | None) -> list[dict[str, Any]] | None:
    """The JSON form; null if nobody can tell."""
    return None if shortages is None else [one.document() for one in shortages]


def warn_of(space: str, shortages: Sequence[Shortage] | None) -> None:
    """A line on standard error if the space cannot have all of its copies now, in the words of `cluster health`."""
    if shortages:
        first, *others = shortages
        more = f"; and so of {counted(len(others), 'other node')}: scenectl cluster health" if others else ""
        note(f"warning: space {space} is degraded from the start: {first.text}: {first.to_do}{more}")


def plan_text(plan: CopiesPlan) -> str:
    """What a change would do."""
    was, now = copies_text(plan.was.copies, plan.was.copies_min), copies_text(plan.copies, plan.copies_min)
    if not plan.is_change:
        return f"Space {plan.was.name} has {now} already: nothing would change."
    document = plan.document()
    lines = [f"Space {plan.was.name} would have {now}; now it has {was}. Nothing is changed."]
    if document["copies_to_make"]:
        lines.append(
            f"Nodes would make {counted(document['copies_to_make'], 'copy', 'copies')} of {counted(plan.records, 'record')}, in the background."
        )
    if document["copies_to_drop"]:
        lines.append(
            f"{counted(document['copies_to_drop'], 'copy', 'copies')} of {counted(plan.records, 'record')} would go, in the background."
        )
    if plan.shadows:
        lines.append(f"Shadows that would be made: {', '.join(plan.shadows)}.")
    if plan.nodes < plan.copies:
        lines.append(f"There are {plan.nodes} nodes: more copies come to lie there once there are more.")
    return "\n".join(lines)


def copies_text(number: int, least: int) -> str:
    """`3 copies, at least 2 before a record counts as stored`."""
    return "one copy" if number == 1 else f"{number} copies, at least {least} before a record counts as stored"


def copies_cell(space: LoggedSpace, layouts: Layouts) -> str:
    """The same in a table, and whether a shadow is used."""
    if space.parent:
        return "holds some" if space.id in layouts.shadows[space.parent] else "holds none"
    if space.copies == 1:
        return "1"
    can_have = layouts.lacking().get(space.id)
    return f"{space.copies}, at least {space.copies_min}" + ("" if can_have is None else f" (shadows for {can_have})")


def lacking_text(scene: str, lacking: Mapping[SpaceId, int]) -> str:
    """What there is to do about spaces that shall have more copies than they have shadows for; nothing if there is none."""
    if not lacking:
        return ""
    spaces = ", ".join(f"space {space} (can have {can_have})" for space, can_have in sorted(lacking.items()))
    return f"\nMore copies are asked for than there are shadows: {spaces}. `scenectl space copies SPACE NUMBER --scene {scene}` makes them."
