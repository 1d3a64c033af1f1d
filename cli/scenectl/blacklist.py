"""`scenectl node blacklist`: which nodes must hold no copies of what a node owns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import AddressOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scenefold.base.prefixes import AddressPrefix, Blacklist
    from scenefold.client import ClusterStatus

app = App(name="blacklist", help="Say which nodes must hold no copies of what a node owns.", help_format="plaintext")

Names = Annotated[str, Parameter(negative="")]
DryRun = Annotated[bool, Parameter(negative="", show_default=False)]


@app.command
def add(*prefixes: Names, node: AddressOption, dry_run: DryRun = False, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Let other nodes hold no copies of what a node owns: those that would fail together with it.

    Copies that lie there move to others. For administrators.

    Example: scenectl node blacklist add 10.1.2.0/24 10.1.3.7 --node 10.1.2.14 --profile studio

    Parameters
    ----------
    prefixes
        IPv4 addresses of nodes, and prefixes such as 10.1.2.0/24, which cover every node whose address lies in them, also those that come later. What stands there already stays.
    node
        IPv4 address of the node whose blacklist it is. Its own address is on it always.
    dry_run
        Only say what would stand there, and which nodes may hold copies then.
    """
    _order(node.text, output, dry_run=dry_run, add=_read(prefixes))


