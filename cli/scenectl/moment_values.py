"""Options that say at which moment a scene file that moves is imported: `render still` and `scene import` have the same."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from scenectl.values import real, whole

if TYPE_CHECKING:
    from scenefold.scene.importers import Moment

FRAME_MAX = 10**9
FrameOption = Annotated[int | None, whole(0, FRAME_MAX)]
FpsOption = Annotated[float | None, real(gt=0, lte=1_000_000)]
TimeOption = Annotated[float | None, real(gte=0, lte=1_000_000)]


def moment_of(where: str, *, frame: int | None, fps: float | None, time: float | None, animation: str | None) -> Moment | None:
    """The moment that the options of the verb `where` mean, None: at rest; UsageFault if they contradict each other."""
    from scenefold.base.errors import UsageFault

    if frame is not None and time is not None:
        raise UsageFault("a frame and a time are given", where=where, remedy="give --frame or --time")
    if fps is not None and frame is None:
        raise UsageFault("--fps says how long a frame is, and there is none", where=where, remedy="give --frame, too, or leave out --fps")
    if animation is not None and frame is None and time is None:
        raise UsageFault("an animation is named, but no moment of it", where=where, remedy="give --frame or --time, too")
    if frame is None and time is None:
        return None
    # Late: they load much that a command without a file does not need.
    from scenefold.scene.importers import FPS_USUAL, Moment, moment_of_frame

    if frame is not None:
        return moment_of_frame(frame, FPS_USUAL if fps is None else fps, animation)
    return Moment(time, animation)


def check_of_a_file(where: str, **options: object) -> None:
    """UsageFault if one of these options is given, where a scene of the cluster is shown: it holds the moment that it was imported at."""
    from scenefold.base.errors import UsageFault

    for name, value in options.items():
        if value is not None:
            what = f"--{name} is of a file that is read now, and a scene holds the one moment that it was imported at"
            raise UsageFault(what, where=where, remedy=f"name the file, or import it at that moment: scenectl scene import FILE --{name} …")
