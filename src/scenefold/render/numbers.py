"""A job's numbers for the kernels, from its document and the scene's tables: equal on every node to the bit."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence

import numpy as np

from scenefold.render.arrays import F64, JobNumbers, LightColumn
from scenefold.render.bsdf_kernels import luminance
from scenefold.render.dice_kernels import SAMPLER_INDEPENDENT, SAMPLER_SOBOL
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.job import Job
from scenefold.render.math_kernels import PI
from scenefold.render.precise_kernels import sine_cosine
from scenefold.render.setup_kernels import emitter_power
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.texture_uses import Minify
from scenefold.scene.tables import SceneTables

_BOX_MARGIN = 1e-4
"""Of the box's diagonal: shadow rays that end at a far face pass everything before it."""
_CHOSEN_EVENLY = 0.5
"""Share of the choices among punctual lights that does not look at their power."""
_FOOTPRINT_SHARE = 1.0 / 16.0
"""Of a pixel's area: a path stands for a quarter of the pixel's width, however many there are, for the first ones must not depend on that."""
_SAMPLERS = {"sobol": SAMPLER_SOBOL, "independent": SAMPLER_INDEPENDENT}
_KINDS = {"point": 0.0, "spot": 1.0, "directional": 2.0}


def camera_numbers(camera: Camera, width: int, height: int) -> tuple[float, ...]:
    """The first 15 numbers of `JobNumbers.camera`, and a 0; the image's shape decides the horizontal angle."""
    rotation = np.asarray(camera.matrix, np.float64)
    if camera.kind == "perspective":
        sine, cosine = sine_cosine(camera.yfov * 0.5)
        half_height = float(sine / cosine)
    else:
        half_height = camera.ymag
    half_width = half_height * width / height
    position, right, up, back = rotation[:3, 3], rotation[:3, 0], rotation[:3, 1], rotation[:3, 2]
    values = [*position, *right, *up, *(-back), half_width, half_height, 0.0 if camera.kind == "perspective" else 1.0, 0.0]
    return tuple(float(value) for value in values)


def job_box(tables: SceneTables) -> tuple[F64, F64]:
    """The job's box: all geometry and all lights that have a place, and a little more. (low, high), f64[3] each."""
    low, high = tables.document.world_low.copy(), tables.document.world_high.copy()
    for light in tables.punctual:
        if light.kind != "directional":
            low, high = np.minimum(low, light.position), np.maximum(high, light.position)
    margin = _BOX_MARGIN * diagonal_of(low, high)
    return low - margin, high + margin


def depth_of_box(camera: Sequence[float], box: tuple[F64, F64]) -> float:
    """How far a box is from the camera, or from the plane of an orthographic one: no hit has a smaller depth, and none one that is more than
    the diagonal larger. camera: as `camera_numbers` has it."""
    low, high = box
    position, forward = np.array(camera[0:3], np.float64), np.array(camera[9:12], np.float64)
    if camera[14] == 0.0:
        return diagonal_of(np.zeros(3), np.maximum(np.maximum(low - position, position - high), 0.0))
    x, y, z = (float(value) for value in np.where(forward > 0.0, low - position, high - position) * forward)
    return max(x + y + z, 0.0)


def diagonal_of(low: F64, high: F64) -> float:
    """The length of a box's diagonal."""
    x, y, z = (float(value) for value in high - low)
    return float(np.sqrt(x * x + y * y + z * z))


