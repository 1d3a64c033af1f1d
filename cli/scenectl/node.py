"""`scenectl node`: run one node of a cluster, or several on this machine for trying things."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number

from scenectl.output import DEFAULT_PROFILE, PLAIN, Output, ProfileOutput, emit
from scenectl.values import AddressOption

app = App(name="node", help="Run nodes.", help_format="plaintext")

Count = Annotated[int, Parameter(validator=Number(gte=1, lte=127))]


@app.command(name="run")
def run_(
    *,
    address: Annotated[AddressOption, Parameter(env_var="SCENEFOLD_ADDRESS")],
    data: Annotated[Path | None, Parameter(env_var="SCENEFOLD_DATA")] = None,
    threads: Annotated[int | None, Parameter(env_var="SCENEFOLD_THREADS", validator=Number(gte=1))] = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Run the node with this address until it is told to stop (Ctrl-C or SIGTERM).

    Example: scenectl node run --address 127.0.0.2 --profile studio --data /srv/scenefold

    Parameters
    ----------
    address
        The node's IPv4 address; it must be one of this machine and of the cluster.
    data
        Folder for what the node stores; by default one in the user's data folder.
    threads
        Threads that may render; by default as many as there are processors.
    """
    import trio

    from scenectl.running import run
    from scenefold.client import profile_folder
    from scenefold.node import NodeSettings, run_node

    folder = profile_folder(output.profile)
    settings = NodeSettings.for_member(folder, address.text, data=data, threads=threads)

    async def serve() -> None:
        async with trio.open_nursery() as nursery:
            await nursery.start(run_node, settings)
            document = {"event": "ready", "address": address.text, "data": str(settings.data_folder)}
            emit(output, document, f"node {address} is ready, its data is in {settings.data_folder}")
            _flush()

    run(serve)


@app.command
def local(
    count: Count,
    /,
    *,
    folder: Path | None = None,
    output: Output = PLAIN,
) -> None:
    """Run COUNT nodes on this machine, one process each, until Ctrl-C, for trying things.

    They take the addresses 127.0.0.2 and up. The profile to speak to them with is printed when all are ready.

    Example: scenectl node local 5 --folder trial

    Parameters
    ----------
    count
        Number of nodes, 1 to 127.
    folder
        Where their profile and data lie and stay; by default a temporary folder that is removed at the end.
    """
    import trio
    from scenefold.node.local import local_cluster

    from scenectl.running import run

    async def serve() -> None:
        async with local_cluster(count, folder=folder) as cluster:
            profile = str(cluster.profile)
            document = {"event": "ready", "profile": profile, "nodes": list(cluster.addresses)}
            emit(output, document, f"{count} nodes are ready; use --profile {profile}\nCtrl-C ends them.")
            _flush()
            await trio.sleep_forever()

    run(serve)


def _flush() -> None:
    """A reader of a pipe wants to know at once that we are ready."""
    import sys

    sys.stdout.flush()
