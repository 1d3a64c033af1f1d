"""If this fails, renderers that are compared by their speed with diffuse surfaces do not render the same: their images differ."""

from __future__ import annotations

from dataclasses import replace

import pytest

from plain_surfaces import all_diffuse
from render.rig import Rig
from render.shapes import ball, looking, scene
from scenefold.partition import Partition
from scenefold.render.arrays import F64
from scenefold.render.contract import HeldScene
from scenefold.scene.payloads.materials import Material

SHINY = Material(base_color=(0.25, 0.5, 0.0, 1.0), roughness=0.2, metallic=0.5, clearcoat=1.0, clearcoat_roughness=0.1)


class DiffuseRig(Rig):
    """A scene of which everything is made diffuse."""

    def held(self, partition: Partition, me: int) -> HeldScene:
        return all_diffuse(super().held(partition, me))


def given_back(material: Material) -> F64:
    """float64[3]: the mean share of a white sky's light, by a ball with smooth normals."""
    eye = looking((0, 0, 5), (0, 0, 0), kind="orthographic", ymag=1.05)
    rig = DiffuseRig(scene([[ball((0, 0, 0), 1.0, 40, 0, smooth=True)]], [material], [eye]), 200)
    image = rig.render("voronoi", 1, width=32, height=32, samples=64, sky=(1.0, 1.0, 1.0))
    hit = image.aovs[:, 7] == 1
    mean: F64 = image.radiance[hit].mean(axis=0) / 2**32
    return mean


def test_a_surface_gives_back_its_base_colour_and_nothing_of_a_dielectric() -> None:
    assert given_back(SHINY) == pytest.approx([0.25, 0.5, 0.0], abs=0.002)


def test_not_even_at_grazing_angles() -> None:
    assert given_back(replace(SHINY, base_color=(0.0, 0.0, 0.0, 1.0), metallic=0.0)).max() == 0.0
