"""`scenectl node blacklist`: which nodes must hold no copies of what a node owns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import AddressOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scenefold.base.prefixes import AddressPrefix, Blacklist

app = App(name="blacklist", help="Say which nodes must hold no copies of what a node owns.", help_format="plaintext")

Names = Annotated[str, Parameter(negative="")]


@app.command
def add(*prefixes: Names, node: AddressOption, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Let other nodes hold no copies of what a node owns: those that would fail together with it.

    Copies that lie there move to others. For administrators.

    Example: scenectl node blacklist add 10.1.2.0/24 10.1.3.7 --node 10.1.2.14 --profile studio

    Parameters
    ----------
    prefixes
        IPv4 addresses of nodes, and prefixes such as 10.1.2.0/24, which cover every node whose address lies in them, also those that come later. What stands there already stays.
    node
        IPv4 address of the node whose blacklist it is. Its own address is on it always.
    """
    _show(node.text, _change(node.text, output, add=_read(prefixes)), output)


@app.command(name="rm")
def remove(*prefixes: Names, node: AddressOption, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Let other nodes hold copies of what a node owns again. For administrators.

    What the node is started with (`node run --blacklist`) comes back when it is started so again.

    Example: scenectl node blacklist rm 10.1.2.0/24 --node 10.1.2.14 --profile studio

    Parameters
    ----------
    prefixes
        Entries of the blacklist, as `scenectl node blacklist list` shows them.
    node
        IPv4 address of the node whose blacklist it is.
    """
    _show(node.text, _change(node.text, output, remove=_read(prefixes)), output)


@app.command(name="list")
def list_(node: AddressOption, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show which nodes must hold no copies of what a node owns, by its own word.

    Example: scenectl node blacklist list 10.1.2.14 --profile studio

    Parameters
    ----------
    node
        IPv4 address of the node.
    """
    _show(node.text, _change(node.text, output), output)


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


def _change(address: str, output: ProfileOutput, *, add: Sequence[AddressPrefix] = (), remove: Sequence[AddressPrefix] = ()) -> Blacklist:
    from scenectl.draining import check_known
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault
    from scenefold.base.limits import BLACKLIST_MAX

    if max(len(add), len(remove)) > BLACKLIST_MAX:
        what = f"{max(len(add), len(remove))} entries, where a blacklist has {BLACKLIST_MAX} at most"
        raise UsageFault(what, where="scenectl node blacklist", remedy="name a prefix in place of many addresses")

    async def work() -> Blacklist:
        async with connected(output.profile) as cluster:
            await check_known(cluster, address)
            return await cluster.blacklist(address, add=add, remove=remove)

    return run(work)


def _show(address: str, found: Blacklist, output: ProfileOutput) -> None:
    listed = list(map(str, found.prefixes))
    words = f"no copies of its data on {', '.join(listed)}" if listed else "every other node may hold copies of its data"
    emit(output, {"address": address, "version": found.version, "blacklist": listed}, f"Node {address}: {words}.")
