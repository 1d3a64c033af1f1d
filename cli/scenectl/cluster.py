"""`scenectl cluster`: make a cluster, and look at it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.output import DEFAULT_PROFILE, PLAIN, Output, ProfileOutput, emit, size_text, table
from scenectl.values import AddressesOption, PortsOption, cluster_ports

if TYPE_CHECKING:
    from scenefold.client import ClusterStatus

app = App(name="cluster", help="Make a cluster and look at it.", help_format="plaintext")


@app.command
def init(
    folder: Annotated[Path, Parameter(env_var="SCENEFOLD_PROFILE")],
    /,
    *,
    nodes: AddressesOption,
    spares: AddressesOption | None = None,
    name: str | None = None,
    ports: PortsOption | None = None,
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
        IPv4 addresses of the nodes, separated by commas. The lowest of them decides who is a member: never lose its disk.
    spares
        IPv4 addresses of nodes that may join later; they get keys now.
    name
        Name of the cluster; by default that of the folder.
    ports
        Ports for low and high priority, LOW,HIGH; by default 17349,17350.
    """
    from scenefold.client import create_cluster

    more = () if spares is None else spares.all
    profile = create_cluster(folder, name or folder.resolve().name, nodes.all, spares=more, ports=cluster_ports(ports))
    document = {"profile": str(profile.folder), "name": profile.name, "nodes": list(nodes.all), "spares": list(more)}
    first = nodes.all[0]
    text = (
        f"Cluster {profile.name} with {len(nodes.all)} nodes is in {profile.folder}.\n"
        f"Start each node, for example: scenectl node run --address {first} --profile {profile.folder}"
    )
    emit(output, document, text)


@app.command
def status(*, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Show who is there, what they own and hold. Exit code 5 if a node is missing.

    Example: scenectl cluster status --profile studio
    """
    from scenectl.running import run
    from scenefold.client import connect

    async def ask() -> ClusterStatus:
        async with connect(output.profile) as cluster:
            return await cluster.status()

    found = run(ask)
    emit(output, found.document(), _status_text(found))
    return DEGRADED if found.degraded else DONE


def _status_text(found: ClusterStatus) -> str:
    rows = [
        (
            node.address,
            "alive" if node.alive else "missing",
            f"{node.share:.1%}",
            size_text(node.disk_bytes_used) if node.alive else "?",
            f"{node.disk_fraction:.1%}" if node.alive else "?",
        )
        for node in found.nodes
    ]
    missing = sum(not node.alive for node in found.nodes)
    summary = f"{found.name}: {len(found.nodes) - missing} of {len(found.nodes)} nodes alive"
    return f"{summary}\n\n" + table(("node", "state", "line", "disk used", "of disk"), rows)
