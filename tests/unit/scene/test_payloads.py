"""If these failed, a scene's tables would change on their way, or a damaged one would be believed."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.limits import PAYLOAD_BYTES_MAX, TEXTURE_TILE_SIDE
from scenefold.base.location import Location
from scenefold.scene.layout import SPACES, item_location
from scenefold.scene.payloads.cameras import Camera, decode_cameras, encode_cameras
from scenefold.scene.payloads.document import COUNTS, TABLES, SceneDocument, content_hash, decode_document, encode_document
from scenefold.scene.payloads.groups import ATOM_ROW, GROUP_ROW, decode_groups, encode_groups, join_groups, page_bounds
from scenefold.scene.payloads.instances import INSTANCE_ROW, INSTANCES_OF_A_PAGE, decode_instances, encode_instances
from scenefold.scene.payloads.light_table import decode_lights, encode_lights, join_lights, light_rows, lights_of_a_page
from scenefold.scene.payloads.materials import Material, decode_materials, encode_materials
from scenefold.scene.payloads.punctual import PunctualLight, decode_punctual, encode_punctual
from scenefold.scene.payloads.textures import Texture, encode_textures, join_textures
from scenefold.scene.payloads.tiles import decode_tile, encode_tile


def group_tables(sizes: list[int]) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    groups, atoms = np.zeros(len(sizes), GROUP_ROW), np.zeros(sum(sizes), ATOM_ROW)
    atoms["triangles"] = np.arange(len(atoms)) % 999 + 1
    atoms["location"] = np.array([item_location(number) for number in range(len(atoms))], "V20")
    atoms["high"] = 1
    groups["atoms"], groups["high"], groups["flags"] = sizes, 1, 3
    ends = np.cumsum(sizes)
    groups["triangles"] = [atoms["triangles"][end - size : end].sum() for size, end in zip(sizes, ends, strict=True)]
    return groups, atoms


def document(**changes: object) -> SceneDocument:
    fields: dict[str, object] = {
        "source": "room.glb", "world_low": np.zeros(3), "world_high": np.ones(3), "lattice_low": np.zeros(3),
        "lattice_high": np.ones(3), "counts": dict.fromkeys(COUNTS, 3),
        "pages": {name: (item_location(1), item_location(2)) for name in TABLES}, "default_camera": "main",
        "content": bytes(32), "records": bytes(32), "not_carried": ("normal maps (3)",),
    }  # fmt: skip
    return SceneDocument(**(fields | changes))  # type: ignore[arg-type]


@given(st.lists(st.integers(1, 40), min_size=1, max_size=300))
@settings(max_examples=20, deadline=None)
def test_group_pages_join_to_the_table(sizes: list[int]) -> None:
    groups, atoms = group_tables(sizes)
    ends = [0, *np.cumsum(sizes).tolist()]
    bounds = page_bounds(sizes)
    pages = [encode_groups(a, groups[a:b], atoms[ends[a] : ends[b]]) for a, b in pairwise(bounds)]
    assert max(map(len, pages)) <= PAYLOAD_BYTES_MAX
    table = join_groups([decode_groups(page) for page in pages])
    assert np.array_equal(table.triangles, groups["triangles"]) and table.first_atom.tolist() == ends
    for group in range(len(sizes)):
        assert table.locations(group) == [item_location(number) for number in range(ends[group], ends[group + 1])]


def test_tiles_and_textures_come_back() -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (TEXTURE_TILE_SIDE, 77, 4)).astype(np.uint8)
    tile = decode_tile(encode_tile(3, 9, pixels))
    assert (tile.texture, tile.tile) == (3, 9) and np.array_equal(tile.pixels, pixels) and not tile.pixels.flags.writeable
    sizes = [(1, 1), (8_000, 8_000), (121, 240)]
    heads = []
    for number, (width, height) in enumerate(sizes):
        shape = Texture(number, f"t{number}", width, height, True, False, ())
        tiles = tuple(item_location(at) for at in range(shape.columns * shape.rows))
        heads.append(Texture(number, f"t{number}", width, height, True, False, tiles))
    assert join_textures(encode_textures(heads)) == heads
    assert heads[2].tile_at(120, 119) == 1 and heads[2].tile_box(3) == (120, 120, 121, 240)
    with pytest.raises(DamagedData, match="tiles"):
        join_textures(encode_textures([Texture(0, "", 500, 500, True, False, heads[0].tiles)]))


def test_cameras_and_punctual_lights_come_back() -> None:
    matrix = np.eye(4)
    matrix[:3, 3] = (1, 2, 3)
    cameras = [Camera("a", matrix, yfov=0.5, aspect=1.5, near=0.1), Camera("b", matrix, "orthographic", ymag=2.0)]
    (page,) = encode_cameras(cameras)
    decoded = decode_cameras(page)[1]
    assert [camera.name for camera in decoded] == ["a", "b"] and decoded[1].kind == "orthographic"
    assert np.array_equal(decoded[0].matrix, matrix) and decoded[0].yfov == 0.5
    light = PunctualLight(name="sun", kind="directional", color=(1.0, 2.0, 3.0), direction=(0.0, -1.0, 0.0))
    (page,) = encode_punctual([light])
    assert decode_punctual(page) == (0, [light])


@pytest.mark.parametrize("spoil", ["mirror", "nan", "scale", "yfov"])
def test_a_camera_inside_out_is_damaged_data(spoil: str) -> None:
    matrix, yfov = np.eye(4), 0.5
    if spoil == "yfov":
        yfov = math.pi
    matrix[0, 0] = {"mirror": -1.0, "nan": math.inf, "scale": 2.0, "yfov": 1.0}[spoil]
    with pytest.raises(DamagedData):
        decode_cameras(encode_cameras([Camera("c", matrix, yfov=yfov)])[0])


def test_the_document_comes_back_and_is_strict() -> None:
    decoded = decode_document(encode_document(document()))
    assert decoded.pages == document().pages and decoded.counts == document().counts
    assert decoded.not_carried == ("normal maps (3)",) and np.array_equal(decoded.world_high, np.ones(3))
    assert len(decoded.locations()) == 2 * len(TABLES)
    for changes in ({"content": b"short"}, {"world_low": np.ones(3)}):
        with pytest.raises(DamagedData):
            decode_document(encode_document(document(**changes)))


def test_the_content_hash_tells_cuts_apart() -> None:
    assert content_hash([b"ab", b"c"]) != content_hash([b"a", b"bc"])


def sample_pages() -> list[tuple[str, bytes]]:
    groups, atoms = group_tables([2, 3])
    instances, lights, mapped = np.zeros(3, INSTANCE_ROW), light_rows(2), light_rows(2)
    instances["matrix"] = np.eye(4)[:3]
    lights["probability"] = mapped["probability"] = 0.5
    mapped["material"][1] = 0
    return [
        ("groups", encode_groups(0, groups, atoms)),
        ("instances", encode_instances(0, instances)),
        ("lights", encode_lights(lights)[0]),
        ("mapped lights", encode_lights(mapped)[0]),
        ("materials", encode_materials([Material(name="m")])[0]),
        ("cameras", encode_cameras([Camera("c", np.eye(4))])[0]),
        ("punctual", encode_punctual([PunctualLight(kind="point", color=(1.0, 1.0, 1.0))])[0]),
        ("tiles", encode_tile(0, 0, np.zeros((2, 3, 4), np.uint8))),
        ("textures", encode_textures([Texture(0, "t", 2, 2, True, False, (item_location(0),))])[0]),
        ("document", encode_document(document())),
    ]


DECODERS = {
    "groups": decode_groups, "instances": decode_instances, "lights": decode_lights, "mapped lights": decode_lights, "materials": decode_materials,
    "cameras": decode_cameras, "punctual": decode_punctual, "tiles": decode_tile,
    "textures": lambda payload: join_textures([payload]), "document": decode_document,
}  # fmt: skip


@pytest.mark.parametrize(("name", "payload"), sample_pages(), ids=lambda value: value if isinstance(value, str) else "")
@given(data=st.data())
@settings(max_examples=80, deadline=None)
def test_changed_or_cut_payloads_decode_or_are_damaged_data(name: str, payload: bytes, data: st.DataObject) -> None:
    DECODERS[name](payload)
    changed = bytearray(payload)
    for _ in range(data.draw(st.integers(1, 3))):
        changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
    with np.errstate(all="ignore"):
        for damaged in (bytes(changed), bytes(changed[: data.draw(st.integers(0, len(changed)))])):
            try:
                DECODERS[name](damaged)
            except DamagedData:
                continue
    with pytest.raises(DamagedData):
        DECODERS[name](payload + b"\0")


@pytest.mark.parametrize("entry", [np.zeros(3), np.array([0.0, 1.0, 1e-13])])
def test_an_instance_that_no_ray_can_be_carried_into_is_damaged_data(entry: np.ndarray) -> None:  # type: ignore[type-arg]
    rows = np.zeros(2, INSTANCE_ROW)
    rows["matrix"] = np.eye(4)[:3] * 1e-6
    assert len(decode_instances(encode_instances(0, rows))) == 2
    rows["matrix"][1, 0, :3] = entry
    rows["matrix"][1, 1, :3] = [0.0, 1.0, 0.0]
    with pytest.raises(DamagedData, match="without an inverse"):
        decode_instances(encode_instances(0, rows))


def test_pages_fit_a_record() -> None:
    assert len(encode_instances(0, np.zeros(INSTANCES_OF_A_PAGE, INSTANCE_ROW))) <= PAYLOAD_BYTES_MAX


@pytest.mark.parametrize("mapped", [False, True])
def test_lights_come_back_page_by_page(mapped: bool) -> None:
    rows = light_rows(lights_of_a_page(mapped) + 1)
    rows["triangle"] = np.arange(len(rows))
    if mapped:
        rows["material"][-1], rows["coordinates"][-1] = 7, [[0, 1], [2, 3], [4, 5]]
    pages = encode_lights(rows)
    assert len(pages) == 2 and all(len(page) <= PAYLOAD_BYTES_MAX and page[4] == 1 + mapped for page in pages)
    found = [decode_lights(page) for page in pages]
    assert [page.first for page in found] == [0, len(rows) - 1]
    assert np.array_equal(join_lights(found).rows, rows)


def test_lists_spread_over_the_line() -> None:
    assert item_location(0) == Location(bytes(20))
    assert item_location(1).number == 1 << 159 and item_location(2).number == 1 << 158
    places = sorted(item_location(number).number for number in range(1_024))
    assert {after - before for before, after in pairwise(places)} == {1 << 150}
    assert len({space.id for space in SPACES}) == len(SPACES)
