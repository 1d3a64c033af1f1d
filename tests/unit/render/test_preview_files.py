"""If this fails, a picture of a render on its way costs the render, is asked for without end, or never comes and nobody hears why."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import trio
from PIL import Image

from scenefold.base.errors import LocalFault, PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster
from scenefold.render.job import RenderOptions
from scenefold.render.preview import nothing_of
from scenefold.render.preview_files import PAUSE_S_MAX, TOLD_AFTER_S, Missing, Previewer, Previews
from scenefold.render.reports import Stand

OPTIONS = RenderOptions(width=8, height=6)
BUSY = Refused(RejectReason.BUSY, "later")
SILENT = Unreachable("nobody answers", where="127.0.0.2")
NONSENSE = PeerFault("a part does not fit")


class Clock:
    """Time that passes while somebody sleeps."""

    def __init__(self) -> None:
        self.at = 100.0

    def now(self) -> float:
        return self.at

    async def sleep(self, seconds: float) -> None:
        self.at += seconds
        await trio.lowlevel.checkpoint()


class Town:
    """A render that stands as a test says, and what is asked of it. `answer`: what a preview of a number is; errors are raised."""

    def __init__(self, previews: Previews, answer: Callable[[int], bytes | ScenefoldError]) -> None:
        self.clock, self.answer = Clock(), answer
        self.asked: list[tuple[float, int]] = []

        async def in_worker(_lane: str, function: Callable[..., object], *arguments: object) -> object:
            await trio.lowlevel.checkpoint()
            return function(*arguments)

        cluster = SimpleNamespace(calls=SimpleNamespace(world=SimpleNamespace(clock=self.clock)), in_worker=in_worker)
        self.previewer = Previewer(cast(Cluster, cluster), previews, OPTIONS)

    def stands(self, closed: int, preview: int = 0, phase: str = "rendering") -> None:
        self.previewer.sees(Stand(phase, closed, 100, 0, bytes(32), 0, "", (), (), preview, {}))

    async def run(self, act: Callable[[], object]) -> None:
        """Until `act`, which is called at each look, has nothing more to do."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self.previewer.run, self._fetch)
            for _ in range(10_000):
                await trio.lowlevel.checkpoint()
                if act():
                    nursery.cancel_scope.cancel()
                    return
        raise AssertionError("it never came to that")

    async def _fetch(self, number: int, size: int) -> bytes:
        await trio.lowlevel.checkpoint()
        self.asked.append((self.clock.at, number))
        found = self.answer(number)
        if isinstance(found, ScenefoldError):
            raise found
        assert len(found) == size
        return found


def lit(number: int) -> bytes:
    sums = nothing_of(8, 6)
    sums[:] = (number, number, number, 1.0)
    return sums.tobytes()


async def test_a_picture_is_written_as_often_as_asked_for_while_there_is_more_to_see(tmp_path: Path) -> None:
    path = tmp_path / "looks.png"
    town, closed = Town(Previews(path, 5.0, exposure=0.0), lit), 0

    def act() -> bool:
        nonlocal closed
        closed = min(closed + 1, 40)
        town.stands(closed, len(town.asked))
        return closed == 40 and town.clock.at > town.asked[-1][0] + 100.0

    await town.run(act)
    assert [number for _, number in town.asked] == list(range(1, len(town.asked) + 1))
    assert all(later - former >= 5.0 for (former, _), (later, _) in zip(town.asked, town.asked[1:], strict=False))
    with Image.open(path) as image:
        assert image.size == (8, 6) and np.asarray(image).min() > 100


async def test_a_number_that_others_have_had_made_is_passed_over(tmp_path: Path) -> None:
    town = Town(Previews(tmp_path / "looks.png", 1.0), lit)
    town.previewer.sees(Stand("rendering", 1, 100, 0, bytes(32), 0, "", (), (), 9, {}))

    def act() -> bool:
        town.stands(3 if town.asked else 2, 7)
        return len(town.asked) == 2

    await town.run(act)
    assert [number for _, number in town.asked] == [8, 9]


@pytest.mark.parametrize("phase", ["preparing", "merging", "done"])
async def test_nothing_is_asked_while_nothing_is_traced(tmp_path: Path, phase: str) -> None:
    town = Town(Previews(tmp_path / "looks.png"), lit)

    def act() -> bool:
        town.stands(7, phase=phase)
        return town.clock.at > 200.0

    await town.run(act)
    assert not town.asked


@pytest.mark.parametrize("why", [BUSY, SILENT, NONSENSE, Refused(RejectReason.OUTSIDE_BOUNDS, "no memory"), LocalFault("disk full")])
async def test_whatever_fails_is_told_once_and_tried_again_ever_more_seldom(tmp_path: Path, why: ScenefoldError) -> None:
    heard: list[ScenefoldError] = []
    town = Town(Previews(tmp_path / "looks.png", 5.0, missed=heard.append), lambda number: why if len(town.asked) < 12 else lit(number))

    def act() -> bool:
        town.stands(len(town.asked) + 1)
        return (tmp_path / "looks.png").exists()

    await town.run(act)
    assert heard == [why] and len(town.asked) == 12
    pauses = [later - former for (former, _), (later, _) in zip(town.asked, town.asked[1:], strict=False)]
    assert pauses[0] < 4.0 < pauses[-1] <= PAUSE_S_MAX + 1.0


async def test_a_folder_that_has_gone_is_no_fault_of_the_render(tmp_path: Path) -> None:
    heard: list[ScenefoldError] = []
    (tmp_path / "here").mkdir()
    town = Town(Previews(tmp_path / "here" / "looks.png", 5.0, missed=heard.append), lit)
    (tmp_path / "here").rmdir()

    def act() -> bool:
        town.stands(len(town.asked) + 1)
        return len(town.asked) == 3

    await town.run(act)
    assert [type(one) for one in heard] == [LocalFault]


async def test_nonsense_is_no_picture(tmp_path: Path) -> None:
    heard: list[ScenefoldError] = []
    spoilt = np.full_like(nothing_of(8, 6), np.nan).tobytes()
    town = Town(Previews(tmp_path / "looks.png", missed=heard.append), lambda _number: spoilt)

    def act() -> bool:
        town.stands(1)
        return len(town.asked) == 2

    await town.run(act)
    assert [type(one) for one in heard] == [PeerFault] and not (tmp_path / "looks.png").exists()


def test_what_may_pass_is_told_when_it_does_not() -> None:
    heard: list[Any] = []
    missing = Missing(heard.append)
    assert missing.missed(BUSY, 0.0) < missing.missed(SILENT, 10.0)
    missing.had()
    missing.missed(BUSY, 20.0)
    missing.missed(SILENT, 20.0 + TOLD_AFTER_S - 1.0)
    assert not heard
    missing.missed(SILENT, 20.0 + TOLD_AFTER_S)
    missing.missed(NONSENSE, 90.0)
    assert heard == [SILENT]


@pytest.mark.parametrize("every_s", [0.0, 0.9, 1e6, float("nan")])
def test_how_often_has_bounds(every_s: float) -> None:
    with pytest.raises(UsageFault, match="previews"):
        Previews(Path("looks.png"), every_s)
