"""If this fails, the light table has other texture coordinates for a lamp than the lamp itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from scenefold.base.errors import DamagedData
from scenefold.scene.importers.plan import ImportPlan
from scenefold.scene.importers.source import MeshPart, SourceScene, SourceTexture
from scenefold.scene.payloads.document import content_hash
from scenefold.scene.payloads.light_table import NO_MATERIAL, encode_lights
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.texture_uses import TextureUse
from scenefold.scene.tables import SceneTables

CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], np.float32)
UVS, UVS2 = np.array([[0, 0], [1, 0], [0, 1]], np.float32), np.array([[5, 6], [7, 8], [9, 10]], np.float32)
MIRROR, ASIDE = np.diag([-1.0, 1.0, 1.0, 1.0]), np.diag([1.0, 1.0, 2.0, 1.0])


def lamps(*materials: Material) -> SourceScene:
    """A triangle of each material."""
    texture = SourceTexture("t", 1, 1, True, False, lambda: np.full((1, 1, 4), 255, np.uint8))
    parts = [MeshPart(CORNERS, None, UVS, np.array([[0, 1, 2]], np.uint32), number, uvs2=UVS2) for number in range(len(materials))]
    return SourceScene("lamps", [parts], np.zeros(1, np.int64), np.eye(4)[None], list(materials), [texture])


def read(source: SourceScene, change: Callable[[np.ndarray], None] | None = None) -> SceneTables:  # type: ignore[type-arg]
    plan = ImportPlan(source)
    records = {(item.space, item.location): item.payload for item in plan.items()}
    document = plan.document()
    pages = [records[place] for place in document.locations()]
    tables = SceneTables.from_payloads(document, pages)
    if change is None:
        return tables
    at = document.locations().index(next(key for key in document.locations() if records[key][:4] == b"sflt"))
    rows = tables.lights.rows.copy()
    change(rows)
    pages[at : at + 1] = encode_lights(rows)
    return SceneTables.from_payloads(replace(document, content=content_hash(pages)), pages)


BARE = Material(emissive=(1.0, 1.0, 1.0))
FIRST = Material(emissive=(1.0, 2.0, 3.0), emissive_texture=TextureUse(0), emissive_mean=(0.5, 0.5, 0.25))
SECOND = replace(FIRST, emissive_texture=TextureUse(0, 1))


def test_each_row_has_the_coordinates_that_its_texture_reads() -> None:
    lights = read(lamps(BARE, FIRST, SECOND)).lights
    assert lights.materials.tolist() == [NO_MATERIAL, 1, 2]
    assert np.array_equal(lights.coordinates, [np.zeros((3, 2)), UVS, UVS2])
    assert np.array_equal(lights.emission[1], np.float32([0.5, 1.0, 0.75]))


def test_what_has_no_coordinates_is_read_at_their_beginning() -> None:
    source = lamps(FIRST)
    bare = replace(source.meshes[0][0], uvs=None, uvs2=None)
    assert not read(replace(source, meshes=[[bare]])).lights.coordinates.any()


@pytest.mark.parametrize("matrix", [ASIDE, MIRROR], ids=["aside", "mirrored"])
def test_coordinates_stay_with_their_corners_in_an_instance(matrix: np.ndarray) -> None:  # type: ignore[type-arg]
    source, count = lamps(FIRST), 1500
    shifts = np.arange(count)[:, None, None] * np.array([0, 0, 0.01])
    # Copies with few triangles would be baked.
    positions, triangles = (CORNERS + shifts).reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)
    part = replace(source.meshes[0][0], positions=positions, uvs=np.tile(UVS, (count, 1)), uvs2=None, triangles=triangles)
    placed = {"placed_meshes": np.zeros(2, np.int64), "placed_matrices": np.stack([np.eye(4), matrix])}
    many = replace(source, meshes=[[part]], **placed)
    lights = read(many).lights
    assert set(lights.instances.tolist()) == {1, 2}
    # Whatever is done to the corners, u runs along x and v along y.
    assert np.allclose(np.abs(lights.corners[..., 0]), 2 * lights.coordinates[..., 0])
    assert np.allclose(lights.corners[..., 1], 3 * lights.coordinates[..., 1])


def test_a_scene_without_emissive_textures_stays_as_older_programs_read_it() -> None:
    lights = read(lamps(BARE)).lights
    assert encode_lights(lights.rows)[0][4] == 1 and encode_lights(read(lamps(FIRST)).lights.rows)[0][4] == 2


@pytest.mark.parametrize("material", [0, 7])
def test_a_row_that_names_no_emissive_texture_is_damage(material: int) -> None:
    def change(rows: np.ndarray) -> None:  # type: ignore[type-arg]
        rows["material"][1] = material

    with pytest.raises(DamagedData, match="no emissive texture"):
        read(lamps(BARE, FIRST), change)
