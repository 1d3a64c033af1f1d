"""`scenectl cluster trust`: which nodes may render every scene, and have the authority's key."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import AddressOption

if TYPE_CHECKING:
    from scenefold.base.ids import NodeId


def trust(
    address: AddressOption | None = None,
    /,
    *,
    everybody: Annotated[bool, Parameter(name="--all", negative="", show_default=False)] = False,
    withdraw: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Trust a node: it may render every scene, enrol newcomers and renew certificates. Others only store, and read nothing.

    A node that shall render one scene and no other need not be trusted: `scene grant SCENE node:ADDRESS --role reader`.

    Example: scenectl cluster trust 192.168.1.12 --profile studio

    Example: scenectl cluster trust --all --profile studio

    Parameters
    ----------
    address
        IPv4 address of the node.
    everybody
        All nodes that are on the line now, by the cluster's log: of a cluster whose machines are all your own.
    withdraw
        Trust it no longer: it gets no keys of scenes any more. What it was given it may have kept: if its owner turned against you, make the cluster anew.
    """
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault
    from scenefold.base.ids import address_of, node_id_of

    if (address is None) is not everybody or (everybody and withdraw):
        remedy = "give the address of one node, or --all; trust is withdrawn from one at a time"
        raise UsageFault("whom to trust is not clear", where="scenectl cluster trust", remedy=remedy)

    async def work() -> tuple[list[NodeId], bool]:
        async with connected(output.profile) as cluster:
            if address is not None:
                node = node_id_of(address.text)
                await cluster.membership.trust(node, trusted=not withdraw)
                return [node], node in cluster.profile.voters
            return await cluster.membership.trust_all(), False

    nodes, is_voter = run(work)
    if address is None:
        added = [address_of(node) for node in nodes]
        emit(output, {"addresses": added, "trusted": True}, f"Trusted now: {', '.join(added) or 'nobody new, all were already'}.")
        return
    words = "is trusted no longer" if withdraw else "is trusted: it may render every scene, enrol others and renew certificates"
    warning = (
        "It decides the cluster's log and has read the authority's key: its owner could trust it again." if withdraw and is_voter else ""
    )
    # Participants cannot read what they decide, so trust is asked for when they are chosen, and not at each vote.
    todo = f"Scenes that it decides it goes on deciding, without reading them: scenectl scene relieve {address}" if withdraw else ""
    document = {"address": address.text, "trusted": not withdraw, "warning": warning}
    emit(output, document, "\n".join(filter(None, [f"Node {address} {words}.", warning, todo])))
