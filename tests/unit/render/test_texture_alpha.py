"""If this fails, a node looks through all materials anew for every texture it holds, or takes another number for what hides a surface."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from scenefold.render import content, texture_levels
from scenefold.render.texture_levels import hiding_textures
from scenefold.scene.payloads.materials import AlphaMode, Material
from scenefold.scene.payloads.texture_uses import TextureUse
from scenefold.scene.payloads.textures import Texture
from scenefold.scene.tables import SceneTables


class Looked(list[Material]):
    """Materials that count how often somebody begins to look through them."""

    times = 0

    def __iter__(self) -> Iterator[Material]:
        self.times += 1
        return super().__iter__()


def tables_of(materials: list[Material], textures: int) -> SceneTables:
    heads = [Texture(number, "a", 1, 1, True, True, ()) for number in range(textures)]
    return cast("SceneTables", SimpleNamespace(materials=materials, textures=heads))


def test_only_base_colours_of_what_is_not_opaque_hide() -> None:
    materials = [
        Material(base_color_texture=TextureUse(0)),
        Material(base_color_texture=TextureUse(1), alpha_mode=AlphaMode.MASK),
        Material(base_color_texture=TextureUse(2), alpha_mode=AlphaMode.BLEND, emissive_texture=TextureUse(3)),
        Material(alpha_mode=AlphaMode.BLEND, specular_texture=TextureUse(4)),
    ]
    assert hiding_textures(tables_of(materials, 5)) == {1, 2}


def test_materials_are_looked_through_as_often_for_many_textures_as_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    by_alpha: list[bool] = []
    monkeypatch.setattr(texture_levels, "linear_of_srgb", lambda: None)
    monkeypatch.setattr(texture_levels, "level_tables", lambda *_: (None, None))
    monkeypatch.setattr(texture_levels, "level_sizes", lambda *_: [(1, 1), (1, 1)])
    monkeypatch.setattr(texture_levels, "fill_level", lambda *arguments: by_alpha.append(arguments[-1]))
    times = []
    for count in (1, 50):
        materials = Looked([Material(base_color_texture=TextureUse(0), alpha_mode=AlphaMode.MASK)])
        tiles: dict[int, Any] = {number: [] for number in range(count)}
        rows, texels = content._textures(tables_of(materials, count), tiles)
        assert len(rows) == count and texels.dtype == np.uint8
        times.append(materials.times)
    assert times[0] == times[1]
    assert by_alpha[:2] == [True, True]
