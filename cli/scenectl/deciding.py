"""`scenectl scene participants`, `add-participant`, `remove-participant`: which nodes decide what a scene's log says next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Self

from cyclopts import Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, and_text, emit, note, table
from scenectl.repeating import RequestOption, decided_text, one_change, position_of
from scenectl.values import ONE_WORD, Addresses, AddressOption, is_digits
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.limits import DECIDERS_MAX
from scenefold.client.requests import Change

FEW_CHANGES = 20
"""Below so many it is said how many are left: to replace one node takes two of them."""

if TYPE_CHECKING:
    from scenefold.client import Deciders
    from scenefold.client.relieving import Relieved


@dataclass(frozen=True)
class Participants:
    """How many nodes decide a scene, or which: 3; 127.0.0.2,127.0.0.3,127.0.0.4; origin for the cluster's first voter alone."""

    wanted: int | tuple[NodeId, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        if text.strip().lower() == "origin":
            return cls(0)
        if is_digits(text):
            if int(text) > DECIDERS_MAX:
                raise ValueError(f"a scene has 0 to {DECIDERS_MAX} participants, not {text}")
            return cls(int(text))
        return cls(tuple(map(node_id_of, Addresses.parse(text).all)))

    @property
    def count(self) -> int:
        return self.wanted if isinstance(self.wanted, int) else len(self.wanted)

    def __str__(self) -> str:
        return str(self.wanted) if isinstance(self.wanted, int) else ",".join(map(address_of, self.wanted))


ParticipantsOption = Annotated[Participants, ONE_WORD]


def participants(scene: SceneName, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show which nodes decide what the scene's log says next, and how many of them must agree.

    Example: scenectl scene participants kitchen --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    """
    from scenectl.running import connected, run

    async def ask() -> Deciders:
        async with connected(output.profile) as cluster:
            return await cluster.membership.judged(await (await cluster.scenes.open(scene)).deciders())

    emit_deciders(output, scene, run(ask), Change())


def add_participant(
    scene: SceneName, /, *address: AddressOption, request: RequestOption = None, output: ProfileOutput = DEFAULT_PROFILE
) -> None:
    """Let another trusted node decide, too; only owners of the scene can. Where the cluster's first voter decides alone, name all that shall.

    Example: scenectl scene add-participant kitchen 192.168.1.14 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    address
        IPv4 address of the node; of several, in place of the cluster's first voter, which decides on only if it is one of them.
    """
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault

    if not address:
        raise UsageFault("which node shall decide is not said", where="scenectl scene add-participant", remedy="give its address")
    nodes, change = [node_id_of(one.text) for one in address], Change(request)

    async def do() -> Deciders:
        async with connected(output.profile) as cluster:
            entries = await cluster.membership.participants(nodes)
            return await (await cluster.scenes.open(scene)).add_participants(entries, again=change)

    with one_change("scene add-participant", scene, change):
        found = run(do)
    _emit_changed(output, scene, found, change)


def remove_participant(
    scene: SceneName, address: AddressOption, /, *, request: RequestOption = None, output: ProfileOutput = DEFAULT_PROFILE
) -> None:
    """Let a node decide no more, such as one that is gone for good; only owners can. It takes a majority, the node itself counted.

    Example: scenectl scene remove-participant kitchen 192.168.1.14 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    address
        IPv4 address of the node.
    """
    from scenectl.running import connected, run

    change = Change(request)

    async def do() -> Deciders:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).remove_participant(node_id_of(address.text), again=change)

    with one_change("scene remove-participant", scene, change):
        found = run(do)
    _emit_changed(output, scene, found, change)


def relieve(
    address: AddressOption,
    /,
    *,
    by: AddressOption | None = None,
    dry_run: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Have other trusted nodes decide in a node's place, in all scenes that you own: before it leaves, or when it is gone for good. What it only observes it observes no more.

    Exit code 5 if it decides some scene on.

    Example: scenectl scene relieve 192.168.1.14 --profile studio

    Parameters
    ----------
    address
        IPv4 address of the node that shall decide no more.
    by
        The node that shall decide in its place; by default one that is trusted and does not decide the scene yet. If there is none, fewer decide.
    dry_run
        Say what would be done, and change nothing.
    """
    from scenectl.running import connected, run

    async def do() -> list[Relieved]:
        from scenefold.client.relieving import relieve as work

        async with connected(output.profile) as cluster:
            heir = None if by is None else node_id_of(by.text)
            return await work(cluster, node_id_of(address.text), heir, dry_run=dry_run)

    found = run(do)
    rows = [(one.name or "-", f"{one.scene:08x}", "" if one.by is None else address_of(one.by), one.problem) for one in found]
    text = table(("name", "id", "in its place", "problem"), rows) if rows else f"Node {address} decides and observes no scene."
    emit(output, {"address": address.text, "dry_run": dry_run, "scenes": [one.document() for one in found]}, text)
    return DEGRADED if any(one.problem for one in found) else DONE


def deciders_text(found: Deciders) -> str:
    """A sentence, and another one for observers."""
    nodes = addresses_text(found.nodes)
    if not found.participants:
        text = f"{nodes} decides alone, as the node where scenes of this cluster begin."
    elif len(found.nodes) == 1:
        text = f"{nodes} decides alone."
    else:
        text = f"{nodes} decide; {found.majority} of the {len(found.nodes)} must agree."
    if found.lost:
        text += lost_text(found.lost, found)
    text += f"\nObservers: {addresses_text(found.observers)}." if found.observers else ""
    return text + (changes_text(found.changes_left) if found.changes_left < FEW_CHANGES else "")


def changes_text(left: int) -> str:
    """How often they can still change, and what helps when they cannot."""
    from scenefold.client.offers import times_text

    helps = "`scenectl scene export` and `scenectl scene import-archive` make a new scene of it, in which they can"
    return f"\nWho decides can change {times_text(left)} in this scene's life; each node that is added or removed is one change. {helps}."


def lost_text(lost: Sequence[NodeId], found: Deciders) -> str:
    """Who of them votes no more, how many may be away besides, and what to do."""
    left = len(found.nodes) - found.majority - len(lost)
    may = (
        "too few are left to change anything" if left < 0 else "none of the others may be away" if left == 0 else f"{left} more may be away"
    )
    who, it = addresses_text(lost), "has lost its disk, and votes" if len(lost) == 1 else "have lost their disks, and vote"
    relieve = f"`scenectl scene relieve {address_of(lost[0])}` has another node decide in its place, in all scenes that you own"
    return f"\n{who} {it} no more: {may}. {relieve}; or remove-participant, and then add-participant."


def addresses_text(nodes: Sequence[NodeId]) -> str:
    return and_text([address_of(node) for node in nodes])


def even_warning(count: int) -> str:
    """What is to be said of a number of nodes that decide; empty if it is a good one."""
    if count == 0 or count % 2:
        return ""
    both = "both" if count == 2 else f"{count // 2 + 1} of the {count}"
    lost = "none may be away" if count == 2 else f"no more may be away than of {count - 1}"
    return f"{count} nodes decide: {both} must agree, so {lost}. An odd number is better."


def emit_deciders(output: ProfileOutput, scene: str, found: Deciders, change: Change) -> None:
    """Who decides and observes now."""
    emit(output, {"scene": scene, **found.document(), **position_of(change)}, deciders_text(found) + decided_text(change))


def _emit_changed(output: ProfileOutput, scene: str, found: Deciders, change: Change) -> None:
    if warning := even_warning(len(found.participants)):
        note(f"warning: {warning}")
    emit_deciders(output, scene, found, change)
