"""One lamp, one surface, nothing else that gives light back: a pixel is one integral, which numpy does from glTF's formulas."""

from __future__ import annotations

import math

import numpy as np

from scenefold.render.arrays import F64
from scenefold.render.contract import Renderer
from scenefold.render.kit.expecting import expect, expect_mean
from scenefold.render.kit.gltf import fresnel, value
from scenefold.render.kit.rig import Rendered, Rig
from scenefold.render.kit.shapes import Mesh, grid, looking, moved, scene
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.punctual import PunctualLight

TOLERANCE = 0.01
HALF = 0.2
"""Of the view's side, in the world."""
ROUGHNESS = 0.5
FLOOR = np.array([0.5, 0.6, 0.7])
_UP = np.array([0.0, 0.0, 1.0])
_EYE = looking((0, 0.3, 0), (0, 0, 0), kind="orthographic", ymag=HALF)
_FLOOR: Mesh = [grid((-1, 0, 1), (2, 0, 0), (0, 0, -2), 6, 0)]
_FLOOR_MATERIAL = Material(base_color=(0.5, 0.6, 0.7, 1.0), roughness=ROUGHNESS)
_GLOWING = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=(5.0, 4.0, 3.0))


def _view(count: int) -> F64:
    """Points all over the view, f64[count^2, 3]."""
    steps = (np.arange(count) + 0.5) / count * 2 - 1
    x, z = (axis.ravel() * HALF for axis in np.meshgrid(steps, steps))
    return np.stack([x, 0 * x, z], axis=1)


def _towards(points: F64, place: F64) -> tuple[F64, F64]:
    """Unit directions in the floor's frame (z up) and squared distances."""
    way = place - points
    squared = (way**2).sum(axis=-1)
    way = way / np.sqrt(squared)[..., None]
    return way[..., [0, 2, 1]], squared


def _check(renderer: Renderer, lamp: PunctualLight, expected: F64, what: str) -> None:
    image = Rig(scene([_FLOOR], [_FLOOR_MATERIAL], [_EYE], punctual=[lamp]), renderer).render(width=12, height=12, samples=400, depth=2)
    expect_mean(image, expected * (1 - TOLERANCE), expected * (1 + TOLERANCE), what)


def a_point_light(renderer: Renderer) -> None:
    """Intensity by the squared distance."""
    place, power = np.array([0.3, 1.0, 0.1]), np.array([4.0, 5.0, 6.0])
    wi, squared = _towards(_view(128), place)
    light = value(FLOOR, 0.0, ROUGHNESS, np.broadcast_to(_UP, wi.shape), wi) * (wi[:, 2] / squared)[:, None] * power
    lamp = PunctualLight(kind="point", position=(0.3, 1.0, 0.1), color=(4.0, 5.0, 6.0))
    _check(renderer, lamp, light.mean(axis=0), "a point light above a floor")


def spots(renderer: Renderer) -> None:
    """KHR_lights_punctual: the square of how far the cosine has come from the outer cone's to the inner one's."""
    for inner, outer in ((0.0, 0.15), (0.1, 0.3)):
        wi, squared = _towards(_view(256), np.array([0.0, 1.5, 0.0]))
        fade = np.clip((wi[:, 2] - math.cos(outer)) / (math.cos(inner) - math.cos(outer)), 0, 1) ** 2
        light = value(FLOOR, 0.0, ROUGHNESS, np.broadcast_to(_UP, wi.shape), wi) * (wi[:, 2] * fade * 10.0 / squared)[:, None]
        lamp = PunctualLight(
            kind="spot", position=(0.0, 1.5, 0.0), direction=(0.0, -1.0, 0.0), color=(10.0,) * 3, inner_cone=inner, outer_cone=outer
        )
        _check(renderer, lamp, light.mean(axis=0), f"a spot of cones {inner} and {outer}")


def a_sun(renderer: Renderer) -> None:
    """Irradiance times cosine."""
    direction = np.array([-0.6, -0.8, 0.0])
    wi = np.array([[0.6, 0.0, 0.8]])
    light = value(FLOOR, 0.0, ROUGHNESS, _UP[None], wi) * 0.8 * np.array([3.0, 2.0, 1.0])
    lamp = PunctualLight(kind="directional", direction=tuple(direction), color=(3.0, 2.0, 1.0))
    _check(renderer, lamp, light[0], "a sun above a floor")


