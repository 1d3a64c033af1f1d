"""`scenectl scene settings`: what an image of a scene is by default, for everybody who renders it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from scenectl.image_values import check_camera
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, table
from scenectl.repeating import RequestOption, decided_text, one_change, position_of
from scenectl.values import ColourOption, SizeOption, real, whole
from scenefold.base.image_limits import (
    ADAPTIVE_MAX,
    CLAMP_MAX,
    DEPTH_MAX,
    EXPOSURE_MAX,
    FOCUS_MIN,
    MIN_SAMPLES_LEAST,
    ROTATION_MAX,
    SAMPLES_MAX,
)
from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.client.requests import Change

if TYPE_CHECKING:
    from scenefold.client.render_settings import SettingsShown
    from scenefold.wire import RenderSettings


def settings(
    scene: SceneName,
    /,
    *,
    size: SizeOption | None = None,
    samples: Annotated[int | None, whole(1, SAMPLES_MAX)] = None,
    depth: Annotated[int | None, whole(1, DEPTH_MAX)] = None,
    sky: ColourOption | None = None,
    exposure: Annotated[float | None, real(gte=-EXPOSURE_MAX, lte=EXPOSURE_MAX)] = None,
    camera: str | None = None,
    aperture: Annotated[float | None, real(gt=0, lte=COORDINATE_ABS_MAX)] = None,
    focus: Annotated[float | None, real(gte=FOCUS_MIN, lte=COORDINATE_ABS_MAX)] = None,
    sampler: Literal["sobol", "independent"] | None = None,
    roulette_from: Annotated[int | None, whole(1, DEPTH_MAX)] = None,
    clamp_direct: Annotated[float | None, real(gt=0, lte=CLAMP_MAX)] = None,
    clamp_indirect: Annotated[float | None, real(gt=0, lte=CLAMP_MAX)] = None,
    adaptive: Annotated[float | None, real(gt=0, lte=ADAPTIVE_MAX)] = None,
    min_samples: Annotated[int | None, whole(MIN_SAMPLES_LEAST, SAMPLES_MAX)] = None,
    environment_rotation: Annotated[float | None, real(gte=-ROTATION_MAX, lte=ROTATION_MAX)] = None,
    clear: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Tell what an image of a scene is by default, or change it: what is given here counts for everybody who renders it, unless he says otherwise.

    It stands in the scene's log. Owners change it, in edit mode.

    Example: scenectl scene settings kitchen --size 1920x1080 --samples 256 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    size
        Width and height in pixels.
    samples
        Paths for each pixel.
    depth
        Most segments of a path, the camera ray being the first.
    sky
        Colour of a uniform sky as R,G,B, linear.
    exposure
        Brightness of the PNG in stops.
    camera
        Name of the camera.
    aperture
        Radius of the camera's lens in the scene's unit.
    focus
        How far from the camera everything is sharp; goes with --aperture.
    sampler
        How the random numbers of a pixel's paths are drawn.
    roulette_from
        Bounce from which on a path may end by chance.
    clamp_direct
        Most that light which was reflected at most once may add to a path.
    clamp_indirect
        The same of light that was reflected more often.
    adaptive
        Error, as a share of its brightness, at which a pixel has enough paths.
    min_samples
        Paths that every pixel has before; goes with --adaptive.
    environment_rotation
        Degrees by which the scene's environment map is turned.
    clear
        Forget what was said before; of what is not given beside this the scene says nothing then.
    """
    from scenectl.running import connected, run
    from scenefold.render.client import StillOptions
    from scenefold.wire import RenderSettings

    given: dict[str, Any] = {
        "width": None if size is None else size.width,
        "height": None if size is None else size.height,
        "samples": samples,
        "depth": depth,
        "sky": None if sky is None else sky.rgb,
        "exposure": exposure,
        "camera": camera,
        "aperture": aperture,
        "focus": focus,
        "sampler": sampler,
        "roulette_from": roulette_from,
        "clamp_direct": clamp_direct,
        "clamp_indirect": clamp_indirect,
        "adaptive": adaptive,
        "min_samples": min_samples,
        "environment_rotation": environment_rotation,
    }
    given = {name: value for name, value in given.items() if value is not None}
    if camera is not None:
        check_camera(camera)
    # As a render would say it.
    StillOptions(**given).checked()

    def changed(before: RenderSettings) -> RenderSettings:
        return (RenderSettings() if clear else before).changed(given)

    change = Change(request)

    async def ask() -> SettingsShown:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            return await (opened.change_render_settings(changed, again=change) if given or clear else opened.render_settings())

    with one_change("scene settings", scene, change, is_none=not (given or clear)):
        found = run(ask)
    emit(output, {"scene": scene, **found.document(), **position_of(change)}, settings_text(found) + decided_text(change))


def settings_text(found: SettingsShown) -> str:
    """A row for each thing that the scene says."""
    rows = [(name, _text(value)) for name, value in found.settings.flat().items() if value is not None]
    return table(("setting", "by default"), rows) if rows else "The scene does not say what an image of it is by default."


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ",".join(f"{channel:.9g}" for channel in value)
    return repr(value) if isinstance(value, float) else str(value)
