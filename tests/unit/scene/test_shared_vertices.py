"""If these failed, primitives that share one array of vertices would each cost the whole array, or get vertices of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.scene.importers import read_scene
from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_vertices import used_by
from unit.scene.gltf_maker import Maker

VERTICES, PRIMITIVES = 5_000, 30


def sharing(maker: Maker, corners: list[np.ndarray[Any, np.dtype[np.uint32]]]) -> None:
    """One mesh of primitives over one array of positions, normals, coordinates and colours."""
    random = np.random.default_rng(3)
    attributes = {
        "POSITION": maker.accessor(random.random((VERTICES, 3)).astype("<f4")),
        "NORMAL": maker.accessor(random.random((VERTICES, 3)).astype("<f4")),
        "COLOR_0": maker.accessor(random.integers(0, 255, (VERTICES, 4), np.uint8), normalized=True),
    }
    primitives = [{"attributes": attributes, "indices": maker.accessor(each)} for each in corners]
    maker.node(mesh=maker.add("meshes", primitives=primitives))


def test_a_primitive_costs_the_vertices_that_it_uses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maker = Maker()
    sharing(maker, [np.arange(3 * number, 3 * number + 3, dtype=np.uint32) for number in range(PRIMITIVES)])
    converted: list[int] = []
    real = Accessors._raw

    def counted(self: Accessors, *arguments: Any) -> Any:
        found = real(self, *arguments)
        converted.append(len(found))
        return found

    monkeypatch.setattr(Accessors, "_raw", counted)
    (parts,) = read_scene(maker.write(tmp_path)).meshes
    assert [len(part.positions) for part in parts] == [3] * PRIMITIVES
    assert sum(converted) == PRIMITIVES * (3 + 3 * 3), "indices, and three attributes of three vertices"


def test_each_corner_is_where_the_file_says(tmp_path: Path) -> None:
    random = np.random.default_rng(4)
    maker = Maker()
    corners = [random.integers(0, VERTICES, 3 * count).astype(np.uint32) for count in (1, 40, 3_000, 20_000)]
    sharing(maker, corners)
    path = maker.write(tmp_path)
    (parts,) = read_scene(path).meshes
    accessors = Accessors(GltfFile(path))
    positions, normals, colors = accessors.floats(0, "VEC3"), accessors.floats(1, "VEC3"), accessors.shares(2, ("VEC4",))
    for part, named in zip(parts, corners, strict=True):
        assert part.normals is not None and part.colors is not None
        assert np.array_equal(part.positions[part.triangles.ravel()], positions[named])
        assert np.array_equal(part.normals[part.triangles.ravel()], normals[named])
        assert np.array_equal(part.colors[part.triangles.ravel()], colors[named])
        assert len(part.positions) == len(np.unique(named))


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 900))
@settings(max_examples=60, deadline=None)
def test_vertices_keep_their_order_and_triangles_their_corners(seed: int, triangles: int, count: int) -> None:
    named = np.random.default_rng(seed).integers(0, count, (triangles, 3)).astype(np.uint32)
    vertices, numbered = used_by(named, count)
    rows = np.arange(count) if vertices.rows is None else vertices.rows
    assert np.array_equal(rows, np.unique(named)) and len(vertices) == len(rows)
    assert numbered.dtype == np.uint32 and np.array_equal(rows[numbered], named)
    kept = rows % 2 == 0
    assert np.array_equal(vertices.among(kept).rows, rows[kept])


@pytest.mark.parametrize("rows", [[], [0], [1, 4, 5, 9], [9], list(range(10))])
def test_rows_of_an_accessor_with_changed_places_are_those_of_the_whole(rows: list[int], tmp_path: Path) -> None:
    maker = Maker()
    values = np.arange(40, dtype="<u2").reshape(10, 4)
    places, new = np.array([1, 5, 8], np.uint8), np.array([[60_000] * 4, [50_000] * 4, [40_000] * 4], "<u2")
    sparse = {"count": 3, "indices": {"bufferView": maker.view(places.tobytes()), "componentType": 5121}}
    sparse["values"] = {"bufferView": maker.view(new.tobytes())}
    maker.accessor(values, normalized=True, sparse=sparse)
    maker.node(mesh=maker.mesh())
    accessors, chosen = Accessors(GltfFile(maker.write(tmp_path))), np.array(rows, np.intp)
    whole = accessors.floats(0, "VEC4")
    assert whole[5, 0] > 0.7
    assert np.array_equal(accessors.floats(0, "VEC4", chosen), whole[chosen])
    assert np.array_equal(accessors.shares(0, ("VEC4",), chosen), accessors.shares(0, ("VEC4",))[chosen])
    assert np.array_equal(accessors.numbers(0, "VEC4", chosen), accessors.numbers(0, "VEC4")[chosen])
