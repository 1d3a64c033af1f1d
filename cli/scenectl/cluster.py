"""`scenectl cluster`: make a cluster, join it, and look at it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from scenectl.enrolling import invitations, invite, joined_by_token, renew, revoke, users
from scenectl.errors import DEGRADED, DONE, Interrupted
from scenectl.health import health
from scenectl.member_values import TokenOption, given_token
from scenectl.names import ClusterName
from scenectl.output import DEFAULT_PROFILE, PLAIN, Output, ProfileOutput, emit
from scenectl.trusting import trust
from scenectl.values import DEFAULT_SUITE, AddressesOption, AddressOption, PortsOption, SuiteOption, cluster_ports, real, whole
from scenectl.voting import add_voter, remove_voter, voters

if TYPE_CHECKING:
    from scenefold.client import ClusterStatus, RemovedNode

app = App(name="cluster", help="Make a cluster, join it, and look at it.", help_format="plaintext")
for verb in (health, invite, invitations, users, trust, revoke, renew, voters, add_voter, remove_voter):
    app.command(verb)


@app.command
def init(
    folder: Annotated[Path, Parameter(env_var="SCENEFOLD_PROFILE")],
    /,
    *,
    nodes: AddressesOption,
    spares: AddressesOption | None = None,
    name: ClusterName | None = None,
    ports: PortsOption | None = None,
    suite: SuiteOption = DEFAULT_SUITE,
    trust_all: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: Output = PLAIN,
) -> None:
    """Make the authority and the keys of a new cluster.

    Every node needs its own part of the folder (`nodes/ADDRESS/` and `cluster.toml`); users need the whole.

    Example: scenectl cluster init studio --nodes 127.0.0.2,127.0.0.3,127.0.0.4

    Parameters
    ----------
    folder
        Folder to make; it is the cluster's profile. It must not exist, or be empty.
    nodes
        IPv4 addresses of the nodes, separated by commas. The lowest of them decides who is a member: never lose its disk before others do, too (`cluster add-voter`).
    spares
        IPv4 addresses of nodes that may join later; they get keys now.
    name
        Name of the cluster; by default that of the folder.
    ports
        Ports for low and high priority, LOW,HIGH; by default 17349,17350.
    suite
        Algorithms of the keys of the user who makes the cluster; nodes' keys are always of the first.
    trust_all
        Trust all these nodes, spares too, so that they render: for machines that are all your own. Else only the first is trusted, the others store what they cannot read, and `cluster trust` changes that later.
    """
    from scenefold.base.errors import UsageFault
    from scenefold.base.ids import address_of
    from scenefold.base.names import is_name, name_rule
    from scenefold.client import create_cluster
    from scenefold.crypto import suite_named

    more, number = () if spares is None else spares.all, suite_named(suite).number
    title = folder.resolve().name if name is None else name
    if not is_name(title):
        remedy = f"give it one with --name: {name_rule()}"
        raise UsageFault(f"{title!r} cannot be the name of a cluster", where=f"folder {folder}", remedy=remedy)
    profile = create_cluster(folder, title, nodes.all, spares=more, ports=cluster_ports(ports), suite=number, trust_all=trust_all)
    trusted = [address_of(node) for node in (*profile.voters, *profile.trusted)]
    document = {"profile": str(profile.folder), "name": profile.name, "nodes": list(nodes.all), "spares": list(more), "trusted": trusted}
    first = nodes.all[0]
    text = (
        f"Cluster {profile.name} with {len(nodes.all)} node{'s' if len(nodes.all) > 1 else ''} is in {profile.folder}.\n"
        f"Start each node, for example: scenectl node run --address {first} --profile {profile.folder}"
    )
    if len(trusted) < len(nodes.all) + len(more):
        text += f"\nOnly {trusted[0]} renders, the others store what they cannot read: `scenectl cluster trust` changes that."
    emit(output, document, text)


@app.command
def join(
    token: Annotated[TokenOption, Parameter(allow_leading_hyphen=True)],
    /,
    *,
    address: Annotated[AddressOption | None, Parameter(env_var="SCENEFOLD_ADDRESS")] = None,
    data: Annotated[Path | None, Parameter(env_var="SCENEFOLD_DATA")] = None,
    place: Annotated[str, Parameter(env_var="SCENEFOLD_JOIN_AT")] = "loaded",
    capacity: Annotated[int, whole(0, 2**63 - 1, env_var="SCENEFOLD_CAPACITY")] = 0,
    seed_wait: Annotated[float, real(gt=0, lte=86_400, env_var="SCENEFOLD_SEED_WAIT")] = 30.0,
    threads: Annotated[int | None, whole(1, 1024, env_var="SCENEFOLD_THREADS")] = None,
    suite: SuiteOption = DEFAULT_SUITE,
    log_level: Literal["debug", "info", "warning", "error"] = "info",
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Join a cluster by the token of an invitation (`cluster invite`), as the node or the user that it is for.

    The profile is made, with new keys; a user is done then. A node runs, says how it gets its part, and goes on until it is told to stop; later starts use `node run`, which knows more options. A node whose keys `cluster init --spares` made joins by the address of one that runs.

    Example: scenectl cluster join 4myt6q2a-... --profile studio

    Parameters
    ----------
    token
        The token, or - to read it from standard input; or the IPv4 address of a node of the cluster that runs.
    address
        The joining node's own IPv4 address; by default the one by which this computer reaches the cluster, or, without a token, that of the one spare whose keys are in the profile.
    data
        Folder for what the node stores; by default one in the user's data folder.
    place
        Where it stands on the line: "loaded", beside the fullest node, of which it gets half, 64 MiB at first; "random"; or a location in hexadecimal, 8 for the middle of the line.
    capacity
        Bytes that the node may store; 0: what its disk holds.
    seed_wait
        Seconds until it is an error that the seed does not answer.
    threads
        Threads that may render; by default as many as there are processors.
    suite
        Algorithms of the keys of a user who joins; nodes' keys are always of the first.
    log_level
        Least important lines that are logged.
    """
    import sys
    from dataclasses import replace

    from scenectl.joining import Telling
    from scenectl.node import run_until_stopped
    from scenefold.base.errors import UsageFault
    from scenefold.client import profile_folder
    from scenefold.node import NodeSettings, default_extensions
    from scenefold.node.logs import set_up_logs
    from scenefold.peer.settings import place_of
    from scenefold.world.profile import ClusterProfile

    seeds: tuple[str, ...] = ()
    join_place = place_of(place)  # before a token is used
    token = given_token(token, sys.stdin)
    if token.is_address:
        folder, seeds = profile_folder(output.profile), (token.text,)
        own: str | None = ClusterProfile.load(folder).spare_here(besides=token.text) if address is None else address.text
        if token.text == own:
            raise UsageFault("a node cannot join through itself", where=token.text, remedy="name a node that is a member already")
    else:
        folder, own = joined_by_token(token.text, None if address is None else address.text, suite, output)
    if own is None:
        return
    set_up_logs("json" if output.json else "console", log_level)
    settings = replace(
        NodeSettings.for_member(folder, own, data=data, threads=threads),
        seeds=seeds,
        seed_wait_s=seed_wait,
        capacity_bytes=capacity,
        join_place=join_place,
    )
    telling = Telling(output)
    run_until_stopped(settings, output, extensions=[*default_extensions(), telling], told_ready=telling.may_begin)


