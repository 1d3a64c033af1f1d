"""Which meshes are baked into the world, and which stand in it as instances of a prototype.

A mesh that one node uses is baked: its triangles get world coordinates and belong to prototype 0. One that
several nodes use becomes a prototype of its own, unless all copies together are fewer triangles than the
bookkeeping of instances is worth, and the file does not call them instances itself. A copy without volume (a scale of 0) cannot be an instance, because no ray
can be carried into its space: it is baked too, or dropped where nothing of it is left to see.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault
from scenefold.base.limits import COORDINATE_ABS_MAX, INSTANCES_MAX
from scenefold.scene.importers.matrices import Matrix, cofactors, determinants
from scenefold.scene.importers.source import MeshPart, SourceScene
from scenefold.scene.payloads.instances import INSTANCE_ROW

BAKED_COPIES_TRIANGLES_MAX = 2_000
"""Copies of a mesh with no more triangles than this, all together, are baked."""
_FLAT_TRIANGLES_MAX = 1_000_000
_FLAT = 1e-9


@dataclass(slots=True)
class Prototypes:
    """Prototype p >= 1 is mesh `meshes[p - 1]`; prototype 0 is everything in `baked`."""

    baked: list[tuple[int, Matrix]] = field(default_factory=list)
    """(mesh, mesh -> world)"""
    meshes: list[int] = field(default_factory=list)
    instances: list[tuple[int, Matrix]] = field(default_factory=list)
    """(prototype, prototype -> world), without instance 0"""
    vanished: int = 0
    """Triangles of copies that a transform leaves nothing of."""

    def parts(self, source: SourceScene, prototype: int) -> Iterator[tuple[MeshPart, Matrix | None]]:
        """The parts of a prototype, with the transform to bake in."""
        if prototype:
            yield from ((part, None) for part in source.meshes[self.meshes[prototype - 1]])
        else:
            yield from ((part, matrix) for mesh, matrix in self.baked for part in source.meshes[mesh])

    def instance_rows(self) -> NDArray[np.void]:
        """INSTANCE_ROW of all instances; number 0 is the baked world."""
        rows = np.zeros(len(self.instances) + 1, INSTANCE_ROW)
        rows["matrix"][0] = np.eye(4)[:3]
        if self.instances:
            rows["prototype"][1:] = [prototype for prototype, _ in self.instances]
            rows["matrix"][1:] = np.array([matrix[:3] for _, matrix in self.instances])
        return rows


def decide(source: SourceScene) -> Prototypes:
    """The decision for a whole scene, in file order."""
    sizes = [sum(len(part.triangles) for part in parts) for parts in source.meshes]
    uses = np.bincount(source.placed_meshes, minlength=len(sizes)).tolist()
    called = np.zeros(len(sizes), bool)
    if source.as_instances is not None:
        called[source.placed_meshes[source.as_instances]] = True
    large = [use * size > BAKED_COPIES_TRIANGLES_MAX for use, size in zip(uses, sizes, strict=True)]
    shared = [use > 1 and (many or told) for use, many, told in zip(uses, large, called.tolist(), strict=True)]
    result, number, flat = Prototypes(), {}, 0
    flatness = _are_flat(source.placed_matrices).tolist()
    _check_reach(source)
    for mesh, matrix, is_flat in zip(source.placed_meshes.tolist(), source.placed_matrices, flatness, strict=True):
        if sizes[mesh] == 0:
            continue
        if shared[mesh] and not is_flat:
            if mesh not in number:
                result.meshes.append(mesh)
                number[mesh] = len(result.meshes)
            result.instances.append((number[mesh], matrix))
        elif not shared[mesh] or cofactors(matrix).any():
            result.baked.append((mesh, matrix))
            flat += sizes[mesh] if shared[mesh] else 0
        else:
            result.vanished += sizes[mesh]
    if flat > _FLAT_TRIANGLES_MAX:
        raise LocalFault(f"{source.name} places {flat} triangles without volume", remedy="remove scales of 0")
    if len(result.instances) >= INSTANCES_MAX:
        raise LocalFault(f"{source.name} has over {INSTANCES_MAX} instances", remedy="split the scene")
    return result


def _are_flat(matrices: Matrix) -> NDArray[np.bool_]:
    # As they are stored: what rounds to no volume has none.
    with np.errstate(over="ignore"):
        matrices = matrices.astype(np.float32).astype(np.float64)
    sizes = np.sqrt((matrices[:, :3, :3] ** 2).sum(axis=(1, 2)))
    flat: NDArray[np.bool_] = np.abs(determinants(matrices)) <= _FLAT * sizes**3
    return flat


def _check_reach(source: SourceScene) -> None:
    """Nothing may lie beyond the coordinates that f32 sums can bear."""
    reaches = [max((float(np.abs(part.positions).max(initial=0)) for part in parts), default=0) for parts in source.meshes]
    sizes = np.abs(source.placed_matrices)
    reach = np.array([*reaches, 0.0])[source.placed_meshes]
    farthest = sizes[:, :3, :3].sum(axis=2).max(axis=1) * reach + sizes[:, :3, 3].max(axis=1)
    if not (farthest <= COORDINATE_ABS_MAX).all():
        raise LocalFault(f"{source.name} has geometry at coordinates beyond 1e9", remedy="scale or move the scene")
