"""Which nodes may decide a scene's log: those that the cluster trusts, as its log says (specs/16-scene-log.md, Participants). Pure.

Who decides needs no key of the scene, and can still hold it up, or let its owners' changes be forgotten; a node that is asked to store and no
more is none of them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TypeAlias

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import DECIDERS_MAX
from scenefold.wire import Member, ParticipantEntry
from scenefold.world.log_view import LogView

Wanted: TypeAlias = int | Sequence[NodeId | ParticipantEntry]
"""How many, or which; 0 is none, so that the scene's origin decides alone."""
MOST_BY_DEFAULT = 7
FEWEST_BY_DEFAULT = 3
"""With fewer nothing is gained: two must both be there."""


def participants_of(view: LogView, wanted: Wanted | None, origin: NodeId, silent: Collection[NodeId] = ()) -> tuple[ParticipantEntry, ...]:
    """Who shall decide. `wanted` None: as many as there are, an odd number; none if they are fewer than FEWEST_BY_DEFAULT.

    `silent`: who is known not to answer, and is taken last where a number is wanted.

    LocalFault if a node is not trusted, or too few are; UsageFault for what no scene can have.
    """
    if wanted is None:
        most = min(MOST_BY_DEFAULT, len(able(view)))
        wanted = most - 1 + most % 2 if most >= FEWEST_BY_DEFAULT else 0
    if isinstance(wanted, int):
        return _first(view, wanted, origin, silent)
    if len(wanted) > DECIDERS_MAX:
        raise UsageFault(f"a scene has at most {DECIDERS_MAX} participants, not {len(wanted)}", where="participants")
    entries = [one if isinstance(one, ParticipantEntry) else entry_of(view, one) for one in wanted]
    twice = sorted(
        {address_of(entry.member.node) for entry in entries if [one.member.node for one in entries].count(entry.member.node) > 1}
    )
    if twice:
        raise UsageFault(f"{', '.join(twice)} is named twice", where="participants")
    return tuple(entries)


def entry_of(view: LogView, node: NodeId) -> ParticipantEntry:
    """A node as a participant: in the life that it leads now. LocalFault if it cannot be one."""
    address, keys, member = address_of(node), view.keys_of(node), view.on_line(node)
    if keys is None or member is None:
        raise LocalFault("no node of this cluster has this address", where=address, remedy="see `scenectl cluster nodes`")
    if node not in view.roll.trusted:
        what = "the node is not trusted: it stores, and decides nothing"
        raise LocalFault(what, where=address, remedy=f"`scenectl cluster trust {address}` trusts it")
    if node not in view.registered:
        raise LocalFault("the node was never started, so it can decide nothing yet", where=address, remedy="start it first")
    return ParticipantEntry(Member(node, view.registered[node]), keys.signing)


def _first(view: LogView, count: int, origin: NodeId, silent: Collection[NodeId]) -> tuple[ParticipantEntry, ...]:
    """So many of those who are there, and then of the others: the origin first, which keeps the scene until then, and then in the order of the line."""
    if not 0 <= count <= DECIDERS_MAX:
        raise UsageFault(f"a scene has 0 to {DECIDERS_MAX} participants, not {count}", where="participants")
    nodes = sorted(able(view), key=lambda node: (node in silent, node != origin))
    if count > len(nodes):
        others = [node for node in view.members if node not in view.roll.trusted]
        what = f"{count} participants are asked for, and the cluster trusts {_nodes(len(nodes))} that could be"
        where = f"not trusted: {', '.join(map(address_of, others))}" if others else "all nodes that have joined are trusted"
        remedy = _how_to_trust(others) if others else "start the others and wait until they have joined, add nodes, or ask for fewer"
        raise LocalFault(what, where=where, remedy=remedy)
    return tuple(entry_of(view, node) for node in nodes[:count])


def able(view: LogView) -> list[NodeId]:
    """Who may decide a scene, in the order of the line."""
    return [node for node in view.members if node in view.roll.trusted and view.keys_of(node) is not None]


def _how_to_trust(others: Iterable[NodeId]) -> str:
    trust = " or ".join(f"`scenectl cluster trust {address_of(node)}`" for node in list(others)[:1])
    return f"{trust} trusts one, `scenectl cluster trust --all` all; or ask for fewer" if trust else "add nodes, or ask for fewer"


def _nodes(count: int) -> str:
    return "1 node" if count == 1 else f"{count} nodes"
