"""If these failed, kernels would read a surface's numbers from the wrong columns."""

from __future__ import annotations

import math
from types import SimpleNamespace

from scenefold.render.arrays import Feature, MaterialColumn, TextureUseColumn
from scenefold.render.material_rows import USE_COLUMNS, material_rows
from scenefold.scene.payloads.materials import TEXTURE_SLOTS, AlphaMode, Material, TextureUse, Wrap

MOVED = (2.0, 0.5, 0.25, -0.5, 2.0, 0.75)


def rows_of(*materials: Material):  # type: ignore[no-untyped-def]
    return material_rows(SimpleNamespace(materials=list(materials)))  # type: ignore[arg-type]


def test_no_two_columns_overlap() -> None:
    widths = {"BASE": 4, "EMISSION": 3, "EMISSIVE": 3, "ATTENUATION_COLOR": 3, "SPECULAR_COLOR": 3}
    names = [name for name in vars(MaterialColumn) if name.isupper() and name != "WIDTH"]
    taken = [getattr(MaterialColumn, name) + at for name in names for at in range(widths.get(name, 1))]
    assert len(set(taken)) == len(taken) and max(taken) < MaterialColumn.WIDTH


def test_factors_stand_in_their_columns() -> None:
    (row,), _ = rows_of(
        Material(
            base_color=(0.1, 0.2, 0.3, 0.4), emissive=(2.0, 4.0, 6.0), emissive_mean=(0.5, 0.5, 0.5), emissive_texture=TextureUse(1),
            clearcoat=0.5, clearcoat_roughness=0.25, specular=0.75, specular_color=(1.0, 2.0, 3.0), thickness=2.0,
            attenuation_distance=3.0, attenuation_color=(0.3, 0.2, 0.1), alpha_mode=AlphaMode.BLEND, ior=1.25,
        )
    )  # fmt: skip
    assert row[MaterialColumn.BASE : MaterialColumn.BASE + 4].tolist() == [0.1, 0.2, 0.3, 0.4]
    assert row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3].tolist() == [1.0, 2.0, 3.0]
    assert row[MaterialColumn.EMISSIVE : MaterialColumn.EMISSIVE + 3].tolist() == [2.0, 4.0, 6.0]
    assert row[MaterialColumn.SPECULAR_COLOR : MaterialColumn.SPECULAR_COLOR + 3].tolist() == [1.0, 2.0, 3.0]
    assert row[MaterialColumn.ATTENUATION_COLOR : MaterialColumn.ATTENUATION_COLOR + 3].tolist() == [0.3, 0.2, 0.1]
    found = {name: row[getattr(MaterialColumn, name)] for name in ("CLEARCOAT", "CLEARCOAT_ROUGHNESS", "SPECULAR", "THICKNESS", "IOR")}
    assert found == {"CLEARCOAT": 0.5, "CLEARCOAT_ROUGHNESS": 0.25, "SPECULAR": 0.75, "THICKNESS": 2.0, "IOR": 1.25}
    assert row[MaterialColumn.ATTENUATION_DISTANCE] == 3.0 and row[MaterialColumn.ALPHA_MODE] == 2.0
    (clear,), uses = rows_of(Material())
    assert clear[MaterialColumn.ATTENUATION_DISTANCE] == math.inf and uses.shape == (1, TextureUseColumn.WIDTH)
    assert all(clear[column] == -1 for column in USE_COLUMNS.values())


def test_each_slot_names_its_use_and_alike_ones_are_one() -> None:
    shared = TextureUse(7, 1, Wrap.CLAMP, Wrap.MIRROR, True, MOVED)
    one_each = Material(**{f"{slot}_texture": TextureUse(at) for at, slot in enumerate(TEXTURE_SLOTS)})  # type: ignore[arg-type]
    rows, uses = rows_of(Material(base_color_texture=shared, normal_texture=shared), one_each)
    assert rows[0, MaterialColumn.BASE_USE] == rows[0, MaterialColumn.NORMAL_USE] == 0
    assert uses[0].tolist() == [7, 1, 2, 1, 1, *MOVED, 4]
    named = [uses[int(rows[1, USE_COLUMNS[slot]]), TextureUseColumn.TEXTURE] for slot in TEXTURE_SLOTS]
    assert named == list(range(len(TEXTURE_SLOTS))) and len(uses) == len(TEXTURE_SLOTS) + 1


def test_thickness_makes_glass_solid_and_roughness_makes_walls_scatter() -> None:
    solid, rough = Feature.SOLID, Feature.ROUGH_TRANSMISSION
    for material, expected in (
        (Material(transmission=0.5, roughness=0.1), 0),
        (Material(transmission=0.5, roughness=0.11), rough),
        # The factor decides: what its texture makes of it is not asked.
        (Material(transmission=0.5, metallic_roughness_texture=TextureUse(0)), rough),
        (Material(transmission=0.5, roughness=0.0, thickness=1e-9), solid),
        (Material(transmission=1.0, metallic=1.0, thickness=1.0), 0),
        (Material(transmission=1.0, metallic=1.0, metallic_roughness_texture=TextureUse(0), thickness=1.0), solid),
        (Material(roughness=0.5, thickness=1.0), 0),
        (Material(transmission=1.0, unlit=True, thickness=1.0), Feature.UNLIT),
    ):
        (row,), _ = rows_of(material)
        assert row[MaterialColumn.FEATURES] == expected, material


def test_what_is_unlit_has_no_light_and_no_glass() -> None:
    (row, plain), _ = rows_of(Material(unlit=True, emissive=(1.0, 1.0, 1.0), transmission=1.0), Material())
    assert row[MaterialColumn.UNLIT] == 1 and row[MaterialColumn.FEATURES] == Feature.UNLIT and plain[MaterialColumn.FEATURES] == 0
    assert not row[[MaterialColumn.EMISSION, MaterialColumn.EMISSIVE, MaterialColumn.TRANSMISSION]].any()
    assert not Material(unlit=True, emissive=(1.0, 1.0, 1.0)).is_sampled_light
