"""What the tests of simulations share."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest


@pytest.fixture
def silent() -> Iterator[None]:
    """Nodes say nothing, for tests in which they have much to complain of and something else is judged."""
    ours = logging.getLogger("scenefold")
    level = ours.level
    ours.setLevel(logging.CRITICAL + 1)
    yield
    ours.setLevel(level)
