"""If these failed, geometry would be lost, doubled, or placed elsewhere than the tables say."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.limits import ATOM_TRIANGLES_MAX, PAYLOAD_BYTES_MAX
from scenefold.base.location import Location
from scenefold.scene.importers import ImportPlan, plan_import, read_scene
from scenefold.scene.importers.emitters import alias_table
from scenefold.scene.importers.framing import framing_camera
from scenefold.scene.layout import DOCUMENT_LOCATION, GEOMETRY, META, TEXTURES
from scenefold.scene.payloads import decode_document, decode_tile
from scenefold.scene.sample import sample_scene_path
from scenefold.scene.tables import SceneTables, instance_groups
from unit.scene.gltf_maker import Maker, png

Store = dict[tuple[int, Location], bytes]


def put_all(plan: ImportPlan, *, crowded: bool = False) -> Store:
    """Puts everything; where the store is `crowded`, every third place is taken and the record moves on."""
    store: Store = {}
    for phase in plan.phases():
        for number, item in enumerate(phase):
            place = item.location
            if crowded and number % 3 == 0 and not item.replaces:
                place = Location.from_number(place.number ^ 1)
                plan.moved(item, place)
            assert (item.space, place) not in store and len(item.payload) <= PAYLOAD_BYTES_MAX
            store[item.space, place] = item.payload
    return store


def load(store: Store) -> SceneTables:
    document = decode_document(store[META, DOCUMENT_LOCATION])
    return SceneTables.from_payloads(document, [store.get(place) for place in document.locations()])


def flattened(tables: SceneTables, store: Store) -> np.ndarray:  # type: ignore[type-arg]
    """f64[n, 3, 3]: all triangles in the world."""
    found = []
    for instance, group in zip(*instance_groups(tables.groups, tables.instances), strict=True):
        matrix = tables.instances.matrices[instance].astype(float)
        for atom in tables.group_atoms(group, [store[GEOMETRY, place] for place in tables.groups.locations(group)]):
            found.append((atom.positions @ matrix[:, :3].T + matrix[:, 3])[atom.triangles])  # noqa: PERF401
    return np.concatenate(found)


@pytest.fixture(scope="module")
def sample() -> tuple[SceneTables, Store]:
    store = put_all(plan_import(read_scene(sample_scene_path())))
    return load(store), store


def test_the_sample_scene_is_what_it_promises(sample: tuple[SceneTables, Store]) -> None:
    tables, _ = sample
    assert sample_scene_path().stat().st_size < 2_000_000
    assert tables.document.default_camera == "main" and tables.camera() is tables.camera("main")
    assert 20_000 <= tables.document.counts["triangles"] <= 60_000 and not tables.document.not_carried
    assert len(tables.instances) > 1 and len(tables.lights) > 100 and len(tables.textures) == 2
    assert any(material.transmission == 1 for material in tables.materials)


def test_every_triangle_arrives_once(sample: tuple[SceneTables, Store]) -> None:
    tables, store = sample
    scene = read_scene(sample_scene_path())
    expected = []
    for mesh, matrix in zip(scene.placed_meshes, scene.placed_matrices, strict=True):
        for part in scene.meshes[mesh]:
            moved = part.positions @ matrix[:3, :3].T + matrix[:3, 3]
            expected.append(moved[part.triangles])
    found, wanted = flattened(tables, store), np.concatenate(expected)
    assert len(found) == len(wanted) == tables.document.counts["instanced_triangles"]

    def keys(triangles: np.ndarray) -> Counter[tuple[float, ...]]:  # type: ignore[type-arg]
        return Counter(map(tuple, np.rint(triangles.mean(axis=1) * 500).tolist()))

    # Rounding may move a centre into the next box of a half centimetre, but not many of them.
    assert (keys(found) - keys(wanted)).total() < 0.01 * len(found)


def test_the_same_file_gives_the_same_bytes(sample: tuple[SceneTables, Store]) -> None:
    assert put_all(plan_import(read_scene(sample_scene_path()))) == sample[1]


def test_tables_follow_records_that_had_to_move(sample: tuple[SceneTables, Store]) -> None:
    store = put_all(plan_import(read_scene(sample_scene_path())), crowded=True)
    tables = load(store)
    assert np.array_equal(flattened(tables, store), flattened(*sample))
    places = [place for texture in tables.textures for place in texture.tiles]
    assert [decode_tile(store[TEXTURES, place]).texture for place in places] == [0] * 25 + [1] * 25
    assert tables.document.records == sample[0].document.records
    assert tables.document.content != sample[0].document.content


def test_groups_and_atoms_keep_their_sizes_and_boxes(sample: tuple[SceneTables, Store]) -> None:
    tables, store = sample
    assert tables.groups.triangles.max() <= 12_000
    for group in range(len(tables.groups)):
        first = tables.groups.first_atom[group]
        payloads = [store[GEOMETRY, place] for place in tables.groups.locations(group)]
        for number, atom in enumerate(tables.group_atoms(group, payloads), start=first):
            assert len(atom.triangles) <= ATOM_TRIANGLES_MAX
            row = tables.groups.atoms[number]
            assert np.array_equal(atom.positions.min(axis=0), row["low"])
            assert np.array_equal(atom.positions.max(axis=0), row["high"])
            assert (row["low"] >= tables.groups.low[group]).all() and (row["high"] <= tables.groups.high[group]).all()


def test_atoms_lie_at_their_centres_and_the_world_box_holds_all(sample: tuple[SceneTables, Store]) -> None:
    tables, store = sample
    document = tables.document
    triangles = flattened(tables, store)
    assert (triangles >= document.world_low).all() and (triangles <= document.world_high).all()
    from scenefold.scene.layout import geometry_lattice

    lattice = geometry_lattice(document.lattice_low, document.lattice_high)
    baked = np.flatnonzero(tables.groups.prototypes == 0)
    rows = np.concatenate([tables.groups.atoms[tables.groups.first_atom[g] : tables.groups.first_atom[g + 1]] for g in baked])
    centres = (rows["low"].astype(float) + rows["high"]) / 2
    encoded = lattice.curve.encode(lattice.cells(centres))
    expected = [Location.from_padded(bytes(location)).number for location in encoded]
    found = [Location(row.tobytes()).number for row in rows["location"]]
    # Equal centres take the next free place; there are only few of them.
    assert all(0 <= place - centre < 10 for place, centre in zip(found, expected, strict=True))


def test_the_light_table_names_the_triangles_that_shine(sample: tuple[SceneTables, Store]) -> None:
    tables, store = sample
    lights = tables.lights
    for row in lights.rows[:: max(1, len(lights) // 50)]:
        group = int(row["group"])
        atoms = tables.group_atoms(group, [store[GEOMETRY, place] for place in tables.groups.locations(group)])
        corners = np.concatenate([atom.positions[atom.triangles] for atom in atoms])[row["triangle"]]
        material = np.concatenate([atom.materials for atom in atoms])[row["triangle"]]
        assert np.array_equal(row["corners"], corners)
        assert np.array_equal(row["emission"], np.float32(tables.materials[material].emissive))
    assert lights.probability.sum(dtype=float) == pytest.approx(1, abs=1e-6)


@given(st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=200))
def test_the_alias_table_draws_each_row_by_its_weight(weights: list[float]) -> None:
    values = np.array(weights)
    threshold, alias = alias_table(values)
    chances = threshold.astype(float)
    np.add.at(chances, alias, 1 - threshold.astype(float))
    assert np.allclose(chances / len(values), values / values.sum(), atol=1e-6)


def many(maker: Maker, count: int) -> list[list[float]]:
    """Corners of `count` small triangles."""
    centres = np.random.default_rng(3).random((count, 1, 3))
    return (centres + np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]])).reshape(-1, 3).tolist()


def test_copies_become_instances_and_mirrors_keep_their_outside(tmp_path: Path) -> None:
    maker = Maker()
    maker.add("materials", emissiveFactor=[1, 1, 1])
    mesh = maker.mesh(many(maker, 1_500), material=0)
    maker.node(mesh=mesh)
    maker.node(mesh=mesh, scale=[-1, 1, 1])
    maker.node(mesh=mesh, scale=[1, 1, 0])
    store = put_all(plan_import(read_scene(maker.write(tmp_path))))
    tables = load(store)
    assert tables.instances.prototypes.tolist() == [0, 1, 1]
    triangles = flattened(tables, store)
    assert len(triangles) == 4_500 == len(tables.lights)
    corners = tables.lights.corners.astype(float)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # All triangles of the mesh look to +z, and so does the side that shines, also of the mirrored copy.
    assert (crosses[:, 2] > 0).all() and set(tables.lights.instances.tolist()) == {0, 1, 2}


def test_baked_mirrors_keep_their_outside(tmp_path: Path) -> None:
    maker = Maker()
    normals = np.tile(np.array([0, 0, 1], "<f4"), (3, 1))
    maker.node(mesh=maker.mesh(attributes={"NORMAL": normals}), scale=[-1, 2, 3])
    store = put_all(plan_import(read_scene(maker.write(tmp_path))))
    tables = load(store)
    (atom,) = tables.group_atoms(0, [store[GEOMETRY, place] for place in tables.groups.locations(0)])
    corners = atom.positions[atom.triangles[0]]
    assert np.cross(corners[1] - corners[0], corners[2] - corners[0])[2] > 0
    assert atom.normals is not None and np.allclose(atom.normals, [0, 0, 1])


def test_attributes_stay_apart(tmp_path: Path) -> None:
    maker = Maker()
    maker.add("images", bufferView=maker.view(png()), mimeType="image/png")
    maker.add("textures", source=0)
    maker.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    uvs = {"TEXCOORD_0": np.zeros((3, 2), "<f4")}
    maker.node(mesh=maker.mesh(material=0, attributes=uvs))
    maker.node(mesh=maker.mesh(attributes=uvs))
    tables = load(put_all(plan_import(read_scene(maker.write(tmp_path)))))
    assert sorted(tables.groups.flags.tolist()) == [0, 2]


def test_equal_centres_get_places_of_their_own(tmp_path: Path) -> None:
    maker = Maker()
    ring = np.array([[1, 0, 0], [-1, 1, 0], [-1, -1, 0]])
    maker.node(mesh=maker.mesh(np.concatenate([ring] * 3_000)))
    tables = load(put_all(plan_import(read_scene(maker.write(tmp_path)))))
    assert len(tables.groups.atoms) == 3


def test_a_scene_without_a_camera_is_framed() -> None:
    low, high = np.array([-3.0, 0.0, 1.0]), np.array([5.0, 1.0, 2.0])
    camera = framing_camera(low, high)
    corners = np.array([[(low, high)[n >> axis & 1][axis] for axis in range(3)] for n in range(8)])
    seen = (corners - camera.matrix[:3, 3]) @ camera.matrix[:3, :3]
    slope = np.tan(camera.yfov / 2)
    assert (seen[:, 2] < 0).all() and (np.abs(seen[:, :2]) <= slope * -seen[:, 2:]).all()


def test_tables_that_do_not_belong_together_are_damaged_data(sample: tuple[SceneTables, Store]) -> None:
    tables, store = sample
    payloads = [store.get(place) for place in tables.document.locations()]
    for number in range(len(payloads)):
        for other in (None, payloads[number - 1]):
            with pytest.raises(DamagedData):
                SceneTables.from_payloads(tables.document, [*payloads[:number], other, *payloads[number + 1 :]])
    place = tables.groups.locations(1)[0]
    with pytest.raises(DamagedData, match="group 0"):
        tables.group_atoms(0, [store[GEOMETRY, place]])


def test_progress_ends_at_its_total() -> None:
    last: dict[str, tuple[int, int]] = {}
    list(plan_import(read_scene(sample_scene_path()), lambda phase, done, total: last.update({phase: (done, total)})).items())
    assert set(last) == {"geometry", "textures", "tables"} and all(done == total for done, total in last.values())


def test_an_empty_scene_is_refused_before_any_record(tmp_path: Path) -> None:
    maker = Maker()
    maker.node(mesh=maker.mesh(), scale=[0, 0, 0])
    with pytest.raises(LocalFault, match="empty"):
        plan_import(read_scene(maker.write(tmp_path)))
