"""glTF 2.0 and GLB, read from their JSON and buffers directly.

trimesh reads glTF too, but flattens what we need (samplers, alpha modes, named cameras, punctual lights,
EXT_mesh_gpu_instancing, sparse accessors) and trusts what a file claims. Here every claim is checked.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_materials import CARRIED, GltfMaterials
from scenefold.scene.importers.gltf_meshes import GltfMeshes
from scenefold.scene.importers.gltf_nodes import NodeWalk
from scenefold.scene.importers.source import MeshPart, NotCarried, SourceScene

_UNDERSTOOD = CARRIED | {
    "KHR_lights_punctual", "KHR_texture_transform", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
}  # fmt: skip


def read_gltf(path: Path) -> SourceScene:
    """The scene of a .gltf or .glb; LocalFault if anything that is needed is missing or wrong."""
    file = GltfFile(path)
    left = NotCarried()
    _check_asset(file.json, left)
    accessors = Accessors(file)
    placements = NodeWalk(file, accessors, left).walk()
    materials = GltfMaterials(file, left)
    reader = GltfMeshes(file, accessors, materials, left)
    used = sorted(set(placements.meshes))
    meshes: list[list[MeshPart]] = [reader.read(number) for number in used]
    new_number = {number: at for at, number in enumerate(used)}
    matrices = np.array(placements.matrices) if placements.matrices else np.empty((0, 4, 4))
    return SourceScene(
        name=path.name,
        meshes=meshes,
        placed_meshes=np.array([new_number[number] for number in placements.meshes], np.int64),
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
    left.note("animations", len(json.maps("animations")))
