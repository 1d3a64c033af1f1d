"""If this fails, `embree` does not keep the contract: its images are wrong, or depend on who held what."""

from __future__ import annotations

import pytest

from scenefold.render.contract import load_renderer
from scenefold.render.kit import Level, check_renderer, checks

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
