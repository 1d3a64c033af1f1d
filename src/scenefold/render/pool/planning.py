"""What a job is made of, by what a user asks for and the scene as it lies there: read once, by who organises it."""

from __future__ import annotations

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.partition import Partition
from scenefold.render.algorithms import WHOLE, rule_of
from scenefold.render.contract import Renderer, check_layers_written
from scenefold.render.first_cells import first_cells
from scenefold.render.job import Job
from scenefold.render.layers import image_bytes
from scenefold.render.numbers import camera_numbers
from scenefold.render.pool.host import Host
from scenefold.render.pool.kept_film import kept_bytes
from scenefold.render.pool.promises import Account
from scenefold.render.pool.request import RenderRequest
from scenefold.render.pool.share import LANE, read_tables
from scenefold.scene.log import EpochKeys
from scenefold.scene.tables import SceneTables


async def planned(host: Host, renderer: Renderer, request: RenderRequest, keys: EpochKeys, account: Account) -> tuple[Job, SceneTables]:
    """The job, and the scene's tables. LocalFault or Refused if it cannot be; `account`: of the memory that whoever organises it takes for that."""
    await host.compiled()
    options = request.options
    pixels = options.window.pixels
    image = f"the image of {options.window.width}x{options.window.height}"
    account.take("image", image_bytes(options.layers, pixels), image, "render it smaller")
    if request.keep is not None:
        what = f"to keep a render of {pixels} pixels"
        account.take("kept film", kept_bytes(pixels, options.columns), what, "render it without --resume, or smaller")
    async with host.reader(request.scene, request.genesis, keys, request.head) as reader:
        tables = await read_tables(reader, host.world.workers)
    return await host.world.workers.run(LANE, _made, host, renderer, request, tables), tables


async def fresh_cells(host: Host, tables: SceneTables, algorithm: str, camera: str | None, nodes: int) -> Partition:
    """Cells for so many nodes, by where geometry lies. `camera`: as it was asked for, and was there."""
    known = tables.camera(camera)
    assert known is not None
    return await host.world.workers.run(LANE, first_cells, algorithm, nodes, tables, known)


def _made(host: Host, renderer: Renderer, request: RenderRequest, tables: SceneTables) -> Job:
    options = request.options
    check_layers_written(renderer, options.layers)
    camera = tables.camera(options.camera)
    if camera is None:
        names = ", ".join(repr(known.name) for known in tables.cameras)
        raise LocalFault(
            f"the scene has no camera {options.camera!r}",
            remedy=f"choose one of: {names}; where none is named it is that of `scenectl scene settings`",
        )
    nodes = _nodes(host, request)
    partition = first_cells(options.algorithm, len(nodes), tables, camera)
    return Job(
        id=request.job,
        scene=request.scene,
        genesis=request.genesis,
        keys=request.keys,
        content=tables.document.digest,
        numeric_class=renderer.numeric_class(),
        width=options.width,
        height=options.height,
        samples=options.samples,
        seed=options.seed,
        frame=0,
        depth=options.depth,
        sky=options.sky,
        camera=camera_numbers(camera, options.width, options.height),
        nodes=nodes,
        partition=partition,
        head=request.head,
        layers=options.layers,
        crop=options.crop,
        lens=options.lens,
        sampling=options.sampling,
        environment_rotation=options.environment_rotation,
        adaptive=options.adaptive,
        mips=options.mips,
        keeps=request.keep is not None,
        moves=options.moving and len(nodes) > 1 and rule_of(options.algorithm) is not None,
        whole=options.algorithm == WHOLE and len(nodes) > 1,
    )


def _nodes(host: Host, request: RenderRequest) -> tuple[NodeId, ...]:
    """Of those that the client named, the members. Nobody else: only for them are the keys, in what we hand on as in what we have."""
    named = request.keys.nodes
    nodes = tuple(node for node in host.nodes() if node in named)
    if host.node_id not in nodes:
        raise Refused(RejectReason.NOT_READY, "this node is no member of the cluster at the moment", remedy="start the render again")
    return nodes