@app.command(name="rm")
def remove(*prefixes: Names, node: AddressOption, dry_run: DryRun = False, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Let other nodes hold copies of what a node owns again. For administrators.

    What the node is started with (`node run --blacklist`) comes back when it is started so again.

    Example: scenectl node blacklist rm 10.1.2.0/24 --node 10.1.2.14 --profile studio

    Parameters
    ----------
    prefixes
        Entries of the blacklist, as `scenectl node blacklist list` shows them.
    node
        IPv4 address of the node whose blacklist it is.
    dry_run
        Only say what would stand there, and which nodes may hold copies then.
    """
    _order(node.text, output, dry_run=dry_run, remove=_read(prefixes))


@app.command(name="list")
def list_(node: AddressOption | None = None, *, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Show which nodes must hold no copies of what a node owns, by its own word; by default of every node.

    Exit code 5 if one of all does not answer: of that it is shown what another node knows.

    Example: scenectl node blacklist list 10.1.2.14 --profile studio

    Parameters
    ----------
    node
        IPv4 address of the node.
    """
    if node is None:
        return _show_all(output)
    found, _ = _ask(node.text, output)
    _show(node.text, found, output)
    return DONE


def _show_all(output: ProfileOutput) -> int:
    from scenectl.running import connected, run

    async def look() -> ClusterStatus:
        async with connected(output.profile) as cluster:
            return await cluster.status()

    status = run(look)
    nodes = [
        {"address": node.address, "answers": node.alive, "version": node.blacklist_version, "blacklist": list(node.blacklist)}
        for node in status.nodes
    ]
    lines = [
        f"Node {node.address}: {_words(node.blacklist)}{'' if node.alive else f', as {status.asked} knows it; it does not answer'}."
        for node in status.nodes
    ]
    emit(output, {"nodes": nodes}, "\n".join(lines))
    return DONE if all(node.alive for node in status.nodes) else DEGRADED


def _order(
    address: str, output: ProfileOutput, *, dry_run: bool, add: Sequence[AddressPrefix] = (), remove: Sequence[AddressPrefix] = ()
) -> None:
    """Have the node change its blacklist, or only say what that would come to."""
    from scenefold.base.errors import Refused, UsageFault
    from scenefold.base.ids import node_id_of
    from scenefold.base.limits import BLACKLIST_MAX

    if max(len(add), len(remove)) > BLACKLIST_MAX:
        what = f"{max(len(add), len(remove))} entries, where a blacklist has {BLACKLIST_MAX} at most"
        raise UsageFault(what, where="scenectl node blacklist", remedy="name a prefix in place of many addresses")
    if not dry_run:
        found, others = _ask(address, output, add=add, remove=remove)
        _show_changed(address, found, others, output)
        return
    from scenefold.peer.membership.blacklist import ordered

    found, others = _ask(address, output)
    try:
        planned = ordered(found, add, remove, node_id_of(address))
    except Refused as refusal:
        raise Refused(refusal.reason, refusal.what, where=address, remedy=refusal.remedy) from None
    _show_plan(address, planned, others, output)


def _read(prefixes: Sequence[str]) -> list[AddressPrefix]:
    """What was given, each once."""
    from scenefold.base.errors import UsageFault
    from scenefold.base.prefixes import address_prefix

    if not prefixes:
        raise UsageFault("nothing to change", where="scenectl node blacklist", remedy="give addresses, or prefixes such as 10.1.2.0/24")
    try:
        return list(dict.fromkeys(map(address_prefix, prefixes)))
    except ValueError as problem:
        remedy = "give addresses such as 10.1.2.3, or prefixes such as 10.1.2.0/24"
        raise UsageFault(str(problem), where="scenectl node blacklist", remedy=remedy) from None


def _ask(
    address: str, output: ProfileOutput, *, add: Sequence[AddressPrefix] = (), remove: Sequence[AddressPrefix] = ()
) -> tuple[Blacklist, list[str]]:
    """What the node says, and which others there are."""
    from scenectl.draining import check_known
    from scenectl.running import connected, run

    async def work() -> tuple[Blacklist, list[str]]:
        async with connected(output.profile) as cluster:
            await check_known(cluster, address)
            found = await cluster.blacklist(address, add=add, remove=remove)
            return found, [owner.address for owner in await cluster.nodes() if owner.address != address]

    return run(work)


def _show(address: str, found: Blacklist, output: ProfileOutput) -> None:
    listed = list(map(str, found.prefixes))
    emit(output, {"address": address, "version": found.version, "blacklist": listed}, f"Node {address}: {_words(listed)}.")


def _words(listed: Sequence[str]) -> str:
    return f"no copies of its data on {', '.join(listed)}" if listed else "every other node may hold copies of its data"


def _show_changed(address: str, found: Blacklist, others: Sequence[str], output: ProfileOutput) -> None:
    """What stands there now, and what comes of it. `others`: all nodes but the one whose it is."""
    forbidden, allowed = _sorted(address, found, others)
    listed = list(map(str, found.prefixes))
    document = {"address": address, "version": found.version, "blacklist": listed, "forbidden": forbidden, "allowed": allowed}
    lines = [f"Node {address}: {_words(listed)}."]
    if forbidden:
        lines.append(
            f"{_so_many(allowed, 'There can')}: where a space needs more before a write counts, writes to what it owns are refused; "
            "where one has more, copies that nobody else may hold are missing. `scenectl cluster health` tells which."
        )
    if forbidden and not allowed:
        lines.append("In half a minute what it owns begins to move to a neighbour, unless something is taken off again.")
    emit(output, document, "\n".join(lines))


def _show_plan(address: str, planned: Blacklist, others: Sequence[str], output: ProfileOutput) -> None:
    """`planned`: the blacklist as it would be; `others`: all nodes but the one whose it is."""
    forbidden, allowed = _sorted(address, planned, others)
    listed = list(map(str, planned.prefixes))
    document = {"address": address, "dry_run": True, "blacklist": listed, "forbidden": forbidden, "allowed": allowed}
    lines = [
        f"Node {address} would have on its blacklist: {', '.join(listed) or 'nothing'}.",
        f"Copies of its data could lie on {', '.join(allowed) or 'no other node'}"
        + (f", and not on {', '.join(forbidden)}." if forbidden else "."),
        f"{_so_many(allowed, 'So there could')}: where a space needs more before a write counts, writes to what it owns would be refused.",
    ]
    if forbidden and not allowed:
        lines.append("Half a minute later what it owns would begin to move to a neighbour.")
    emit(output, document, "\n".join(lines))


def _sorted(address: str, blacklist: Blacklist, others: Sequence[str]) -> tuple[list[str], list[str]]:
    """Of the others: who may hold no copies of what the node owns, and who may."""
    from scenefold.base.ids import node_id_of
    from scenefold.base.prefixes import forbids

    owner = node_id_of(address)
    forbidden = [other for other in others if forbids(blacklist.prefixes, node_id_of(other), owner=owner)]
    return forbidden, [other for other in others if other not in forbidden]


def _so_many(allowed: Sequence[str], there: str) -> str:
    number = len(allowed) + 1
    return f"{there} be {number} {'copies' if number > 1 else 'copy'} of each record at most, its own among them"
