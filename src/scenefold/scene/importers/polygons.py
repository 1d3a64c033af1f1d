"""Cuts an OBJ's polygons of five and more corners into triangles by clipping ears.

trimesh cuts them as fans, which turns a concave polygon inside out.
"""

from __future__ import annotations

import math
import re

FACE_OF_MANY = re.compile(r"^[ \t]*f(?:[ \t]+[^ \t\n]+){5}", re.MULTILINE)
_STEPS_MAX = 10_000_000
"""Corners looked at for one file: some seconds. Clipping ears takes the square of a polygon's corners, or worse; beyond this fans must do."""
Point = tuple[float, float, float]
Flat = tuple[float, float]


def split_polygons(text: str) -> str:
    """The text of an OBJ whose indices count from the start, with triangles in place of larger polygons."""
    lines = text.replace("\\\n", " ").split("\n")
    points = [_point(line) for line in lines if line.lstrip().startswith(("v ", "v\t"))]
    steps = 0
    for at, line in enumerate(lines):
        words = line.split()
        if len(words) > 5 and words[0] == "f":
            corners = words[1:]
            triangles, taken = clip_ears([_place(points, corner) for corner in corners], _STEPS_MAX - steps)
            steps += taken
            lines[at] = "\n".join(f"f {corners[a]} {corners[b]} {corners[c]}" for a, b, c in triangles)
    return "\n".join(lines)


def _point(line: str) -> Point:
    try:
        x, y, z = (float(word) for word in line.split()[1:4])
    except ValueError:
        # The reader behind us says what is wrong with it.
        return math.nan, math.nan, math.nan
    return x, y, z


def _place(points: list[Point], corner: str) -> Point:
    number = corner.split("/", 1)[0]
    known = number.isascii() and number.isdigit() and 1 <= int(number[:10]) <= len(points)
    return points[int(number[:10]) - 1] if known else (math.nan, math.nan, math.nan)


def clip_ears(polygon: list[Point], steps_max: int = _STEPS_MAX) -> tuple[list[tuple[int, int, int]], int]:
    """Triangles (corner numbers) of a simple polygon, and the steps it took; a fan where it is none, or takes too long."""
    left = list(range(len(polygon)))
    flat = _flattened(polygon)
    triangles: list[tuple[int, int, int]] = []
    steps = 0
    while flat is not None and len(left) > 3 and steps < steps_max:
        ear = None
        for at in range(len(left)):
            steps += len(left)
            if _is_ear(flat, left, at):
                ear = at
                break
            if steps >= steps_max:
                break
        if ear is None:
            break
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*triangles, *((left[0], left[at], left[at + 1]) for at in range(1, len(left) - 1))], steps


def _flattened(polygon: list[Point]) -> list[Flat] | None:
    """The polygon along its normal's largest axis, counter-clockwise; None without area or with odd points."""
    normal = [0.0, 0.0, 0.0]
    for here, there in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        for axis in range(3):
            second, third = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] += (here[second] - there[second]) * (here[third] + there[third])
    if not all(math.isfinite(part) for part in normal) or not any(normal):
        return None
    axis = max(range(3), key=lambda part: abs(normal[part]))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    if normal[axis] < 0:
        first, second = second, first
    return [(point[first], point[second]) for point in polygon]


def _is_ear(flat: list[Flat], left: list[int], at: int) -> bool:
    before, here, after = flat[left[at - 1]], flat[left[at]], flat[left[(at + 1) % len(left)]]
    if _turn(before, here, after) <= 0:
        return False
    others = (flat[number] for number in left if flat[number] not in (before, here, after))
    return not any(
        _turn(before, here, other) >= 0 and _turn(here, after, other) >= 0 and _turn(after, before, other) >= 0 for other in others
    )


def _turn(first: Flat, second: Flat, third: Flat) -> float:
    return (second[0] - first[0]) * (third[1] - first[1]) - (second[1] - first[1]) * (third[0] - first[0])
