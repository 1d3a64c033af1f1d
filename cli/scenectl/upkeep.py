"""`scenectl node upkeep`: repair, scrub and balance are paused, go on, and are slowed down, at one node or at all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, size_text, table
from scenectl.values import AddressOption, whole

if TYPE_CHECKING:
    from scenefold.client import Upkeep
    from scenefold.client.upkeep import UpkeepChanges

app = App(name="upkeep", help="Pause what nodes do by themselves with records, or bound its speed.", help_format="plaintext")

Repair = Annotated[bool, Parameter(negative="", show_default=False, help="Comparing copies with others, and bringing what these lack.")]
Scrub = Annotated[bool, Parameter(negative="", show_default=False, help="Reading all records again.")]
Balance = Annotated[bool, Parameter(negative="", show_default=False, help="Giving records to neighbours that have more room.")]
Nodes = Annotated[AddressOption, Parameter(negative="", help="IPv4 addresses of nodes; by default all.")]
Rate = Annotated[int, whole(0, 2**63 - 1)]


@app.command
def show(*nodes: Nodes, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Show what is paused, and how fast nodes may move and read. Exit code 5 if a node does not answer.

    Example: scenectl node upkeep show --profile studio
    """
    return _tell(nodes, {}, output)


@app.command
def pause(
    *nodes: Nodes, repair: Repair = False, scrub: Scrub = False, balance: Balance = False, output: ProfileOutput = DEFAULT_PROFILE
) -> int:
    """Let nodes rest, also over restarts, until they are told to go on; by default from all of it. For administrators.

    What lies on fewer nodes than a write needs is repaired all the same, as is what has rotted; newcomers get their part, and who leaves hands over everything. `cluster health` names what is paused. Exit code 5 if a node does not answer.

    Example: scenectl node upkeep pause 192.168.1.14 --repair --profile studio
    """
    return _tell(nodes, {"pause": _duties(repair=repair, scrub=scrub, balance=balance)}, output)


@app.command
def resume(
    *nodes: Nodes, repair: Repair = False, scrub: Scrub = False, balance: Balance = False, output: ProfileOutput = DEFAULT_PROFILE
) -> int:
    """Let nodes go on with what was paused; by default with all of it. For administrators.

    Example: scenectl node upkeep resume --profile studio
    """
    return _tell(nodes, {"resume": _duties(repair=repair, scrub=scrub, balance=balance)}, output)


@app.command
def rate(*nodes: Nodes, transfer: Rate | None = None, scrub: Rate | None = None, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Bound how fast nodes move and read, from now on and over restarts; 0: what they were started with. For administrators.

    Example: scenectl node upkeep rate 192.168.1.14 --transfer 20000000 --profile studio

    Parameters
    ----------
    transfer
        Bytes a second that a node may use to move data: repair, draining, and evening out its load.
    scrub
        Bytes a second that it may read to look for what has rotted; a round then takes as long as it takes.
    """
    from scenefold.base.errors import UsageFault

    if transfer is None and scrub is None:
        raise UsageFault("nothing to change", where="scenectl node upkeep rate", remedy="give --transfer or --scrub")
    return _tell(nodes, {"transfer_bytes_per_s": transfer, "scrub_bytes_per_s": scrub}, output)


def _duties(**named: bool) -> tuple[str, ...]:
    return tuple(name for name, is_meant in named.items() if is_meant or not any(named.values()))


def _tell(nodes: tuple[AddressOption, ...], changes: UpkeepChanges, output: ProfileOutput) -> int:
    """Tell these nodes, or all, one after the other; one that is silent keeps nobody from being told."""
    from scenectl.draining import check_known
    from scenectl.running import connected, run
    from scenefold.base.errors import Unreachable

    async def work() -> dict[str, Upkeep | None]:
        found: dict[str, Upkeep | None] = {}
        async with connected(output.profile) as cluster:
            for node in nodes:
                await check_known(cluster, node.text)
            for address in [node.text for node in nodes] or [owner.address for owner in await cluster.nodes()]:
                try:
                    found[address] = await cluster.upkeep(address, **changes)
                except Unreachable:
                    found[address] = None
        return found

    told = run(work)
    listed: list[dict[str, Any]] = [
        {"address": address, "answers": upkeep is not None, **({} if upkeep is None else upkeep.document())}
        for address, upkeep in told.items()
    ]
    emit(output, {"nodes": listed}, table(("node", "paused", "moves at most", "scrubs at most"), [_row(*one) for one in told.items()]))
    return DEGRADED if None in told.values() else DONE


def _row(address: str, upkeep: Upkeep | None) -> tuple[str, ...]:
    if upkeep is None:
        return address, "does not answer", "?", "?"
    rates = [f"{size_text(rate)}/s" for rate in (upkeep.transfer_bytes_per_s, upkeep.scrub_bytes_per_s)]
    return address, ", ".join(upkeep.paused) or "-", *rates
