"""`scenectl cluster voters`, `add-voter`, `remove-voter`: which nodes decide the cluster's log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import AddressOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scenefold.base.ids import NodeId

    Council = tuple[Sequence[NodeId], Sequence[NodeId]]
    """Who decides, and which of them prepare for it yet."""


def voters(*, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List the nodes that decide who is a member, who is trusted, and who has a lease, and how many of them may be lost.

    Example: scenectl cluster voters --profile studio
    """
    from scenectl.running import connected, run

    async def work() -> Council:
        async with connected(output.profile) as cluster:
            return await cluster.voters.known(), await cluster.voters.preparing(within_s=0.0)

    _tell(output, *run(work))


def add_voter(address: AddressOption, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Have a trusted node decide the cluster's log, too; seven may. With three one may be lost, with five two; two must both be there.

    The cluster begins with one, which must never be lost until there are three. Add the others soon after the second one.

    Example: scenectl cluster add-voter 192.168.1.12 --profile studio

    Parameters
    ----------
    address
        IPv4 address of the node: it runs, and is trusted (`cluster trust`).
    """
    _changed(address.text, output, is_added=True)


def remove_voter(address: AddressOption, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Have a node decide the cluster's log no more; it stays a member. More than half of the voters, with it, must be there for that; the last one stays.

    Example: scenectl cluster remove-voter 192.168.1.12 --profile studio

    Parameters
    ----------
    address
        IPv4 address of the node.
    """
    _changed(address.text, output, is_added=False)


def _changed(address: str, output: ProfileOutput, *, is_added: bool) -> None:
    from scenectl.running import connected, run
    from scenefold.base.ids import node_id_of

    async def work() -> tuple[bool, Council]:
        async with connected(output.profile) as cluster:
            change = cluster.voters.add if is_added else cluster.voters.remove
            is_new = await change(node_id_of(address))
            return is_new, (await cluster.voters.known(), await cluster.voters.preparing())

    is_new, council = run(work)
    words = "decides the cluster's log" if is_added else "does not decide the cluster's log"
    _tell(output, *council, f"Node {address} {words}{' from now on' if is_new else ' already' if is_added else ', and did not before'}.")


def _tell(output: ProfileOutput, known: Sequence[NodeId], preparing: Sequence[NodeId], first: str = "") -> None:
    from scenefold.base.ids import address_of

    addresses, spare = [address_of(node) for node in known], 0 if preparing else (len(known) - 1) // 2
    late = [address_of(node) for node in preparing]
    lines = [first] if first else []
    lines.append(f"Voters: {', '.join(addresses)}; {spare or 'none'} of them may be lost.")
    if len(addresses) % 2 == 0:
        lines.append(f"warning: {len(addresses)} stand no more losses than {len(addresses) - 1}: add one, or remove one.")
    if late:
        lines.append(f"warning: {', '.join(late)} must still hear what those before granted: lose no voter, and start those that are away.")
    emit(output, {"voters": addresses, "may_be_lost": spare, "preparing": late}, "\n".join(lines))
