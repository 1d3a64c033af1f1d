"""Runs the suite on each world."""

from __future__ import annotations

import pytest

from conformance.world.makers import RealWorlds, Worlds

MAKERS = {"real": RealWorlds}


@pytest.fixture(params=sorted(MAKERS))
def worlds(request: pytest.FixtureRequest) -> Worlds:
    return MAKERS[request.param]()
