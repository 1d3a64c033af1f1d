"""`scenectl node`: run one node of a cluster, or several on this machine for trying things; let one leave; look at its disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from scenectl.checking import repair, verify
from scenectl.errors import DEGRADED, DONE
from scenectl.output import DEFAULT_PROFILE, PLAIN, Output, ProfileOutput, emit, emit_event
from scenectl.values import AddressesOption, AddressOption, PortsOption, PrefixesOption, cluster_ports, real, whole

if TYPE_CHECKING:
    import trio

    from scenefold.client import DrainReport
    from scenefold.node import Extension, NodeSettings

app = App(name="node", help="Run nodes, let them leave, and look at what they have stored.", help_format="plaintext")
app.command("scenectl.blacklist:app", name="blacklist", help="Say which nodes must hold no copies of what a node owns.")
app.command("scenectl.upkeep:app", name="upkeep", help="Pause what nodes do by themselves with records, or bound its speed.")
app.command(verify)
app.command(repair)

Count = Annotated[int, whole(1, 127)]


@app.command(name="run")
def run_(
    *,
    address: Annotated[AddressOption, Parameter(env_var="SCENEFOLD_ADDRESS")],
    data: Annotated[Path | None, Parameter(env_var="SCENEFOLD_DATA")] = None,
    seeds: Annotated[AddressesOption | None, Parameter(env_var="SCENEFOLD_SEEDS")] = None,
    seed_wait: Annotated[float, real(gt=0, lte=86_400, env_var="SCENEFOLD_SEED_WAIT")] = 30.0,
    threads: Annotated[int | None, whole(1, 1024, env_var="SCENEFOLD_THREADS")] = None,
    memory: Annotated[int, whole(0, 2**63 - 1, env_var="SCENEFOLD_MEMORY")] = 0,
    capacity: Annotated[int, whole(0, 2**63 - 1, env_var="SCENEFOLD_CAPACITY")] = 0,
    transfer: Annotated[int, whole(1, 2**63 - 1, env_var="SCENEFOLD_TRANSFER")] = 64 * 1024 * 1024,
    remove_after: Annotated[float, real(gte=13, lte=86_400 * 365, env_var="SCENEFOLD_REMOVE_AFTER")] = 120.0,
    blacklist: Annotated[PrefixesOption | None, Parameter(env_var="SCENEFOLD_BLACKLIST")] = None,
    scrub_days: Annotated[float, real(gt=0, lte=3650, env_var="SCENEFOLD_SCRUB_DAYS")] = 30.0,
    scrub: Annotated[int, whole(1, 2**63 - 1, env_var="SCENEFOLD_SCRUB")] = 16 * 1024 * 1024,
    join_at: Annotated[str, Parameter(env_var="SCENEFOLD_JOIN_AT")] = "loaded",
    balance: Annotated[bool, Parameter(env_var="SCENEFOLD_BALANCE")] = True,
    log_level: Literal["debug", "info", "warning", "error"] = "info",
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Run the node with this address until it is told to stop (Ctrl-C or SIGTERM). Its log goes to standard error.

    Example: scenectl node run --address 127.0.0.2 --profile studio --data /srv/scenefold

    Parameters
    ----------
    address
        The node's IPv4 address; it must be one of this machine and of the cluster.
    data
        Folder for what the node stores; by default one in the user's data folder.
    seeds
        Addresses of nodes to find the others by; by default those of the profile.
    seed_wait
        Seconds until it is an error that none of the others answers.
    threads
        Threads that may render; by default as many as there are processors.
    memory
        Bytes of memory that the node may use; 0: half of the machine's.
    capacity
        Bytes that the node may store; 0: what its disk holds.
    transfer
        Bytes a second that the node may use to move data by itself: of its arc, and of copies.
    remove_after
        Seconds that a node must be silent before this one has it removed from the cluster.
    blacklist
        Addresses of nodes that must not hold copies of this node's data, or prefixes such as 10.1.2.0/24: those in the same rack, say. They are added to what stands on its blacklist already.
    scrub_days
        Days of running in which the node reads all of its records again, to find what has rotted on its disk.
    scrub
        Bytes a second that this may take at most; then it takes longer.
    join_at
        Where a newcomer stands on the line: "loaded", beside the fullest node, of which it gets half, 64 MiB at first; "random"; or a location in hexadecimal, 8 for the middle of the line.
    balance
        Whether the node evens out its load with its neighbours'.
    log_level
        Least important lines that are logged.
    """
    from scenefold.client import profile_folder
    from scenefold.node import NodeSettings
    from scenefold.node.logs import set_up_logs
    from scenefold.peer.settings import place_of

    # Before anything is looked for: a word that is wrong is wrong without a profile, too.
    place = place_of(join_at)
    set_up_logs("json" if output.json else "console", log_level)
    settings = replace(
        NodeSettings.for_member(profile_folder(output.profile), address.text, data=data, threads=threads),
        seeds=() if seeds is None else seeds.all,
        seed_wait_s=seed_wait,
        memory_bytes=memory,
        capacity_bytes=capacity,
        transfer_bytes_per_s=transfer,
        remove_after_s=remove_after,
        blacklist=() if blacklist is None else blacklist.all,
        scrub_days=scrub_days,
        scrub_bytes_per_s=scrub,
        join_place=place,
        balance=balance,
    )
    run_until_stopped(settings, output)


