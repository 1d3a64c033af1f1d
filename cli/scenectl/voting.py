"""`scenectl cluster voters`, `add-voter`, `remove-voter`: which nodes decide the cluster's log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import AddressOption
from scenefold.base.ids import address_of, node_id_of

if TYPE_CHECKING:
    from scenefold.client.voters import Council


def voters(*, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List the nodes that decide who is a member, who is trusted, and who has a lease, which of them do not answer, and how many more may be lost.

    Example: scenectl cluster voters --profile studio
    """
    from scenectl.running import connected, run

    async def work() -> Council:
        async with connected(output.profile) as cluster:
            return await cluster.voters.council(within_s=0.0)

    _tell(output, run(work))


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

    async def work() -> tuple[bool, Council]:
        async with connected(output.profile) as cluster:
            change = cluster.voters.add if is_added else cluster.voters.remove
            is_new = await change(node_id_of(address))
            return is_new, await cluster.voters.council()

    is_new, council = run(work)
    words = "decides the cluster's log" if is_added else "does not decide the cluster's log"
    _tell(output, council, f"Node {address} {words}{' from now on' if is_new else ' already' if is_added else ', and did not before'}.")


def _tell(output: ProfileOutput, found: Council, first: str = "") -> None:
    voters, preparing, silent = found.voters, found.preparing, found.silent
    document = {
        "voters": [address_of(node) for node in voters],
        "may_be_lost": found.may_be_lost,
        "preparing": [address_of(node) for node in preparing],
        "silent": [address_of(node) for node in silent],
    }
    lines = [first] if first else []
    lines.append(council_text(found))
    if len(voters) % 2 == 0:
        lines.append(f"warning: {len(voters)} stand no more losses than {len(voters) - 1}: add one, or remove one.")
    if preparing:
        late = ", ".join(map(address_of, preparing))
        lines.append(f"warning: {late} must still hear what those before granted: lose no voter, and start those that are away.")
    emit(output, document, "\n".join(lines))


def council_text(found: Council) -> str:
    """Who decides, and how many of them may be lost, beside those that do not answer."""
    text = f"Voters: {', '.join(map(address_of, found.voters))}"
    if not found.silent:
        return f"{text}; {found.may_be_lost or 'none'} of them may be lost."
    silent = f"{', '.join(map(address_of, found.silent))} {'does' if len(found.silent) == 1 else 'do'} not answer"
    if not found.has_majority:
        return f"{text}; {silent}: too few are left to decide anything. Start those."
    return f"{text}; {silent}, and {found.may_be_lost or 'none'} of the others may be lost."
