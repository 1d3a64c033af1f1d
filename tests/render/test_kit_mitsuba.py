"""If this fails, `mitsuba` shows another image than the scene has, and is no judge of ours."""

from __future__ import annotations

import pytest

from scenefold.base.errors import LocalFault
from scenefold.render.contract import load_renderer
from scenefold.render.kit import Level, checks
from scenefold.render.renderers.mitsuba import library

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.skipif(not library.is_installed(), reason="mitsuba is not installed: it is an optional extra"),
    pytest.mark.skipif(not library.llvm_library(), reason="no LLVM: ray by ray through Python the kit would take hours"),
]


LONG = frozenset({"a glowing rectangle"})
"""Of the kit, what takes longest; other lamps are left."""


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in checks(Level.STATISTICAL)])
def test_mitsuba_passes_at_statistical_level(name: str) -> None:
    checks(Level.STATISTICAL)[name](load_renderer("mitsuba"))


def test_a_second_node_is_refused() -> None:
    with pytest.raises(LocalFault, match="one node"):
        checks(Level.BIT)["cells through light and wall"](load_renderer("mitsuba"))