@app.command
def status(*, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Show who is there, what they own and hold, and warn of anything off. Exit code 5 if something cannot be served.

    Example: scenectl cluster status --profile studio
    """
    from scenectl.cluster_text import status_text

    found = _look(output.profile)
    emit(output, found.document(), status_text(found))
    return DEGRADED if found.degraded else DONE


@app.command
def nodes(*, removed: Annotated[bool, Parameter(negative="", show_default=False)] = False, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """List the nodes along the line: role, arc, fill, records, last heard, incarnation.

    Example: scenectl cluster nodes --profile studio

    Parameters
    ----------
    removed
        Instead: who was ever taken off the line, why, and which node proposed it, the newest first.
    """
    from scenectl.cluster_text import nodes_text, removed_text

    if removed:
        name, gone = _removed(output.profile)
        emit(output, {"name": name, "removed": [one.document() for one in gone]}, removed_text(gone))
        return
    found = _look(output.profile)
    emit(output, {"name": found.name, "asked": found.asked, "nodes": [node.document() for node in found.nodes]}, nodes_text(found))


@app.command
def top(*, once: Annotated[bool, Parameter(negative="", show_default=False)] = False, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show every second what the nodes hold, gain and trace, and what is on its way between them, until Ctrl-C.

    Example: scenectl cluster top --profile studio

    Parameters
    ----------
    once
        Compare two looks a second apart, and end.
    """
    from scenectl.running import connected, run
    from scenectl.top import watch

    async def work() -> None:
        async with connected(output.profile) as cluster:
            await watch(cluster, output, once=once)

    # Ctrl-C is how this is meant to end.
    with suppress(Interrupted):
        run(work)


def _look(profile: str | None) -> ClusterStatus:
    from scenectl.running import connected, run

    async def ask() -> ClusterStatus:
        async with connected(profile) as cluster:
            return await cluster.status()

    return run(ask)


def _removed(profile: str | None) -> tuple[str, tuple[RemovedNode, ...]]:
    from scenectl.running import connected, run

    async def ask() -> tuple[str, tuple[RemovedNode, ...]]:
        async with connected(profile) as cluster:
            return cluster.name, await cluster.removed()

    return run(ask)
