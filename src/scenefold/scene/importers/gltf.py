"""glTF 2.0 and GLB, read from their JSON and buffers directly.

trimesh reads glTF too, but flattens what we need (samplers, alpha modes, named cameras, punctual lights,
EXT_mesh_gpu_instancing, sparse accessors) and trusts what a file claims. Here every claim is checked.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_animations import Pose, read_pose
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_materials import CARRIED, GltfMaterials
from scenefold.scene.importers.gltf_meshes import GltfMeshes
from scenefold.scene.importers.gltf_nodes import NodeWalk, Placements
from scenefold.scene.importers.gltf_shapes import GltfShapes, Shape
from scenefold.scene.importers.moments import AT_REST, Moment
from scenefold.scene.importers.source import MeshPart, NotCarried, SourceScene

_UNDERSTOOD = CARRIED | {
    "KHR_lights_punctual", "KHR_texture_transform", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
}  # fmt: skip


def read_gltf(path: Path, moment: Moment = AT_REST) -> SourceScene:
    """The scene of a .gltf or .glb at a moment of its animations; LocalFault if anything that is needed is missing or wrong."""
    file = GltfFile(path)
    left = NotCarried()
    _check_asset(file.json, left)
    accessors = Accessors(file)
    pose = read_pose(file, accessors, left, moment)
    placements = NodeWalk(file, accessors, left, pose).walk()
    shapes = GltfShapes(file, accessors, placements.worlds, left)
    materials = GltfMaterials(file, left)
    reader = GltfMeshes(file, accessors, materials, shapes, left)
    shown = _shapes_of(file.json, placements, pose, shapes, left)
    used = sorted(set(shown))
    meshes: list[list[MeshPart]] = [reader.read(shape) for shape in used]
    new_number = {shape: at for at, shape in enumerate(used)}
    for place, shape in enumerate(shown):
        if shape.skin >= 0:
            # Its joints have carried it into the world.
            placements.matrices[place] = np.eye(4)
    matrices = np.array(placements.matrices) if placements.matrices else np.empty((0, 4, 4))
    return SourceScene(
        name=moment.named(path.name),
        meshes=meshes,
        placed_meshes=np.array([new_number[shape] for shape in shown], np.int64),
        placed_matrices=matrices,
        as_instances=np.array(placements.as_instances, bool),
        materials=materials.materials,
        textures=materials.textures.list.textures,
        cameras=placements.cameras,
        punctual=placements.punctual,
        not_carried=left.lines(),
    )


def _check_asset(json: JsonMap, left: NotCarried) -> None:
    version = json.inner("asset").text("version")
    if not version.startswith("2."):
        raise json.fault(f"is {version!r}: scenefold reads glTF 2", "asset.version")
    for name in json.texts("extensionsRequired"):
        if name not in _UNDERSTOOD and not name.startswith("KHR_materials_"):
            raise json.fault(f"names {name}, which scenefold does not read", "extensionsRequired")
    for name in json.texts("extensionsUsed"):
        # Those of materials are counted by the materials that have them; variants stand elsewhere.
        if name not in _UNDERSTOOD and (not name.startswith("KHR_materials_") or name == "KHR_materials_variants"):
            left.note(f"extension {name}")


def _shapes_of(json: JsonMap, placements: Placements, pose: Pose, shapes: GltfShapes, left: NotCarried) -> list[Shape]:
    """The shape of each placement."""
    nodes, meshes, skins = json.maps("nodes"), json.maps("meshes"), len(json.maps("skins"))
    shown: dict[int, Shape] = {}
    for number, mesh in zip(placements.nodes, placements.meshes, strict=True):
        if number in shown:
            continue
        node = nodes[number]
        weights = pose.of(number, "weights") or node.row("weights") or meshes[mesh].row("weights")
        weights = weights if any(weights) else ()
        skin = node.index("skin", skins, "skin")
        if skin >= 0 and (node.extension("EXT_mesh_gpu_instancing") is not None or not shapes.can_bend(skin)):
            left.note("skins of instances, or with joints that the scene does not show, in the pose that they were modelled in")
            skin = -1
        shown[number] = Shape(mesh, weights, skin, number if skin >= 0 else -1)
    return [shown[number] for number in placements.nodes]
