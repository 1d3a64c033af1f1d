"""If this fails, the image depends on who held what: on the number of nodes, their cells, the batches, or the camera."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from render.rig import Rendered, Rig
from render.shapes import grid, looking, moved, room, scene
from scenefold.base.rays import KIND_BOUNCE, KIND_CAMERA, PATH_RAY, PDF_DELTA
from scenefold.partition import Partition
from scenefold.render.image_files import image_sha256
from scenefold.render.lens import Lens
from scenefold.render.renderers.embree import filter_kernels
from scenefold.render.renderers.embree.library import Device
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.materials import Material
from unit.render.lanes_probe_kernels import probed

SKY = (0.1, 0.15, 0.3)
ALGORITHMS = ("voronoi", "bounded-radial")


def same(left: Rendered, right: Rendered) -> bool:
    """Every path's radiance and features, and the image."""
    equal = np.array_equal(left.radiance, right.radiance) and np.array_equal(left.aovs, right.aovs)
    assert equal == (image_sha256(left.beauty) == image_sha256(right.beauty) and left.aovs.tobytes() == right.aovs.tobytes())
    return equal


@functools.cache
def furnished(scale: float = 1.0) -> Rig:
    return Rig(room(scale), 12)


@functools.cache
def alone(scale: float = 1.0) -> Rendered:
    return furnished(scale).render(nodes=1, sky=SKY)


@pytest.mark.parametrize("nodes", [1, 2, 3, 5, 16])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_any_number_of_nodes_gives_the_same_image(algorithm: str, nodes: int) -> None:
    together = furnished().render(algorithm, nodes, sky=SKY)
    assert same(together, alone())
    assert together.counters[1:].tolist() == [0, 0], "nothing was lost or clamped"
    if nodes > 1:
        assert together.passed > 0.3 * len(together.radiance)
        assert min(together.held) < len(furnished().tables.groups), "nodes hold parts, or this test shows nothing"


def test_the_image_is_no_accident_of_black() -> None:
    image = alone()
    assert 0.1 < image.beauty.mean() < 1
    assert len(np.unique(image.beauty)) > image.beauty.size // 2
    assert (image.aovs[:, 7] == 1).mean() > 0.5


@pytest.mark.parametrize("piece", [1, 7, 1000])
def test_batches_and_their_order_are_no_matter(piece: int) -> None:
    rig = furnished()
    job = rig.job("voronoi", 3, sky=SKY, samples=1)
    assert same(rig.run(job, np.random.default_rng(piece), piece), rig.run(job))


def test_another_seed_gives_another_image() -> None:
    assert not same(furnished().render(sky=SKY, seed=2), alone())


def test_samples_go_on_where_fewer_ended() -> None:
    few, many = furnished().render(sky=SKY, samples=2), alone()
    assert np.array_equal(few.radiance, many.radiance[: len(few.radiance)])


@pytest.mark.parametrize("shift", [0.0, 1e-9, 1e-7, 0.01])
def test_cells_may_lie_anywhere(shift: float) -> None:
    """Hulls through the middle of the scene, along its walls, and a hair beside: the same bits."""
    rig = furnished()
    centroids = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * 0.5 + shift
    assert same(rig.render(nodes=8, partition=Partition.voronoi(centroids), sky=SKY), alone())
    flat = np.array([[0.0, 1.0 - 0.5, 0.0], [0.0, 1.0 + 0.5, 0.0], [0.0, -1.5, 0.0]]) + shift
    assert same(rig.render(nodes=3, partition=Partition.voronoi(flat), sky=SKY), alone())


def test_cells_may_be_empty_or_coincide() -> None:
    rig = furnished()
    centroids = np.array([[0, 0, 0], [0, 0, 0], [1e-9, 0, 0], [50.0, 0, 0], [0, 0.5, 0]])
    assert same(rig.render(nodes=5, partition=Partition.voronoi(centroids), sky=SKY), alone())


