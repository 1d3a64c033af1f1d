"""What tests of nodes beside each other have in common."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest


@pytest.fixture
def only_errors() -> Iterator[None]:
    """Nodes that crash are complained about by those that live; what matters where they do are errors."""
    loggers = [logging.getLogger(name) for name in ("scenefold.world", "scenefold.peer")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    yield
    for logger, level in zip(loggers, before, strict=True):
        logger.setLevel(level)
