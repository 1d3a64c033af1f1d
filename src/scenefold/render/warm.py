"""`python -m scenefold.render.warm`: compile every kernel once, so that the first render need not.

A tiny scene that has everything (texture, instance, lamp, point light, glass, sky) goes the whole way from a source
scene to a film, on two nodes in this process, with cells of both families. What numba compiles on that way it
keeps (base/kernel_cache.py); five nodes that start together find it there instead of all compiling the same.
"""

from __future__ import annotations

import sys
import time
from typing import Literal

import numpy as np

from scenefold.base.ids import NodeId, SceneId
from scenefold.base.kernel_cache import note_compiled, use_kernel_cache

Algorithm = Literal["bounded-radial", "voronoi"]
_CUTS = 24
"""Triangles enough that two copies of them become instances."""


def warm() -> float:
    """Compile what is not compiled yet; the seconds that it took."""
    use_kernel_cache()
    begun = time.perf_counter()
    _curves()
    _render("voronoi")
    _render("bounded-radial")
    note_compiled()
    return time.perf_counter() - begun


def _curves() -> None:
    from scenefold.curve import Curve

    curve = Curve("hilbert", 3)
    cells = np.array([[1, 2, 3], [4, 5, 6]], np.uint64)
    curve.decode(curve.encode(cells))
    curve.arcs([1, 2, 3], [9, 9, 9], 8)


def _source() -> object:
    from scenefold.scene.importers.source import MeshPart, SourceScene, SourceTexture
    from scenefold.scene.payloads.cameras import Camera
    from scenefold.scene.payloads.materials import Material, TextureUse
    from scenefold.scene.payloads.punctual import PunctualLight

    steps = np.linspace(-1.0, 1.0, _CUTS + 1)
    x, z = (axis.ravel() for axis in np.meshgrid(steps, steps))
    corner = (np.arange(_CUTS)[:, None] * (_CUTS + 1) + np.arange(_CUTS)).ravel()
    squares = [np.stack([corner, corner + _CUTS + 1, corner + 1], 1), np.stack([corner + 1, corner + _CUTS + 1, corner + _CUTS + 2], 1)]
    triangles = np.concatenate(squares).astype(np.uint32)
    positions = np.stack([x, np.zeros_like(x), z], 1).astype(np.float32)
    uvs = np.stack([x, z], 1).astype(np.float32)
    floor, lamp, pane = (MeshPart(positions, None, uvs, triangles, material) for material in range(3))
    matrices = np.tile(np.eye(4), (5, 1, 1))
    matrices[1, :3, 3], matrices[2, :3, 3], matrices[3, :3, 3], matrices[4, :3, 3] = (0, 2, 0), (2, 0, 0), (0, 1, 0), (0, 1.5, 0)
    matrices[1, 1:3, 1:3] *= -1.0
    view = np.eye(4)
    view[:3, 3] = (0.0, 0.5, 3.0)
    image = np.full((4, 4, 4), 200, np.uint8)
    return SourceScene(
        "warm",
        [[floor], [lamp], [pane]],
        np.array([0, 1, 0, 2, 2]),
        matrices,
        [
            Material(base_color_texture=TextureUse(0), metallic_roughness_texture=TextureUse(0), double_sided=True),
            Material(emissive=(5.0, 5.0, 5.0)),
            Material(base_color=(0.9, 0.8, 0.7, 1.0), transmission=0.8, roughness=0.2),
        ],
        [SourceTexture("warm", 4, 4, True, False, lambda: image)],
        [Camera("eye", view)],
        [PunctualLight(kind="point", position=(0.0, 0.7, 0.5), color=(1.0, 1.0, 1.0))],
    )


def _render(algorithm: Algorithm) -> None:
    from scenefold.partition import make_partition
    from scenefold.render.content import held_textures, pair_boxes, scene_arrays, share_of
    from scenefold.render.contract import HeldGroup, HeldScene, load_renderer
    from scenefold.render.developing import develop
    from scenefold.render.film import Film
    from scenefold.render.job import Job
    from scenefold.render.layers import USUAL
    from scenefold.render.numbers import camera_numbers, job_box, job_numbers
    from scenefold.render.occupied import empty_space, occupied_by
    from scenefold.render.pass_sums import PassSums
    from scenefold.render.sealed_keys import NO_KEYS
    from scenefold.scene.importers.plan import ImportPlan
    from scenefold.scene.layout import GEOMETRY, TEXTURES
    from scenefold.scene.payloads.tiles import decode_tile
    from scenefold.scene.tables import SceneTables

    plan = ImportPlan(_source())  # type: ignore[arg-type]
    records = {(item.space, item.location): item.payload for item in plan.items()}
    document = plan.document()
    tables = SceneTables.from_payloads(document, [records[place] for place in document.locations()])
    camera = tables.cameras[0]
    box = np.stack(job_box(tables))
    _, pair_groups, low, high = pair_boxes(tables)
    weights = tables.groups.triangles[pair_groups].astype(np.float64)
    partition = make_partition(
        algorithm, 2, box, camera.matrix[:3, 3], -camera.matrix[:3, 2], camera.matrix[:3, 1], (low + high) * 0.5, weights
    )  # fmt: skip
    partition.exit(np.zeros((1, 3)), np.ones((1, 3)), 0.0, 0)
    partition.owner(np.zeros((1, 3)), np.ones((1, 3)))
    renderer = load_renderer("embree")
    job = Job(
        id=1, scene=SceneId(1), genesis=bytes(32), keys=NO_KEYS, content=document.digest,
        numeric_class=renderer.numeric_class(), width=16, height=16, samples=2, seed=1, frame=0, depth=4, sky=(0.5, 0.5, 0.5),
        camera=camera_numbers(camera, 16, 16), nodes=(NodeId(2), NodeId(3)), partition=partition,
    )  # fmt: skip
    numbers = job_numbers(job, tables)
    opened = []
    for me in range(partition.nodes):
        share = share_of(tables, partition, me)
        atoms = {
            group: tables.group_atoms(group, [records[GEOMETRY, place] for place in tables.groups.locations(group)])
            for group in share.groups
        }
        worn = held_textures(tables, atoms)
        tiles = {number: [decode_tile(records[TEXTURES, place]) for place in tables.textures[number].tiles] for number in worn}
        held = tuple(HeldGroup(g, int(tables.groups.prototypes[g]), int(tables.groups.triangles[g])) for g in share.groups)
        instances = tuple((number, int(tables.instances.prototypes[number])) for number in share.instances)
        arrays = scene_arrays(tables, atoms, tiles)
        empty_space(tables, occupied_by(tables, arrays, partition, me))
        opened.append(renderer.open(HeldScene(arrays, held, instances), numbers, partition, me))
    tracers = [scene.tracers(1)[0] for scene in opened]
    size = job.plan.size(0)
    sums = [PassSums.zeros(size) for _ in tracers]
    waiting = list(tracers[0].generate(0, size).items())
    while waiting:
        node, rays = waiting.pop()
        waiting += tracers[node].advance(rays, 0, sums[node]).leaving.items()
    sums[0].add_bytes(sums[1].to_bytes())
    film, other = Film(16, 16), Film(16, 16)
    film.add(sums[0], 0, numbers.stride)
    other.merge_part(0, next(film.parts()))
    develop(other, USUAL, job_box(tables))
    for scene in opened:
        scene.close()


if __name__ == "__main__":
    sys.stdout.write(f"kernels are compiled ({warm():.0f} s)\n")