CAMERAS: dict[str, Camera] = {
    "outside": looking((3.0, 2.0, 5.0), (0, 0, 0), yfov=0.5),
    "inside": looking((0.1, 0.2, 0.3), (-0.3, 0.0, -1.0), yfov=1.2),
    "on a hull": looking((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), yfov=1.0),
    "in a face of the box": looking((0.0, 0.0, 1.0), (0.0, 0.1, -1.0), yfov=1.0),
    "turned away": looking((0.0, 0.0, 5.0), (0.0, 0.0, 9.0), yfov=0.6),
    "far away": looking((0.0, 0.0, 1e6), (0.0, 0.0, 0.0), yfov=2.4e-6),
    "orthographic": looking((0.5, 0.3, 4.0), (0.0, 0.0, 0.0), kind="orthographic", ymag=1.1),
    "orthographic along an axis": looking((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), kind="orthographic", ymag=1.1),
    "orthographic, far away": looking((0.0, 0.0, 1e6), (0.0, 0.0, 0.0), kind="orthographic", ymag=1.1),
    "from above": looking((0.0, 0.9, 0.0), (0.0, -1.0, 0.0), yfov=1.5),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_anywhere(name: str) -> None:
    rig = Rig(room(camera=CAMERAS[name]), 12)
    reference = rig.render(sky=SKY)
    hulls = Partition.voronoi(np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * 0.5)
    assert same(rig.render(nodes=8, partition=hulls, sky=SKY), reference)
    assert same(rig.render("bounded-radial", 5, sky=SKY), reference)
    if name == "turned away":
        assert np.abs(reference.beauty - np.array(SKY)).max() < 1e-6, "nothing but sky"
        assert np.isinf(reference.layers["depth"]).all()
    else:
        assert (reference.aovs[:, 7] == 1).any()


@pytest.mark.parametrize("name", ["", "orthographic, far away"])
def test_a_lens(name: str) -> None:
    rig = Rig(room(camera=CAMERAS[name]), 12) if name else furnished()
    blurred = rig.render(sky=SKY, lens=Lens(0.1, 3.0))
    assert same(rig.render("bounded-radial", 2, sky=SKY, lens=Lens(0.1, 3.0)), blurred)
    assert not same(blurred, rig.render(sky=SKY))


def test_distance_is_no_matter_for_an_orthographic_camera() -> None:
    near, far = (Rig(room(camera=CAMERAS[name])).render(sky=SKY) for name in ("orthographic along an axis", "orthographic, far away"))
    assert np.array_equal(near.radiance, far.radiance)
    hit = np.isfinite(near.layers["depth"])
    assert hit.any()
    assert (far.layers["depth"][hit] > 100).all()
    assert np.isinf(far.layers["depth"][~hit]).all()


@pytest.mark.parametrize("scale", [1e-5, 1e-3, 1e5])
def test_scenes_of_any_size(scale: float) -> None:
    """Light of punctual lamps is scaled along, so that the picture is the same but for rounding."""
    image = alone(scale)
    assert same(furnished(scale).render("voronoi", 5, sky=SKY), image)
    assert same(furnished(scale).render("bounded-radial", 3, sky=SKY), image)
    different = np.abs(image.beauty - alone().beauty).max(axis=2) > 0.02 * alone().beauty.max(axis=2) + 1e-3
    assert different.mean() < 0.02, "a few paths meet an edge on its other side"


@pytest.mark.parametrize("shift", [100.0, 1e4])
def test_scenes_far_from_the_origin(shift: float) -> None:
    rig = Rig(room(shift=(shift, shift / 3, -shift)), 12)
    image = rig.render(sky=SKY)
    assert same(rig.render("voronoi", 5, sky=SKY), image)
    assert same(rig.render("bounded-radial", 3, sky=SKY), image)
    assert image.beauty.mean() == pytest.approx(float(alone().beauty.mean()), rel=0.02)


# Equal distances -----------------------------------------------------------------------------------------

COLORS = [(0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9), (0.9, 0.9, 0.1)]


def doubled(cuts: int) -> Rig:
    """The same triangles twice in the world, in groups of their own, and twice more by instances in the same place."""
    materials = [Material(base_color=(*color, 1.0)) for color in COLORS]
    square = ((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    meshes = [[grid(*square, cuts, 1)], [grid(*square, cuts, 0, textured=True)], [grid(*square, cuts, 2)], [grid(*square, cuts, 3)]]
    placed = [(0, moved(0, 0, 0)), (1, moved(0, 0, 0)), *[(2, moved(0, 0, 0))] * 2, *[(3, moved(0, 0, 0))] * 2]
    return Rig(scene(meshes, materials, [looking((0, 0, 3), (0, 0, 0), yfov=0.7)], placed=placed), 8)


def test_of_equal_distances_the_lowest_number_wins_whoever_holds_it() -> None:
    rig = doubled(6)
    reference = rig.render(sky=SKY)
    seen = np.unique(reference.aovs[reference.aovs[:, 7] == 1][:, :3] / 2**24, axis=0)
    assert len(seen) == 1, "instance 0 is before all instances, and the lower group before the higher"
    assert rig.tables.instances.prototypes.tolist() == [0, 1, 1, 2, 2]
    for nodes in (2, 5, 9):
        for algorithm in ALGORITHMS:
            together = rig.render(algorithm, nodes, sky=SKY)
            assert same(together, reference)
            assert min(together.held) < len(rig.tables.groups)


def test_instances_in_one_place_are_told_apart_by_number() -> None:
    materials = [Material(base_color=(*color, 1.0)) for color in COLORS]
    square = ((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    placed = [*[(1, moved(0, 0, 0))] * 2, *[(0, moved(0, 0, 0))] * 3]
    rig = Rig(scene([[grid(*square, 4, 1)], [grid(*square, 4, 3)]], materials, [looking((0, 0, 3), (0, 0, 0), yfov=0.7)], placed=placed), 8)
    reference = rig.render(sky=SKY)
    hits = reference.aovs[reference.aovs[:, 7] == 1]
    assert np.abs(hits[:, :3] / 2**24 - COLORS[3]).max() < 1e-6
    for nodes in (2, 5):
        assert same(rig.render("voronoi", nodes, sky=SKY), reference)


# Single rays ---------------------------------------------------------------------------------------------


def straight_rays(origins: npt.NDArray[np.float64], codes: list[tuple[int, int]]) -> npt.NDArray[np.uint32]:
    """Camera rays of full throughput from each place in each direction."""
    rays = np.zeros((len(origins), len(codes)), PATH_RAY)
    rays["origin"], rays["direction"] = origins[:, None, :], np.array(codes)[None]
    rays["pdf"], rays["kind"] = PDF_DELTA, KIND_CAMERA
    rays["throughput"] = np.frombuffer((4096 | 4096 << 13 | 4096 << 26 | 257 << 39).to_bytes(6, "little"), np.uint8)
    flat = rays.reshape(-1)
    flat["path"] = np.arange(len(flat))
    return flat.view(np.uint32).reshape(-1, 9)


def axis_codes() -> list[tuple[int, int]]:
    """The codes next to all six axes: an axis itself lies between two codes."""
    middle, end = 2**31, 2**32 - 1
    edges = (0, end, middle, middle - 1)
    return [(u, v) for u in edges for v in edges]


@pytest.mark.parametrize("kind", [KIND_CAMERA, KIND_BOUNCE])
def test_rays_along_hulls_axes_and_walls(kind: int) -> None:
    rig = furnished()
    steps = np.array([-1.0, -0.5, -1e-7, 0.0, 0.25, 1.0])
    places = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)
    rays = straight_rays(places, axis_codes())
    rays[:, 8] |= np.uint32(kind << 8)
    reference = rig.fly(rig.job("voronoi", 1, sky=SKY), rays)
    assert reference.radiance.any()
    half = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * 0.5
    for centroids in (half, half[:2], half[:4], np.array([[-1.0, 0, 0], [1, 0, 0], [0, 0, 0]])):
        partition = Partition.voronoi(centroids)
        sums = rig.fly(rig.job("voronoi", partition.nodes, partition, sky=SKY), rays)
        assert np.array_equal(sums.radiance, reference.radiance)
        assert np.array_equal(sums.aovs, reference.aovs)
    sums = rig.fly(rig.job("bounded-radial", 5, sky=SKY), rays)
    assert np.array_equal(sums.radiance, reference.radiance)


@pytest.mark.parametrize("spread", [0.0, 1e-7])
def test_rays_from_lattice_points_to_lattice_points(spread: float) -> None:
    """They graze edges and corners of triangles, of boxes of trees and of cells, all at once: what a tree cuts off there
    must not depend on the tree."""
    rig, random = furnished(), np.random.default_rng(4)
    origins, targets = random.integers(-8, 9, (2, 40_000, 3)) / 8
    ways = targets - origins + random.normal(size=origins.shape) * spread
    origins, ways = (values[np.abs(ways).max(axis=1) > 0.1] for values in (origins, ways))
    rays = straight_rays(origins, [(0, 0)])
    rays[:, 3:5] = probed("to_direction_code", *ways.T)[:2].T
    reference = rig.fly(rig.job("voronoi", 1, sky=SKY), rays)
    centroids = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * 0.5
    for partition in (Partition.voronoi(centroids), rig.job("voronoi", 7).partition, rig.job("bounded-radial", 5).partition):
        sums = rig.fly(rig.job("voronoi", partition.nodes, partition, sky=SKY), rays)
        assert np.array_equal(sums.radiance, reference.radiance)
        assert np.array_equal(sums.aovs, reference.aovs)


def test_rays_with_any_bits_end() -> None:
    """Rays of a faulty peer: no crash, no endless flight, sums that stay whole numbers."""
    rig = furnished()
    random = np.random.default_rng(8)
    rays = random.integers(0, 2**32, (4000, 9), np.uint32)
    rays[:, 8] = (rays[:, 8] & 0xFFFFF8FF) | (random.integers(0, 3, len(rays)).astype(np.uint32) << 8)
    rays[:, 7] = (rays[:, 7] & 0xFFFF) | (np.arange(len(rays), dtype=np.uint32) << 16)
    rays[:2000, :3] = random.uniform(-1, 1, (2000, 3)).astype(np.float32).view(np.uint32)
    sums = rig.fly(rig.job("voronoi", 3, sky=SKY), rays)
    assert (sums.radiance >= 0).all()


@pytest.mark.parametrize("make", [furnished, lambda: doubled(6)], ids=["furnished", "doubled"])
def test_what_is_tested_after_the_search_is_what_would_be_tested_within(make: Callable[[], Rig], monkeypatch: pytest.MonkeyPatch) -> None:
    quick = make().render(sky=SKY)
    add = Device.add_triangles
    # To be see-through is what has the quick filters test every candidate at once.
    monkeypatch.setattr(Device, "add_triangles", lambda *args: add(*args[:5], 1))
    assert same(make().render(sky=SKY), quick)
    _, shadow, *exact = filter_kernels.FILTERS
    monkeypatch.setattr(filter_kernels, "FILTERS", (exact[0], shadow, *exact))
    assert same(make().render(sky=SKY), quick)
