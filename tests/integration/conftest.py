"""Nodes of clusters that tests run themselves are forked, and not started: to import takes as long as all that some tests do."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from integration.warm_nodes import open_warm_process
from scenefold.node import process


@pytest.fixture(autouse=True, scope="session")
def _nodes_are_forked() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "open_process", open_warm_process)
        yield