def punctual_rows(tables: SceneTables) -> F64:
    """`SceneArrays.punctual_lights`: half of them chosen evenly, half by the power that they can send into the job's box.

    By power alone the only lamp of a room would be asked once in a million times where the sun shines on a large ground outside.
    """
    low, high = job_box(tables)
    radius = 0.5 * diagonal_of(low, high)
    lights = [light for light in tables.punctual if max(light.color) > 0.0]
    rows = np.zeros((len(lights), LightColumn.WIDTH))
    powers = []
    for row, light in zip(rows, lights, strict=True):
        directional = light.kind == "directional"
        row[LightColumn.KIND] = _KINDS[light.kind]
        row[LightColumn.POSITION : LightColumn.POSITION + 3] = light.position
        row[LightColumn.DIRECTION : LightColumn.DIRECTION + 3] = light.direction
        row[LightColumn.COLOR : LightColumn.COLOR + 3] = light.color
        row[LightColumn.COS_INNER] = sine_cosine(light.inner_cone)[1]
        row[LightColumn.COS_OUTER] = sine_cosine(light.outer_cone)[1]
        powers.append(float(luminance(*light.color)) * (radius * radius if directional else 4.0))
    total = sum(powers)
    for row, power in zip(rows, powers, strict=True):
        row[LightColumn.PROBABILITY] = _CHOSEN_EVENLY / len(rows) + (1.0 - _CHOSEN_EVENLY) * (power / total)
    return rows


def job_numbers(job: Job, tables: SceneTables) -> JobNumbers:
    """The kernels' view of a job."""
    low, high = job_box(tables)
    power = float(emitter_power(tables.lights.corners.copy(), tables.lights.emission.copy()))
    has_environment = tables.environment.shines and not max(job.sky) > 0.0
    present = (has_environment or max(job.sky) > 0.0, any(max(light.color) > 0.0 for light in tables.punctual), power > 0.0)
    choose_sky, choose_punctual, choose_emitter = _choices(*present)
    dice = dice_seed(job.seed, job.frame)
    sine, cosine = (float(value) for value in sine_cosine(job.environment_rotation % 360.0 / 180.0 * PI))
    return JobNumbers(
        box_low=low,
        box_high=high,
        sky=np.array(job.sky, np.float64),
        choose_sky=choose_sky,
        choose_punctual=choose_punctual,
        choose_emitter=choose_emitter,
        inverse_emitter_power=1.0 / power if power > 0.0 else 0.0,
        camera=np.array(
            [*job.camera[:15], *((0.0, 0.0) if job.lens is None else job.lens.row()), depth_of_box(job.camera, (low, high))], np.float64
        ),
        seed=job.seed,
        frame=job.frame,
        width=job.width,
        height=job.height,
        samples=job.samples,
        depth=job.depth,
        stride=scattering_stride(job.window.pixels),
        dice_low=dice & 0xFFFFFFFF,
        dice_high=dice >> 32,
        sampler=_SAMPLERS[job.sampling.sampler],
        crop_x=job.window.x,
        crop_y=job.window.y,
        crop_width=job.window.width,
        crop_height=job.window.height,
        roulette_from=job.sampling.roulette_from,
        clamp_direct=_limit(job.sampling.clamp_direct),
        clamp_indirect=_limit(job.sampling.clamp_indirect),
        has_environment=has_environment,
        environment_cosine=cosine,
        environment_sine=sine,
        **_footprint(job, tables),
    )


def _footprint(job: Job, tables: SceneTables) -> dict[str, float]:
    """`JobNumbers.footprint` and `footprint_cosine`: nothing if no texture has levels to be read, or the job wants none."""
    if not job.mips or not any(use.minify is not Minify.FINEST for material in tables.materials for _, use in material.uses()):
        return {}
    half_width, half_height, kind = job.camera[12:15]
    pixel = 2.0 * half_height / job.height
    cosine = 1.0 / math.sqrt(1.0 + half_width * half_width + half_height * half_height) if kind == 0.0 else 1.0
    return {"footprint": pixel * pixel * _FOOTPRINT_SHARE, "footprint_cosine": cosine}


def _limit(clamp: float | None) -> float:
    return math.inf if clamp is None else float(clamp)


def dice_seed(seed: int, frame: int) -> int:
    """64 bits that the random numbers of all paths of a job follow from."""
    return int.from_bytes(hashlib.sha256(b"scenefold/dice" + seed.to_bytes(8, "big") + frame.to_bytes(8, "big")).digest()[:8], "big")


def _choices(sky: bool, punctual: bool, emitters: bool) -> tuple[float, float, float]:
    """How often next-event estimation asks each kind of light: evenly among the kinds that there are."""
    kinds = sky + punctual + emitters
    share = 1.0 / kinds if kinds else 0.0
    return share * sky, share * punctual, share * emitters
