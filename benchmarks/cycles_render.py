"""Runs in a Python that has bpy, started by cycles_process.py: builds a scene of diffuse triangles, then renders it for each seed it reads.

Its time is told by who asks; what Cycles prints itself is passed over there.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import bpy  # type: ignore[import-not-found]
import mathutils  # type: ignore[import-not-found]
import numpy as np


def main() -> int:
    folder = Path(sys.argv[1])
    asked = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _settings(scene, asked)
    _sky(scene, asked["sky"])
    _camera(scene, asked["camera"])
    _meshes(scene, np.load(folder / "scene.npz"))
    for line in sys.stdin:
        seed = int(line)
        scene.cycles.seed = seed
        scene.render.filepath = str(folder / f"{seed}.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        pixels = np.empty(asked["width"] * asked["height"] * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
        # Blender's rows begin at the bottom.
        np.save(folder / f"{seed}.npy", pixels.reshape(asked["height"], asked["width"], 4)[::-1, :, :3])
        print(f"\ndone {seed}.npy", flush=True)
    return 0


def _settings(scene: Any, asked: dict[str, Any]) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = asked["width"], asked["height"], 100
    render.threads_mode, render.threads = "FIXED", asked["threads"]
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.use_persistent_data = True
    cycles.device, cycles.samples = "CPU", asked["samples"]
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    # Ours count segments: the camera's is the first, and the last only looks at what it meets.
    bounces = asked["depth"] - 1
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = bounces
    cycles.min_light_bounces = asked["roulette_from"]
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True


def _sky(scene: Any, radiance: list[float]) -> None:
    world = scene.world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*radiance, 1.0)


def _camera(scene: Any, numbers: list[float]) -> None:
    """Position, right, up, forward; then the tangents of half the view, across and up."""
    position, right, up, forward = (np.array(numbers[first : first + 3]) for first in (0, 3, 6, 9))
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "VERTICAL"
    data.angle = 2.0 * float(np.arctan(numbers[13]))
    data.clip_start, data.clip_end = 1e-4, 1e6
    placed = scene.camera = bpy.data.objects.new("camera", data)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, up, -forward, position
    placed.matrix_world = mathutils.Matrix(matrix.tolist())
    scene.collection.objects.link(placed)


def _meshes(scene: Any, arrays: Any) -> None:
    for number in np.unique(arrays["materials"]):
        chosen = arrays["materials"] == number
        corners = arrays["positions"][chosen].reshape(-1, 3)
        mesh = bpy.data.meshes.new(f"mesh {number}")
        mesh.vertices.add(len(corners))
        mesh.vertices.foreach_set("co", corners.ravel())
        mesh.loops.add(len(corners))
        mesh.loops.foreach_set("vertex_index", np.arange(len(corners), dtype=np.int32))
        mesh.polygons.add(len(corners) // 3)
        mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
        mesh.update(calc_edges=True)
        mesh.materials.append(_material(arrays, int(number)))
        scene.collection.objects.link(bpy.data.objects.new(mesh.name, mesh))


def _material(arrays: Any, number: int) -> Any:
    color, radiance = arrays["colors"][number], arrays["radiances"][number]
    material = bpy.data.materials.new(f"material {number}")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    body = nodes.new("ShaderNodeBsdfDiffuse")
    body.inputs["Color"].default_value = (*(float(one) for one in color), 1.0)
    surface = body.outputs["BSDF"]
    if float(radiance.max()) > 0.0:
        # The back of a lamp is dark, as with the others, unless it shines on both sides.
        lamp, side, mix = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMixShader")
        lamp.inputs["Color"].default_value = (*(float(one) for one in radiance), 1.0)
        mix.inputs[0].default_value = 0.0
        if not arrays["two_sided"][number]:
            links.new(side.outputs["Backfacing"], mix.inputs[0])
        links.new(lamp.outputs["Emission"], mix.inputs[1])
        links.new(surface, mix.inputs[2])
        surface = mix.outputs["Shader"]
    links.new(surface, output.inputs["Surface"])
    return material


if __name__ == "__main__":
    sys.exit(main())