def run_until_stopped(
    settings: NodeSettings, output: Output, *, extensions: Sequence[Extension] | None = None, told_ready: trio.Event | None = None
) -> None:
    """Run a node, say when it is ready (`told_ready`: set then) and, should it leave the cluster in order, that it has."""
    import trio

    from scenectl.running import serve
    from scenefold.node import run_node

    async def work() -> None:
        async with trio.open_nursery() as nursery:
            await nursery.start(partial(run_node, settings, extensions=extensions))
            document = {"event": "ready", "address": settings.address, "data": str(settings.data_folder)}
            emit_event(output, document, f"Node {settings.address} is ready; its data is in {settings.data_folder}.")
            if told_ready is not None:
                told_ready.set()
        emit_event(output, {"event": "left", "address": settings.address}, f"Node {settings.address} has left the cluster.")

    serve(work)


@app.command
def drain(
    address: AddressOption,
    /,
    *,
    check: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    cancel: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    dry_run: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Have a node hand everything over and leave the cluster; ends when it has left, and its process with it.

    Ctrl-C ends only the watching: the node goes on until it has left, or --cancel. Exit code 4 if the node cannot leave.

    Example: scenectl node drain 192.168.1.14 --profile studio

    Parameters
    ----------
    address
        IPv4 address of the node.
    check
        Only say whether the node may be switched off now without losing anything; exit code 5 if not.
    cancel
        Let a node stay that is on its way out.
    dry_run
        Say what would be moved, whether neighbours have room for it, and whether the node would refuse, and change nothing; exit code 5 if it could not leave now.
    """
    from scenectl.draining import check_known, could_leave, leave, plan_text
    from scenectl.progress import Progress
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault

    if check + cancel + dry_run > 1:
        raise UsageFault("--check, --cancel and --dry-run exclude each other", where="scenectl node drain", remedy="give one of them")

    async def ask() -> DrainReport:
        async with connected(output.profile) as cluster:
            await check_known(cluster, address.text)
            if check or cancel or dry_run:
                return await cluster.drain(address.text, check_only=not cancel, cancel=cancel)
            with Progress(quiet=output.json) as progress:
                return await leave(cluster, address.text, progress)

    report = run(ask)
    document = {"address": address.text, **report.document()}
    if dry_run:
        emit(output, {**document, "dry_run": True}, plan_text(address.text, report))
        return DONE if could_leave(report) else DEGRADED
    if check:
        words = "may be switched off" if report.may_switch_off else "must stay: " + "; ".join(report.obstacles)
        emit(output, document, f"Node {address} {words}.")
        return DONE if report.may_switch_off else DEGRADED
    words = "stays" if cancel else "has left the cluster: it may be switched off"
    emit(output, document, f"Node {address} {words}.")
    return DONE


@app.command
def local(
    count: Count,
    /,
    *,
    folder: Path | None = None,
    spares: Annotated[int, whole(0, 126)] = 0,
    threads: Annotated[int | None, whole(1, 1024, env_var="SCENEFOLD_THREADS")] = None,
    ports: PortsOption | None = None,
    trust: bool = True,
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
    spares
        Further nodes that get keys and are not started: `scenectl node run` with their address lets them join.
    threads
        Threads that each node may render with; by default the machine's are shared out.
    ports
        Ports for low and high priority, LOW,HIGH; by default 17349,17350.
    trust
        A cluster that is made now trusts all these nodes, so that they render what it holds. With --no-trust only the first one: the others store what they cannot read.
    """
    import trio

    from scenectl.running import serve
    from scenefold.node.local import local_cluster

    async def work() -> None:
        async with local_cluster(count, folder, spares=spares, threads=threads, ports=cluster_ports(ports), trust=trust) as cluster:
            profile = str(cluster.profile.resolve())
            document = {"event": "ready", "profile": profile, "nodes": list(cluster.addresses), "spares": list(cluster.spares)}
            emit_event(output, document, f"{count} nodes are ready; use --profile {profile}\nCtrl-C ends them.")
            await trio.sleep_forever()

    serve(work)
