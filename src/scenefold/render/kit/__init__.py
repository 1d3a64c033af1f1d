"""The test kit that a renderer must pass (specs/09-renderer-contract.md, *Kit*).

    from scenefold.render.kit import Level, checks

    for name, check in checks(Level.STATISTICAL).items():
        check(MyRenderer())        # AssertionError, with what was expected and what came

Two levels. `STATISTICAL`: one node, and images are right. `BIT`: besides, the same bits for any batches, order, cells, nodes and threads,
which is what many nodes need. A check takes a renderer and knows nothing else of it; pytest is not needed. From a shell:

    python -m scenefold.render.kit NAME --level statistical
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum

from scenefold.render.contract import Renderer

Check = Callable[[Renderer], None]


class Level(StrEnum):
    STATISTICAL = "statistical"
    BIT = "bit"


def checks(level: Level) -> Mapping[str, Check]:
    """By name, all that a renderer of this level has to pass."""
    from scenefold.render.kit import bits, furnace, lamps

    right: dict[str, Check] = {**bits.STATISTICAL, **lamps.STATISTICAL, **furnace.STATISTICAL}
    return {**bits.BIT, **right} if level == Level.BIT else right


def check_renderer(renderer: Renderer, level: Level) -> dict[str, str]:
    """Run all checks; what failed, by name, and why. Empty: the renderer passes."""
    failed = {}
    for name, check in checks(level).items():
        try:
            check(renderer)
        except AssertionError as problem:
            failed[name] = str(problem)
    return failed
