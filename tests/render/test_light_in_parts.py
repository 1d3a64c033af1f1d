"""If this fails, the layers of an image do not fit together, or depend on who held what."""

from __future__ import annotations

import numpy as np
import pytest

from render.rig import Rendered, Rig
from render.shapes import room
from scenefold.render.layers import BESIDE

SKY = (0.1, 0.15, 0.3)


@pytest.fixture(scope="module")
def furnished() -> Rig:
    return Rig(room(), 12)


@pytest.fixture(scope="module")
def alone(furnished: Rig) -> Rendered:
    return furnished.render(sky=SKY, layers=BESIDE)


def test_all_layers_are_equal_on_any_number_of_nodes(furnished: Rig, alone: Rendered) -> None:
    together = furnished.render("bounded-radial", 3, sky=SKY, layers=BESIDE)
    assert together.passed > 0
    assert {name: layer.tobytes() for name, layer in together.layers.items()} == {
        name: layer.tobytes() for name, layer in alone.layers.items()
    }


def test_parts_of_the_light_are_the_same_light(furnished: Rig, alone: Rendered) -> None:
    plain = furnished.render(sky=SKY)
    assert alone.beauty.tobytes() == plain.beauty.tobytes() and alone.layers["depth"].tobytes() == plain.layers["depth"].tobytes()
    parts = [alone.layers[name] for name in ("emission", "direct", "indirect")]
    assert sum(parts[1:], parts[0]) == pytest.approx(alone.beauty, rel=1e-5, abs=1e-9)
    assert all(part.mean() > 0.0 for part in parts)
    shallow = furnished.render(sky=SKY, layers=BESIDE, depth=2)
    assert np.array_equal(shallow.layers["direct"], alone.layers["direct"]) and not shallow.layers["indirect"].any()
    assert not furnished.render(sky=SKY, layers=BESIDE, depth=1).layers["direct"].any()


def test_positions_lie_where_the_camera_sees_them(furnished: Rig, alone: Rendered) -> None:
    job = furnished.job("voronoi", 1)
    position, depth = alone.layers["position"], alone.layers["depth"]
    all_hit = alone.film.in_order(alone.film.rows.hits == 4)
    assert all_hit.sum() > 50
    away = np.linalg.norm(position[all_hit] - np.array(job.camera[:3]), axis=1)
    assert np.median(np.abs(away - depth[all_hit]) / depth[all_hit]) < 1e-3
    assert (np.isinf(position).any(axis=2) == np.isinf(depth)).all()
    assert ((alone.layers["object_id"] == 0) == np.isinf(depth)).all() and ((alone.layers["material_id"] == 0) == np.isinf(depth)).all()
    assert len(np.unique(alone.layers["material_id"])) > 3
