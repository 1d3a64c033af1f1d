"""Makes the project's own sample scene: a small gallery with gold, chrome, glass, marble, oak and soft light.

    python tools/make_sample_scene.py                       the file that the package ships
    python tools/make_sample_scene.py --detail 300000 -o gallery.glb

It has what a renderer must show: diffuse walls of different colour, a textured floor, rough and smooth metal,
clear and tinted glass, large and small emitters, and columns that are instances of one mesh. The same version
of this script, numpy and Pillow makes the same file.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from glb_writer import GlbWriter
from sample_parquet import parquet
from sample_shapes import (
    Shape,
    fluted_column,
    joined,
    moved,
    polyline_profile,
    rectangle,
    revolution,
    smooth_profile,
    sphere,
    torus_knot,
    tube,
)

_SHIPPED = Path(__file__).parent.parent / "src" / "scenefold" / "data" / "sample.glb"
_DEFAULT_DETAIL = 40_000
_SIZE_MAX = 2_000_000
_HALF_WIDTH, _BACK, _FRONT, _HEIGHT = 4.0, -3.4, 7.2, 4.4


class Gallery:
    """Builds the scene with about `detail` triangles, counted with instances drawn once."""

    def __init__(self, detail: int) -> None:
        # Nearly all triangles lie in grids, whose cells grow with the square of this.
        self._fineness = math.sqrt(detail / _DEFAULT_DETAIL)
        self.glb = GlbWriter()

    def steps(self, count: int, least: int = 6) -> int:
        return max(least, round(count * self._fineness))

    def build(self) -> GlbWriter:
        self._room()
        self._centre()
        self._columns()
        self._still_life()
        self._camera()
        return self.glb

    def _material(self, name: str, colour: tuple[float, ...], *, metallic: float = 0.0, roughness: float = 1.0, **more: Any) -> int:
        surface: dict[str, Any] = {"metallicFactor": metallic, "roughnessFactor": roughness}
        surface["baseColorFactor"] = [*colour, 1.0]
        surface |= more.pop("textures", {})
        return self.glb.add("materials", {"name": name, "pbrMetallicRoughness": surface, **more})

    def _emitter(self, name: str, colour: tuple[float, float, float], strength: float, **more: Any) -> int:
        extension = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
        return self._material(name, (0.0, 0.0, 0.0), emissiveFactor=list(colour), extensions=extension, **more)

    def _glass(self, name: str, colour: tuple[float, float, float]) -> int:
        extensions = {"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_ior": {"ior": 1.5}}
        return self._material(name, colour, roughness=0.0, doubleSided=True, extensions=extensions)

    def _place(self, name: str, shape: Shape, material: int, *, textured: bool = False, **node: Any) -> None:
        self.glb.node(name=name, mesh=self.glb.mesh(name, shape, material, textured=textured), **node)

    def _room(self) -> None:
        wide, deep, high = 2 * _HALF_WIDTH, _FRONT - _BACK, _HEIGHT
        x, y, z = np.eye(3)
        back_left = np.array([-_HALF_WIDTH, 0.0, _BACK])
        front_right = np.array([_HALF_WIDTH, 0.0, _FRONT])
        colour, rough = (self.glb.image(png) for png in parquet())
        textures = {"baseColorTexture": {"index": colour}, "metallicRoughnessTexture": {"index": rough}}
        oak = self._material("oak", (1.0, 1.0, 1.0), textures=textures)
        plaster = self._material("plaster", (0.82, 0.79, 0.74))
        terracotta = self._material("terracotta", (0.66, 0.25, 0.14))
        teal = self._material("teal", (0.06, 0.27, 0.30))
        self._place("floor", rectangle(back_left, z * deep, x * wide, (deep / 2.2, wide / 2.2)), oak, textured=True)
        self._place("ceiling", rectangle(back_left + y * high, x * wide, z * deep), plaster)
        self._place("back wall", rectangle(back_left, x * wide, y * high), plaster)
        self._place("front wall", rectangle(front_right, -x * wide, y * high), plaster)
        self._place("left wall", rectangle(back_left, y * high, z * deep), terracotta)
        self._place("right wall", rectangle(front_right, y * high, -z * deep), teal)
        daylight = self._emitter("daylight", (1.0, 0.94, 0.86), 9.0)
        self._place("skylight", rectangle(np.array([-1.5, high - 0.02, -0.6]), x * 3.0, z * 2.6), daylight)

    def _centre(self) -> None:
        steps = self.steps
        basalt = self._material("basalt", (0.045, 0.047, 0.055), roughness=0.28)
        edge = 0.03
        profile = [
            (0.0, 0.0), (1.5, 0.0), (1.5, 0.16 - edge), (1.5 - edge, 0.16), (1.12, 0.16), (1.12, 0.34 - edge),
            (1.12 - edge, 0.34), (0.62, 0.34), (0.60, 0.38), (0.50, 0.95), (0.58, 1.0), (0.58, 1.06), (0.0, 1.06),
        ]  # fmt: skip
        rings = 4 * (len(profile) - 1)
        self._place("plinth", revolution(polyline_profile(profile), steps(72), rings), basalt)
        gold = self._material("gold", (1.0, 0.71, 0.29), metallic=1.0, roughness=0.2)
        knot = tube(torus_knot, 0.135, steps(300), steps(30))
        self._place("knot", knot, gold, translation=[0.0, 2.03, 0.0], rotation=[0.0, math.sin(0.17), 0.0, math.cos(0.17)])
        halo = self._emitter("halo", (1.0, 0.72, 0.42), 7.0)

        def circle(u: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
            angle = 2 * np.pi * u
            return np.stack([1.62 * np.cos(angle), 1.62 * np.sin(angle), np.zeros_like(angle)], -1)

        self._place("halo", tube(circle, 0.03, 72, 6), halo, translation=[-0.3, 2.19, _BACK + 0.12])

    def _columns(self) -> None:
        marble = self._material("marble", (0.86, 0.84, 0.81), roughness=0.42)
        steps = self.steps
        shaft = moved(fluted_column(0.27, 3.5, 16, steps(96, 64), steps(18)), (0.0, 0.3, 0.0))
        ring = [(0.0, 0.0), (0.40, 0.0), (0.40, 0.14), (0.34, 0.16), (0.37, 0.20), (0.37, 0.26), (0.30, 0.30), (0.25, 0.31)]
        base = revolution(smooth_profile(ring), steps(40), steps(21))
        top = [(0.20, 0.0), (0.25, 0.05), (0.29, 0.10), (0.36, 0.22), (0.42, 0.30), (0.42, 0.61)]
        capital = moved(revolution(smooth_profile(top), steps(40), steps(15)), (0.0, 3.79, 0.0))
        mesh = self.glb.mesh("column", joined(base, shaft, capital), marble)
        for number, (x, z) in enumerate((x, z) for z in (-2.3, 0.1, 2.5) for x in (-3.0, 3.0)):
            self.glb.node(name=f"column {number + 1}", mesh=mesh, translation=[x, 0.0, z])

    def _still_life(self) -> None:
        steps = self.steps
        chrome = self._material("chrome", (0.95, 0.95, 0.96), metallic=1.0, roughness=0.02)
        copper = self._material("copper", (0.93, 0.48, 0.33), metallic=1.0, roughness=0.38)
        glass, amber = self._glass("glass", (0.78, 0.94, 0.92)), self._glass("amber glass", (0.98, 0.55, 0.12))
        glaze = self._material("cobalt glaze", (0.03, 0.09, 0.42), roughness=0.08)
        self._place("chrome ball", sphere(0.46, steps(64), steps(32)), chrome, translation=[-1.72, 0.46, 1.75])
        self._place("copper ball", sphere(0.24, steps(44), steps(22)), copper, translation=[-0.98, 0.24, 2.42])
        self._place("glass ball", sphere(0.50, steps(64), steps(32)), glass, translation=[1.42, 0.50, 2.05])
        self._place("amber ball", sphere(0.20, steps(44), steps(22)), amber, translation=[0.70, 0.20, 2.75])
        vase = [
            (0.0, 0.0), (0.20, 0.0), (0.23, 0.04), (0.36, 0.32), (0.37, 0.52), (0.24, 0.80), (0.12, 0.98), (0.11, 1.08), (0.18, 1.20),
            (0.17, 1.20), (0.09, 1.08), (0.09, 0.98), (0.10, 0.9),
        ]  # fmt: skip
        self._place("vase", revolution(smooth_profile(vase), steps(56), steps(52)), glaze, translation=[2.05, 0.0, 0.55])
        enamel = self._material("red enamel", (0.62, 0.04, 0.05), roughness=0.12)
        jade = self._material("jade", (0.12, 0.46, 0.28), roughness=0.25)
        beads = [self.glb.mesh("bead", sphere(0.085, steps(28), steps(14)), material) for material in (enamel, copper, jade)]
        for number in range(17):
            # A golden angle about the plinth: even, and never in line.
            angle, radius = 2.39996 * number + 0.4, 1.75 + 0.16 * (number % 4)
            place = [radius * math.sin(angle), 0.085, radius * math.cos(angle)]
            if place[2] > -1.0 and not (abs(place[0]) > 1.2 and place[2] > 1.3):
                self.glb.node(name=f"bead {number + 1}", mesh=beads[number % 3], translation=place)

    def _camera(self) -> None:
        view = {"yfov": 0.68, "aspectRatio": 16 / 9, "znear": 0.05}
        camera = self.glb.add("cameras", {"name": "main", "type": "perspective", "perspective": view})
        eye, target = np.array([0.62, 1.86, 6.95]), np.array([0.02, 1.38, 0.0])
        z = (eye - target) / np.linalg.norm(eye - target)
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        y = np.cross(z, x)
        columns = [*x, 0.0, *y, 0.0, *z, 0.0, *eye, 1.0]
        self.glb.node(name="main", camera=camera, matrix=[round(float(value), 9) for value in columns])


def main() -> None:
    parser = argparse.ArgumentParser(description="Make scenefold's sample scene.")
    parser.add_argument("-o", "--output", type=Path, default=_SHIPPED, help="file to write (default: the shipped one)")
    parser.add_argument("--detail", type=int, default=_DEFAULT_DETAIL, help="about how many triangles (default: %(default)s)")
    arguments = parser.parse_args()
    if not 2_000 <= arguments.detail <= 20_000_000:
        parser.error("--detail lies between 2000 and 20000000")
    glb = Gallery(arguments.detail).build()
    size = glb.write(arguments.output)
    print(f"{arguments.output}: {glb.triangles} triangles, {size} bytes")
    if arguments.output == _SHIPPED and size > _SIZE_MAX:
        raise SystemExit(f"the shipped scene must stay below {_SIZE_MAX} bytes")


if __name__ == "__main__":
    main()
