"""`scenectl bench`: the measurements that docs/benchmarks.md quotes, to be repeated on any machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from scenectl.copies import CopiesOption, MinCopiesOption
from scenectl.output import DEFAULT_PROFILE, PLAIN, Output, ProfileOutput, emit
from scenectl.own_cluster import check_own_cluster
from scenectl.values import (
    HD_QUARTER,
    NO_NODES,
    ONE_AND_FIVE,
    ONE_TWO_FIVE_SIXTEEN,
    SMALL_SIZE,
    THREE_FIVE_AND_NINE,
    ColourOption,
    NodeCountsOption,
    PoolsOption,
    PortsOption,
    SizeOption,
    cluster_ports,
    whole,
)
from scenefold.base.limits import COPIES_DEFAULT

COMMITS_MAX = 100
"""Changes of one measurement of a scene's log: with its beginning as many as a scene takes at once."""

app = App(name="bench", help="Measure, as the project's own documentation does.", help_format="plaintext")


@app.command
def curve(
    *,
    points: Annotated[int, whole(1, 100_000_000)] = 1_000_000,
    boxes: Annotated[int, whole(1, 1_000_000)] = 200,
    arcs: Annotated[int, whole(1, 1 << 18)] = 64,
    rounds: Annotated[int, whole(1, 100)] = 5,
    output: Output = PLAIN,
) -> None:
    """Measure the space-filling curves on one thread, beside numpy-hilbert-curve and hilbertcurve if they are installed.

    Example: scenectl bench curve --points 1000000

    Parameters
    ----------
    points
        Points of each measurement; the other packages get a share of them that takes about as long.
    boxes
        Boxes, with random corners, that are turned into arcs of the line.
    arcs
        Most arcs of a box.
    rounds
        How often everything is measured, in turns; the median counts.
    """
    from scenectl.bench_curve import CurveBench, bench_curve, bench_text

    report = bench_curve(CurveBench(points=points, boxes=boxes, arcs=arcs, rounds=rounds))
    emit(output, report, bench_text(report))


