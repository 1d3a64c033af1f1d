"""What several tests of renders begin with."""

from __future__ import annotations

import pytest

from render.painted_room import write_room
from scenefold.render.pool.organiser import Organiser
from scenefold.render.rehearsal.pool import Records, records_of


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """All records of the painted room."""
    return records_of(write_room(tmp_path_factory.mktemp("room")))


@pytest.fixture
def ends_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A job is over once its cells have moved, however fast its passes were. If they never do, the pool's time is up."""
    plain = Organiser._all_closed

    async def all_closed(self: Organiser) -> bool:
        return await plain(self) and self._course.moves > 0

    monkeypatch.setattr(Organiser, "_all_closed", all_closed)
