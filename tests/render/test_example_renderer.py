"""If this fails, the renderer that the documentation shows as an example does not work, or is wrong."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

import pytest

from house.sources import ROOT
from scenefold.base.errors import LocalFault
from scenefold.render.kit import Level, checks
from scenefold.render.kit.rig import Rig
from scenefold.render.kit.shapes import room

pytestmark = pytest.mark.timeout(300)
LONG = frozenset({"a glowing rectangle", "inside of a glowing sphere", "instances of a rectangle made far away"})
"""Of the kit: in Python these take a quarter of a minute each. Other lamps and another furnace are left."""
EXAMPLE = ROOT / "docs" / "examples" / "plain_renderer.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("plain_renderer", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_it_is_short_and_on_its_page() -> None:
    assert EXAMPLE.read_text(encoding="utf-8").count("\n") < 150
    page = (ROOT / "docs" / "how-to" / "write-a-renderer.md").read_text(encoding="utf-8")
    assert '--8<-- "docs/examples/plain_renderer.py"' in page


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in checks(Level.STATISTICAL)])
def test_it_passes_the_kit(example: ModuleType, name: str) -> None:
    checks(Level.STATISTICAL)[name](example.PlainRenderer())


def test_what_it_cannot_do_it_says(example: ModuleType) -> None:
    with pytest.raises(LocalFault, match="textures, alpha and glass"):
        Rig(room(), example.PlainRenderer()).render()