def a_glowing_rectangle(renderer: Renderer) -> None:
    """An area light that shines down, in front alone: the integral over all pairs of points."""
    for facing in (True, False):
        one, other = ((0.8, 0, 0), (0, 0, 0.6)) if facing else ((0, 0, 0.6), (0.8, 0, 0))
        source = scene([_FLOOR, [grid((-0.3, 0.6, -0.3), one, other, 1, 1)]], [_FLOOR_MATERIAL, _GLOWING], [_EYE])
        image = Rig(source, renderer, 12).render(width=12, height=12, samples=900, depth=2)
        if facing:
            _expect_light_of_rectangle(image, "a glowing rectangle above a floor")
        else:
            expect(not image.beauty.any(), "a rectangle whose back is turned to the floor lights it")


def instances_of_a_far_rectangle(renderer: Renderer) -> None:
    """The same one, made far away from where it is placed, and once more where it hardly counts: the caster carries rays to where it was made."""
    away = 3_000.0
    rectangle = [grid((-0.3 - away, 0.6 + away, -0.3), (0.8, 0, 0), (0, 0, 0.6), 1, 1)]
    placed = [(0, moved(0, 0, 0)), (1, moved(away, -away, 0)), (1, moved(away + 30, -away, 0))]
    source = scene([_FLOOR, rectangle], [_FLOOR_MATERIAL, _GLOWING], [_EYE], placed=placed)
    image = Rig(source, renderer, 12).render(width=12, height=12, samples=900, depth=2)
    _expect_light_of_rectangle(image, f"an instance of a glowing rectangle, made {away:g} away")


def _expect_light_of_rectangle(image: Rendered, what: str) -> None:
    steps = (np.arange(48) + 0.5) / 48
    s, t = (axis.ravel() for axis in np.meshgrid(steps, steps))
    points = np.stack([-0.3 + 0.8 * s, np.full_like(s, 0.6), -0.3 + 0.6 * t], axis=1)
    wi, squared = _towards(_view(24)[:, None, :], points[None, :, :])
    geometry = wi[..., 2] ** 2 / squared * (0.8 * 0.6 / len(points))
    light = value(FLOOR, 0.0, ROUGHNESS, np.broadcast_to(_UP, wi.shape), wi) * geometry[..., None]
    expected = light.sum(axis=1).mean(axis=0) * np.array(_GLOWING.emissive)
    expect_mean(image, expected * (1 - TOLERANCE), expected * (1 + TOLERANCE), what)


def a_mirror(renderer: Renderer) -> None:
    """A polished conductor at 45 degrees, in which there is nothing but a glowing wall."""
    color, radiance = np.array([0.9, 0.6, 0.3]), np.array([1.0, 2.0, 3.0])
    metal = Material(base_color=(0.9, 0.6, 0.3, 1.0), metallic=1.0, roughness=0.0)
    glowing = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=(1.0, 2.0, 3.0))
    eye = looking((0, 1, 1), (0, 0, 0), kind="orthographic", ymag=0.2)
    side, up = np.array([4.0, 0, 0]), np.array([0, 4.0, 4.0]) / math.sqrt(2)
    wall = grid(np.array([0, 2, -2]) - side / 2 - up / 2, side, up, 1, 1)
    image = Rig(scene([_mirror_floor(), [wall]], [metal, glowing], [eye]), renderer, 12).render(width=12, height=12, samples=64, depth=2)
    expected = radiance * fresnel(color, math.sqrt(0.5))
    expect_mean(image, expected * (1 - TOLERANCE), expected * (1 + TOLERANCE), "a mirror")


def _mirror_floor() -> Mesh:
    return [grid((-1, 0, 1), (2, 0, 0), (0, 0, -2), 2, 0)]


def what_shines_is_seen(renderer: Renderer) -> None:
    """With one segment a path shows emission and sky, and nothing else; a black lamp in front of a grey sky."""
    lamp = Material(base_color=(0.8, 0.8, 0.8, 1.0), emissive=(7.0, 5.0, 3.0))
    eye = looking((0, 0, 2), (0, 0, 0), kind="orthographic", ymag=1.0)
    source = scene([[grid((-1, -1, 0), (1, 0, 0), (0, 2, 0), 1, 0)]], [lamp], [eye])
    image = Rig(source, renderer, 12).render(width=16, height=16, samples=8, depth=1, sky=(0.5, 0.25, 0.125))
    for columns, radiance, what in ((slice(0, 8), (7.0, 5.0, 3.0), "the lamp"), (slice(8, 16), (0.5, 0.25, 0.125), "the sky")):
        seen = image.beauty[:, columns].reshape(-1, 3)
        expect(np.abs(seen / radiance - 1).max() < 1e-3, f"{what} is seen as {seen.mean(axis=0)}, expected {radiance}")


STATISTICAL = {
    "a point light": a_point_light,
    "spots": spots,
    "a sun": a_sun,
    "a glowing rectangle": a_glowing_rectangle,
    "instances of a rectangle made far away": instances_of_a_far_rectangle,
    "a mirror": a_mirror,
    "what shines is seen": what_shines_is_seen,
}
