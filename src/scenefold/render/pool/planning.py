"""What a job is made of, by what a user asks for and the scene as it lies there: read once, by who organises it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import NamedTuple

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.render.algorithms import rule_of
from scenefold.render.contract import Renderer, check_layers_written, deals_paths
from scenefold.render.job import POOLS_THAT_FIT, Job, RenderOptions
from scenefold.render.layers import image_bytes
from scenefold.render.numbers import camera_numbers
from scenefold.render.pool.budgets import budgets_of, counted_on
from scenefold.render.pool.dividing import Dividing, asks_budgets
from scenefold.render.pool.host import Host
from scenefold.render.pool.kept_film import kept_bytes
from scenefold.render.pool.promises import Account
from scenefold.render.pool.request import RenderRequest
from scenefold.render.pool.share import LANE, read_tables
from scenefold.scene.log import EpochKeys
from scenefold.scene.tables import SceneTables

_log = logging.getLogger(__name__)


class Plan(NamedTuple):
    """What an organiser begins with."""

    job: Job
    tables: SceneTables
    dividing: Dividing

    def as_counted(self) -> AbstractContextManager[None]:
        """While the job is rendered: who takes memory meanwhile that was counted on does not fail it for good."""
        return counted_on() if self.dividing.goes_by_budgets and self.job.others else nullcontext()


async def planned(host: Host, renderer: Renderer, request: RenderRequest, keys: EpochKeys, account: Account) -> Plan:
    """LocalFault, Refused or Unreachable if it cannot be; `account`: of the memory that whoever organises it takes for that."""
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
    nodes = _nodes(host, request)
    options, free = await _with_budgets(host, renderer, options, nodes)
    return await host.world.workers.run(LANE, _made, host, renderer, replace(request, options=options), tables, nodes, free)


async def _with_budgets(
    host: Host, renderer: Renderer, options: RenderOptions, nodes: Sequence[NodeId]
) -> tuple[RenderOptions, dict[NodeId, int]]:
    """The options, with one pool if as many as can be are asked for and no more can; and the memory of nodes, if that counts."""
    as_many_as_can_be = options.pools == POOLS_THAT_FIT
    if as_many_as_can_be and not deals_paths(renderer):
        return replace(options, pools=1), {}
    if not asks_budgets(options):
        return options, {}
    try:
        return options, await budgets_of(host, nodes)
    except LocalFault as fault:
        if not as_many_as_can_be:
            raise
        _log.warning("job: rendered in one pool: %s", fault)
        return replace(options, pools=1), {}


def _made(
    host: Host, renderer: Renderer, request: RenderRequest, tables: SceneTables, nodes: tuple[NodeId, ...], free: Mapping[NodeId, int]
) -> Plan:
    options = request.options
    check_layers_written(renderer, options.layers)
    camera = tables.camera(options.camera)
    if camera is None:
        names = ", ".join(repr(known.name) for known in tables.cameras)
        raise LocalFault(
            f"the scene has no camera {options.camera!r}",
            remedy=f"choose one of: {names}; where none is named it is that of `scenectl scene settings`",
        )
    dividing = Dividing(host.world.workers, tables, options, camera, free, len(nodes))
    division = dividing.first(nodes)
    job = Job(
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
        partition=division.pools[0],
        others=division.pools[1:],
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
        skips=options.skips and any(cells.nodes > 1 for cells in division.pools),
    )
    return Plan(job, tables, dividing)


def _nodes(host: Host, request: RenderRequest) -> tuple[NodeId, ...]:
    """Of those that the client named, the members. Nobody else: only for them are the keys, in what we hand on as in what we have."""
    named = request.keys.nodes
    nodes = tuple(node for node in host.nodes() if node in named)
    if host.node_id not in nodes:
        raise Refused(RejectReason.NOT_READY, "this node is no member of the cluster at the moment", remedy="start the render again")
    return nodes