@app.command
def store(
    *,
    nodes: Annotated[int | None, whole(1, 127)] = None,
    copies: CopiesOption = COPIES_DEFAULT,
    min_copies: MinCopiesOption | None = None,
    mib: Annotated[int, whole(1, 1 << 20)] = 64,
    small_records: Annotated[int, whole(1, 1 << 24)] = 8192,
    seconds: Annotated[int, whole(1, 3600)] = 120,
    weather: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    ports: PortsOption | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Measure durable writes and reads through the whole path: sealed, signed, sent, verified, stored, and back.

    Example: scenectl bench store --nodes 5 --copies 3 --mib 256

    Parameters
    ----------
    nodes
        Nodes of the cluster that is started when no profile is given; by default 3.
    copies
        How many nodes shall hold each record.
    min_copies
        How many must hold a record before it counts as written; by default 2, or as many as there are copies.
    mib
        MiB of records of 60 KiB.
    small_records
        Number of records of 8 KiB.
    seconds
        Most that each of the four measurements may take; what was done until then counts.
    weather
        Measure also how long single reads take while a disk is slow, while a node is dead, and while its copies are made anew. Each node then moves 4 MiB a second at most by itself: at the default of 64 reads miss their goal while copies are made anew.
    ports
        Ports of the nodes, LOW,HIGH; by default 17349,17350.
    """
    from scenectl.bench_store import StoreBench, bench_store, bench_text
    from scenectl.running import run

    own = {"--nodes": (nodes, ""), "--ports": (ports, "SCENEFOLD_PORTS"), "--weather": (weather or None, "")}
    check_own_cluster("scenectl bench store", output.profile, own)
    bench = StoreBench(mib=mib, small_records=small_records, copies=copies, min_copies=min_copies, seconds=seconds, weather=weather)
    result = run(bench_store, bench, output.profile, 3 if nodes is None else nodes, cluster_ports(ports))
    emit(output, result, bench_text(result))


@app.command
def log(
    *,
    participants: NodeCountsOption = THREE_FIVE_AND_NINE,
    commits: Annotated[int, whole(1, COMMITS_MAX)] = COMMITS_MAX,
    clients: Annotated[int, whole(1, 64)] = 16,
    kills: Annotated[int, whole(0, 20)] = 3,
    simulated: NodeCountsOption = NO_NODES,
    ports: PortsOption | None = None,
    output: Output = PLAIN,
) -> None:
    """Measure how fast participants decide changes of a scene, in clusters that are started for it, and how soon after one of them is killed.

    Example: scenectl bench log --participants 3,5,9 --simulated 33

    Parameters
    ----------
    participants
        Numbers of participants, 1 to 33, each a cluster of so many nodes; or `none`.
    commits
        Changes of each measurement: one after the other, by several clients of one scene, and by clients of a scene each.
    clients
        How many ask at once.
    kills
        How often who proposes is killed while a change is under way.
    simulated
        Numbers of participants that are measured in virtual time as well, with links of 1 ms and processors and disks that take no time.
    ports
        Ports of the nodes, LOW,HIGH; by default 17349,17350.
    """
    from scenectl.bench_log import LogBench, bench_log, bench_text, simulated_rows
    from scenectl.running import run
    from scenefold.base.errors import UsageFault
    from scenefold.base.limits import DECIDERS_MAX

    for option, counts in (("--participants", participants), ("--simulated", simulated)):
        if max(counts.all, default=0) > DECIDERS_MAX:
            raise UsageFault(f"a scene has at most {DECIDERS_MAX} participants, not {max(counts.all)}", where=option)
    bench = LogBench(participants=participants.all, commits=commits, clients=clients, kills=kills)
    real = run(bench_log, bench, cluster_ports(ports)) if participants.all else []
    report = {"clients": clients, "participants": real, "simulated": simulated_rows(simulated.all, commits)}
    emit(output, report, bench_text(report))


@app.command
def seal(
    *,
    records: Annotated[int, whole(1, 100_000)] = 1024,
    rounds: Annotated[int, whole(1, 1000)] = 9,
    threads: Annotated[int, whole(1, 64)] = 2,
    output: Output = PLAIN,
) -> None:
    """Measure sealing, signing, verifying and opening of records, beside the same calls of the library made bare.

    Example: scenectl bench seal --rounds 9

    Parameters
    ----------
    records
        Records of a batch, at most; batches hold a mebibyte, as clients make them, and of RSA less.
    rounds
        How often everything is measured, in turns; the median counts.
    threads
        Threads that do it at once, at most; each number from 1 on is measured.
    """
    from scenectl.bench_seal import SealBench, bench_seal, bench_text

    report = bench_seal(SealBench(records=records, rounds=rounds, threads=threads))
    emit(output, report, bench_text(report))


@app.command
def hostile(
    *,
    attack: str | None = None,
    seconds: Annotated[int, whole(1, 3600)] = 2,
    rounds: Annotated[int, whole(1, 100)] = 3,
    nodes: Annotated[int, whole(1, 16)] = 3,
    ports: PortsOption | None = None,
    output: Output = PLAIN,
) -> None:
    """Measure how honest work goes on while somebody attacks a node of a cluster that is started for it.

    Example: scenectl bench hostile --seconds 10

    Parameters
    ----------
    attack
        One attack by its name, as the table shows it; all of them otherwise.
    seconds
        How long each turn lasts, of an attack, and beside a process that burns as much processor time.
    rounds
        How often these two take turns; the median counts.
    nodes
        Nodes of the cluster.
    ports
        Their ports, LOW,HIGH; by default 17349,17350.
    """
    from scenectl.attacks import ATTACKS
    from scenectl.bench_hostile import HostileBench, bench_hostile, bench_text
    from scenectl.running import run
    from scenefold.base.errors import LocalFault

    if attack is not None and attack not in ATTACKS:
        raise LocalFault(f"there is no attack named {attack!r}", remedy="one of these: " + ", ".join(ATTACKS))
    chosen = () if attack is None else (attack,)
    result = run(bench_hostile, HostileBench(attacks=chosen, seconds=seconds, rounds=rounds, nodes=nodes, ports=cluster_ports(ports)))
    emit(output, result, bench_text(result))


@app.command
def hashes(
    *files: Path,
    nodes: NodeCountsOption = ONE_TWO_FIVE_SIXTEEN,
    algorithm: str = "all",
    size: SizeOption = SMALL_SIZE,
    samples: Annotated[int, whole(1, 1_048_576)] = 64,
    sky: ColourOption | None = None,
    output: Output = PLAIN,
) -> None:
    """Render one image by many pools, with fixed and moving cells, lost and doubled packets and a node killed: all have one hash.

    All in this process, by the real renderer. Exit code 1 if anything is broken.

    Example: scenectl bench hashes --nodes 2,5 --algorithm kd,power

    Parameters
    ----------
    files
        Scene files; without any, the scene that the project brings along.
    nodes
        Sizes of pools, as 1,2,5,16.
    algorithm
        How space is divided and by which rules cells move: names between commas, or `all`.
    size
        Width and height in pixels.
    samples
        Paths for each pixel.
    sky
        Colour of a uniform sky as R,G,B, linear.
    """
    from scenectl.bench_hashes import HashesBench, algorithms_of, bench_hashes, bench_text
    from scenectl.output import note
    from scenectl.running import run
    from scenectl.still import check_files
    from scenefold.base.errors import LocalFault

    for file in files:
        check_files(file)
    bench = HashesBench(
        files=files,
        width=size.width,
        height=size.height,
        samples=samples,
        sky=(0.0, 0.0, 0.0) if sky is None else sky.rgb,
        nodes=nodes.all,
        algorithms=algorithms_of(algorithm),
    )
    report = run(bench_hashes, bench, (lambda _line: None) if output.json else note)
    emit(output, report, bench_text(report))
    if report["broken"]:
        what = f"{report['broken']} of {report['rows']} renders break the contract of hashes"
        raise LocalFault(what, where="the table above", remedy="this is a fault of the program: please report it")


@app.command
def render(
    *,
    scene: str = "sample",
    size: SizeOption = HD_QUARTER,
    samples: Annotated[int, whole(1, 1_048_576)] = 16,
    depth: Annotated[int, whole(1, 32)] = 8,
    seed: Annotated[int, whole(0, 2**32 - 1)] = 1,
    sky: ColourOption | None = None,
    camera: str | None = None,
    algorithm: str | None = None,
    pools: PoolsOption | None = None,
    fixed_cells: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    nodes: NodeCountsOption = ONE_AND_FIVE,
    repetitions: Annotated[int, whole(1, 100)] = 3,
    ports: PortsOption | None = None,
    output: Output = PLAIN,
) -> None:
    """Measure paths and rays a second on one thread against the bare Embree rate, and what more nodes cost.

    Example: scenectl bench render --scene cornell --size 512x512 --samples 64 --nodes 1,5

    Parameters
    ----------
    scene
        Scene file; or `sample`, the scene that the project brings along; or `cornell`, the Cornell box.
    size
        Width and height in pixels.
    samples
        Paths for each pixel.
    depth
        Most segments of a path, the camera ray being the first.
    seed
        Seed of the random numbers.
    sky
        Colour of a uniform sky as R,G,B, linear; without it there is none, and only the scene's own lights shine.
    camera
        Name of the camera; by default the scene's first.
    algorithm
        How space is divided among the nodes, and by which rule cells move; see `scenectl render still`.
    pools
        In how many pools the nodes render, by default as many as they have memory for, or one where --algorithm or --fixed-cells is given.
    fixed_cells
        Leave the cells where they are at first.
    nodes
        Sizes of the clusters to compare, as 1,5; `none` measures one thread only.
    repetitions
        How often everything on one thread is measured; the median counts.
    ports
        Ports of the nodes, LOW,HIGH; by default 17349,17350.
    """
    from scenectl.bench_render import RenderBench, bench_render, bench_text
    from scenectl.progress import Progress
    from scenectl.running import run
    from scenefold.render.client import StillOptions

    options = StillOptions(
        width=size.width,
        height=size.height,
        samples=samples,
        seed=seed,
        depth=depth,
        algorithm=algorithm,
        fixed_cells=fixed_cells,
        pools=None if pools is None else pools.count,
        sky=None if sky is None else sky.rgb,
        camera=camera,
    )
    bench = RenderBench(scene=scene, options=options, nodes=nodes.all, repetitions=repetitions, ports=ports)
    with Progress(quiet=output.json) as progress:
        result = run(bench_render, bench, progress)
    emit(output, result, bench_text(result))
