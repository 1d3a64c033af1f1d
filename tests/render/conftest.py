"""What several tests of renders begin with."""

from __future__ import annotations

import pytest

from render.painted_room import write_room
from scenefold.render.pool import dealing
from scenefold.render.pool.organiser import Organiser
from scenefold.render.pool.still_open import StillOpen
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


@pytest.fixture
def all_help(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever may be dealt paths is presumed to have nothing else to do, from the first pass on."""
    monkeypatch.setattr(dealing, "TRIP_S", 0.0)
    monkeypatch.setattr(dealing, "PART_RAYS_MIN", 1)
    monkeypatch.setattr(StillOpen, "release", lambda self, until: [0] * self._nodes)
