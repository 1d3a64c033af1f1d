"""What several tests of renders begin with."""

from __future__ import annotations

import pytest

from render.painted_room import write_room
from scenefold.render.rehearsal.pool import Records, records_of


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """All records of the painted room."""
    return records_of(write_room(tmp_path_factory.mktemp("room")))
