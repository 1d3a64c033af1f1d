"""If this fails, `embree` does not keep the contract: its images are wrong, or depend on who held what."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.render.contract import Renderer, load_renderer
from scenefold.render.kit import Level, check_renderer, checks
from scenefold.render.kit.rig import Rig
from scenefold.render.kit.shapes import room

pytestmark = pytest.mark.timeout(300)  # the first one may have to compile everything


@pytest.mark.parametrize("name", checks(Level.BIT))
def test_embree_passes_at_bit_level(name: str) -> None:
    checks(Level.BIT)[name](load_renderer("embree"))


def test_the_levels_build_on_each_other() -> None:
    assert set(checks(Level.STATISTICAL)) < set(checks(Level.BIT))


def test_a_renderer_that_is_wrong_is_told_why(monkeypatch: pytest.MonkeyPatch) -> None:
    from scenefold.render.kit import bits, furnace, lamps

    def wrong(renderer: object) -> None:
        raise AssertionError("twice as bright")

    for module in (bits, furnace, lamps):
        monkeypatch.setattr(module, "STATISTICAL", {})
    monkeypatch.setattr(lamps, "STATISTICAL", {"a lamp": wrong})
    assert check_renderer(load_renderer("embree"), Level.STATISTICAL) == {"a lamp": "twice as bright"}


def test_light_that_depends_on_the_size_of_the_room_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Alike on any nodes, and wrong: lamps that go out in any room but the usual one."""
    from scenefold.render.kit import bits

    def room_of(renderer: Renderer, scale: float = 1.0) -> Rig:
        usual = room(scale)
        return Rig(usual if scale == 1.0 else replace(usual, punctual=[]), renderer, bits.GROUP_TRIANGLES)

    monkeypatch.setattr(bits, "_room", room_of)
    with pytest.raises(AssertionError, match="1e-05 times as large: the mean radiance is"):
        bits.any_size(load_renderer("embree"))
