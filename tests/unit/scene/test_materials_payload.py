"""If these failed, surfaces would change on their way through the store, or pages of an earlier version could not be read."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.scene.payloads.materials import (
    TEXTURE_SLOTS,
    AlphaMode,
    Material,
    TextureUse,
    Wrap,
    decode_materials,
    encode_materials,
)
from scenefold.scene.payloads.texture_uses import Minify
from scenefold.scene.payloads.values import decode_page, encode_page, encode_pages
from scenefold.wire import pack_value, unpack_value

unit = st.floats(0, 1)
colour = st.tuples(unit, unit, unit)
number = st.floats(-1e6, 1e6)
uses = st.builds(
    TextureUse,
    texture=st.integers(0, 2**31),
    uv_set=st.integers(0, 1),
    wrap_s=st.sampled_from(Wrap),
    wrap_t=st.sampled_from(Wrap),
    nearest=st.booleans(),
    transform=st.tuples(*[number] * 6),
)
materials = st.builds(
    Material,
    name=st.text(max_size=20),
    base_color=st.tuples(unit, unit, unit, unit),
    metallic=unit,
    roughness=unit,
    normal_scale=number,
    occlusion_strength=unit,
    emissive=st.tuples(*[st.floats(0, 1e6)] * 3),
    emissive_mean=colour,
    transmission=unit,
    ior=st.floats(1, 3),
    thickness=st.floats(0, 1e6),
    attenuation_distance=st.one_of(st.just(math.inf), st.floats(1e-6, 1e6)),
    attenuation_color=colour,
    clearcoat=unit,
    clearcoat_roughness=unit,
    clearcoat_normal_scale=number,
    specular=unit,
    specular_color=st.tuples(*[st.floats(0, 100)] * 3),
    unlit=st.booleans(),
    double_sided=st.booleans(),
    alpha_mode=st.sampled_from(AlphaMode),
    alpha_cutoff=st.floats(0, 2),
    vertex_alpha=st.booleans(),
    **{f"{slot}_texture": st.one_of(st.none(), uses) for slot in TEXTURE_SLOTS},
)

VERSION_1: dict[str, Any] = {
    "name": "old", "base_color": [1.0, 0.5, 0.25, 1.0], "base_color_texture": 3, "metallic": 0.5, "roughness": 0.25,
    "metallic_roughness_texture": -1, "emissive": [1.0, 2.0, 3.0], "transmission": 0.5, "ior": 1.25, "double_sided": True,
    "alpha_mode": 1, "alpha_cutoff": 0.75, "wrap_s": 1, "wrap_t": 2, "nearest": True,
}  # fmt: skip


@given(st.lists(materials, max_size=4))
@settings(max_examples=25, deadline=None)
def test_materials_come_back(given_materials: list[Material]) -> None:
    decoded = [material for page in encode_materials(given_materials) for material in decode_materials(page)[1]]
    assert decoded == given_materials


def test_many_materials_make_pages_in_order() -> None:
    many = [Material(name=f"{number} " + "ü" * 200) for number in range(2_000)]
    pages = encode_materials(many)
    assert len(pages) > 1 and max(map(len, pages)) <= PAYLOAD_BYTES_MAX
    firsts = [decode_materials(page)[0] for page in pages]
    assert firsts == sorted(firsts) and sum(len(decode_materials(page)[1]) for page in pages) == len(many)


def test_a_table_is_cut_before_it_is_too_long_for_one_value() -> None:
    pages = encode_pages("long", 1, [{"numbers": [0] * 100}] * 2_500)
    found = [decode_page(page, "long", 1, lambda fields: fields.sequence("numbers", 100)) for page in pages]
    assert sum(len(items) for _, items in found) == 2_500 and max(map(len, pages)) <= PAYLOAD_BYTES_MAX


def test_a_name_without_utf8_is_stored_with_question_marks() -> None:
    (page,) = encode_materials([Material(name="a\ud800b")])
    assert decode_materials(page)[1][0].name == "a?b"


def test_a_page_of_version_1_is_read() -> None:
    first, (old,) = decode_materials(encode_page("materials", 1, 7, [VERSION_1]))
    assert first == 7 and old == Material(
        name="old", base_color=(1.0, 0.5, 0.25, 1.0), metallic=0.5, roughness=0.25, emissive=(1.0, 2.0, 3.0), transmission=0.5,
        ior=1.25, double_sided=True, alpha_mode=AlphaMode.MASK, alpha_cutoff=0.75,
        base_color_texture=TextureUse(3, 0, Wrap.CLAMP, Wrap.MIRROR, True),
    )  # fmt: skip
    with pytest.raises(DamagedData, match="lacks 'nearest'"):
        decode_materials(encode_page("materials", 1, 0, [{key: VERSION_1[key] for key in VERSION_1 if key != "nearest"}]))


@pytest.mark.parametrize(
    "item",
    [
        {},
        {"name": "m", "roughness": -0.1},
        {"name": "m", "roughness": 1.5},
        {"name": "m", "attenuation_distance": 0.0},
        {"name": "m", "sheen": 1.0},
        {"name": "m", "alpha_mode": 3},
        {"name": "m", "normal_texture": [0, 2, 0, 0, False, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]},
        {"name": "m", "normal_texture": [-1, 0, 0, 0, False, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]},
        {"name": "m", "normal_texture": [0, 0, 3, 0, False, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]},
        {"name": "m", "normal_texture": [0, 0, 0, 0, 1, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]},
        {"name": "m", "normal_texture": [0, 0, 0, 0, False, 1.0, 0.0, 1e10, 0.0, 1.0, 0.0]},
        {"name": "m", "normal_texture": [0, 0, 0, 0, False, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5]},
        {"name": "m", "normal_texture": [0, 0, 0, 0, False, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 4.0]},
        {"name": "m", "normal_texture": [0, 0, 0, 0, False, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 4, 4]},
        {"name": "m", "normal_texture": [0, 0]},
    ],
)
def test_what_no_material_has_is_damaged_data(item: dict[str, Any]) -> None:
    with pytest.raises(DamagedData):
        decode_materials(encode_page("materials", 2, 0, [item]))


def test_what_has_its_default_is_left_out() -> None:
    (page,) = encode_materials([Material(name="plain")])
    assert unpack_value(page, what="a page")["items"] == [{"name": "plain"}]
    assert decode_materials(page) == (0, [Material(name="plain")])
    unknown = pack_value({"kind": "materials", "version": 3, "first": 0, "items": []})
    with pytest.raises(DamagedData, match="unknown version"):
        decode_materials(unknown)


def test_an_emissive_texture_counts_by_its_mean() -> None:
    lamp = Material(emissive=(2.0, 4.0, 8.0), emissive_mean=(0.5, 0.25, 0.0), emissive_texture=TextureUse(0))
    assert lamp.mean_emissive == (1.0, 1.0, 0.0) and lamp.is_sampled_light
    black = Material(emissive=(2.0, 4.0, 8.0), emissive_mean=(0.0, 0.0, 0.0), emissive_texture=TextureUse(0))
    assert not black.shines


@pytest.mark.parametrize("mode", [AlphaMode.MASK, AlphaMode.BLEND])
def test_what_alpha_may_hide_is_no_sampled_light(mode: AlphaMode) -> None:
    shining = (1.0, 1.0, 1.0)
    assert Material(emissive=shining, alpha_mode=mode).is_sampled_light
    assert not Material(emissive=shining, alpha_mode=mode, vertex_alpha=True).is_sampled_light
    assert not Material(emissive=shining, alpha_mode=mode, base_color_texture=TextureUse(0)).is_sampled_light


@pytest.mark.parametrize("minify", list(Minify))
def test_how_a_texture_is_minified_is_kept_and_the_usual_way_left_out(minify: Minify) -> None:
    worn = Material(name="worn", base_color_texture=TextureUse(1, minify=minify))
    (page,) = encode_materials([worn])
    (item,) = unpack_value(page, what="a page")["items"]
    assert len(item["base_color_texture"]) == (11 if minify is Minify.LINEAR_BETWEEN else 12)
    assert decode_materials(page) == (0, [worn])
