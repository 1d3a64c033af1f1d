"""Options that say how the work of a render is shared out, and what goes with what (specs/32-partitions.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from scenectl.moment_values import FRAME_MAX
from scenectl.own_cluster import is_of_variable, without_profile
from scenectl.values import ONE_WORD, is_digits

FRAMES_MAX = 100_000
PartitionOption = Literal["spatial", "visual", "temporal"]
STILL = "scenectl render still"
_OF_ONE_IMAGE = ("--memory", "--resume", "--preview", "--save")


@dataclass(frozen=True)
class Frames:
    """Frames of an animation, both ends included: 0-47; or one: 12."""

    first: int
    last: int

    @classmethod
    def parse(cls, text: str) -> Self:
        ends = [word.strip() for word in text.split("-")]
        if not 1 <= len(ends) <= 2 or not all(map(is_digits, ends)):
            raise ValueError(f"frames are FIRST-LAST, such as 0-47, not {text[:80]!r}")
        first, last = int(ends[0]), int(ends[-1])
        if last < first:
            raise ValueError(f"the last frame, {last}, comes before the first, {first}")
        if last > FRAME_MAX or last - first >= FRAMES_MAX:
            raise ValueError(f"at most {FRAMES_MAX:,} frames are made at a time, none above {FRAME_MAX:,}, not {text[:80]!r}")
        return cls(first, last)

    @property
    def numbers(self) -> range:
        return range(self.first, self.last + 1)

    def __str__(self) -> str:
        return f"{self.first}-{self.last}"


FramesOption = Annotated[Frames, ONE_WORD]


def check_partition(
    partition: str, *, engine: str | None, frames: Frames | None, of_pool: Mapping[str, tuple[object, str]], **moments: object
) -> None:
    """UsageFault for an option of `render still` that its partition has no use for.

    `of_pool`: by option what only a pool of nodes, or this process alone, can do (None: not given), and its variable, if it has one. A
    variable may stay set: it says what a cluster shall have if one is started. `moments`: options that name one moment.
    """
    from scenefold.base.errors import UsageFault

    if partition == "spatial":
        if engine is not None:
            remedy = "give --partition visual or temporal, too, or leave out --engine"
            raise UsageFault("a spatial partition is rendered by nodes, and not by an engine", where=STILL, remedy=remedy)
        if frames is not None:
            _check_moments(moments)
            for option in _OF_ONE_IMAGE:
                if of_pool[option][0] is not None:
                    raise UsageFault(f"{option} is of one image, and --frames makes several", where=STILL, remedy="leave out one of them")
        return
    for option, (value, variable) in of_pool.items():
        if value is not None and not is_of_variable(value, variable):
            what = f"{option} is of a spatial partition, and has no meaning beside --partition {partition}"
            raise UsageFault(what, where=STILL, remedy="leave out one of them")
    if frames is None:
        return
    if partition == "visual":
        raise UsageFault("a visual partition makes one image", where=STILL, remedy="give --partition temporal for frames, or one --frame")
    _check_moments(moments)


def _check_moments(moments: Mapping[str, object]) -> None:
    from scenefold.base.errors import UsageFault

    for name, value in moments.items():
        if value is not None:
            raise UsageFault(f"--frames and --{name} are given", where=STILL, remedy="leave out one of them")


def check_engine(engine: str | None, *, threads: int | None, trust_network: bool) -> None:
    """UsageFault for threads of this process where others do the work, or for trust in a network that nothing goes through."""
    from scenefold.base.errors import UsageFault

    if engine is None and trust_network:
        raise UsageFault("--trust-network is said of the way to an engine", where=STILL, remedy="give --engine, too, or leave it out")
    if engine is not None and threads is not None and not is_of_variable(threads, "SCENEFOLD_THREADS"):
        what = "--threads are of this process, and the workers of an engine have their own"
        raise UsageFault(what, where=STILL, remedy="say it where they are started: dask worker --nthreads")


def check_frames_alone(frames: Frames | None, profile: str | None) -> None:
    """UsageFault for frames beside a profile: they are read from the file, each at its moment, and a scene holds one."""
    from scenefold.base.errors import UsageFault

    if frames is not None and profile is not None:
        what = "--frames are read from the file, and a profile names a cluster, whose scene holds one moment"
        raise UsageFault(what, where=STILL, remedy=f"{without_profile(profile)}, or give one --frame instead")


def images_of(exr: Path, png: Path, frames: Frames | None) -> dict[str, Path]:
    """By what each is called: where images go."""
    if frames is None:
        return {"-o": exr, "the PNG beside -o": png}
    kinds = {"frame": exr, "the PNG of frame": png}
    return {f"{kind} {number}": numbered(path, number) for number in frames.numbers for kind, path in kinds.items()}


def numbered(path: Path, frame: int) -> Path:
    """Where a frame goes: fox.exr, fox.0012.exr."""
    return path.with_name(f"{path.stem}.{frame:04d}{path.suffix}")
