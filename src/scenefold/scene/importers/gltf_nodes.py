"""The node graph of a glTF: world matrices of meshes, cameras and lights, walked without recursion."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from scenefold.base.limits import COORDINATE_ABS_MAX, INSTANCES_MAX
from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_animations import Pose
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.matrices import Matrix, from_many_parts, from_parts, product, rigid
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.punctual import LightKind, PunctualLight

_LIGHTS: dict[str, LightKind] = {"point": "point", "spot": "spot", "directional": "directional"}
_NONE = (0.0,) * 16
_NAME_LETTERS_MAX = 40
_AFFINE_ERROR_MAX = 1e-3
_ROUNDING = 1e-6
"""What f32 makes of a right angle, and the like."""
_CONE_EDGE = 1e-4
"""Radians between the cones of a spot: what is less looks as hard."""
_VIEW_EDGE = 1e-6
"""Radians between an angle of view and the ends of its range, 0 and pi, which it may not reach."""
_FAR = 1e300
_MOVED = "numbers of cameras and lights outside their range, moved to its end"
_UNTURNED = "rotations that are none, left out"


@dataclass(slots=True)
class Placements:
    """What the walk found."""

    meshes: list[int] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)
    """The node of each."""
    matrices: list[Matrix] = field(default_factory=list)
    as_instances: list[bool] = field(default_factory=list)
    """Whether the file itself says that it is one of many copies (EXT_mesh_gpu_instancing)."""
    cameras: list[Camera] = field(default_factory=list)
    punctual: list[PunctualLight] = field(default_factory=list)
    worlds: dict[int, Matrix] = field(default_factory=dict)
    """Node -> world of every node that the scene shows, where the file has skins."""


class Names:
    """Names that are all different."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._last: dict[str, int] = {}
        """The highest number that a name was given, so that nobody counts up to it again."""

    def unused(self, name: str) -> str:
        """The name, or with a number behind it where it is taken already."""
        unused, count = name, self._last.get(name, 1)
        while unused in self._taken:
            count += 1
            unused = f"{name} {count}"
        self._taken.add(unused)
        self._last[name] = count
        return unused


class NodeWalk:
    """One walk over the default scene."""

    def __init__(self, file: GltfFile, accessors: Accessors, left: NotCarried, pose: Pose) -> None:
        self._json = file.json
        self._pose = pose
        self._has_skins = bool(file.json.maps("skins"))
        self._accessors = accessors
        self._left = left
        self._nodes = file.json.maps("nodes")
        self._meshes = len(file.json.maps("meshes"))
        self._cameras = file.json.maps("cameras")
        lights = file.json.extension("KHR_lights_punctual")
        self._lights = lights.maps("lights") if lights else []
        self._names = Names()
        self._found = Placements()

    def walk(self) -> Placements:
        seen = [False] * len(self._nodes)
        waiting = [(number, np.eye(4)) for number in reversed(self._roots())]
        while waiting:
            number, above = waiting.pop()
            node = self._nodes[number]
            if seen[number]:
                raise node.fault("is reached twice: nodes must form a tree")
            seen[number] = True
            world = product(above, self._local(number, node))
            if not (np.abs(world) <= COORDINATE_ABS_MAX).all():
                raise node.fault("has a transform that is not finite or beyond measure")
            if self._has_skins:
                self._found.worlds[number] = world
            self._visit(number, node, world)
            children = node.indices("children", len(self._nodes), "node")
            waiting += [(child, world) for child in reversed(children)]
        return self._found

    def _roots(self) -> list[int]:
        scenes = self._json.maps("scenes")
        chosen = self._json.index("scene", len(scenes), "scene")
        if scenes:
            self._left.note("scenes of the file that are not the one it shows", len(scenes) - 1)
            return scenes[max(chosen, 0)].indices("nodes", len(self._nodes), "node")
        # Without scenes, the file is a library of nodes: show all that are nobody's child.
        children = {child for node in self._nodes for child in node.indices("children", len(self._nodes), "node")}
        return [number for number in range(len(self._nodes)) if number not in children]

    def _local(self, number: int, node: JsonMap) -> Matrix:
        place, turn, size = (self._pose.of(number, path) for path in ("translation", "rotation", "scale"))
        if node.has("matrix"):
            # Stored column by column.
            matrix = np.array(node.numbers("matrix", _NONE)).reshape(4, 4).T.copy()
            if not place is turn is size is None:
                raise node.fault("has a matrix, which no animation can move", "matrix")
            if np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)).max() > _AFFINE_ERROR_MAX:
                raise node.fault("is no affine transform", "matrix")
            # What a program wrote by rounding.
            self._left.note("matrices that are affine but for rounding, made so", int(matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]))
            matrix[3] = 0.0, 0.0, 0.0, 1.0
            return matrix
        rotation = turn or node.numbers("rotation", (0.0, 0.0, 0.0, 1.0))
        if not 1e-6 < sum(value * value for value in rotation) < 1e6:
            self._left.note(_UNTURNED)
            rotation = (0.0, 0.0, 0.0, 1.0)
        return from_parts(place or node.numbers("translation", (0.0, 0.0, 0.0)), rotation, size or node.numbers("scale", (1.0, 1.0, 1.0)))

    def _visit(self, number: int, node: JsonMap, world: Matrix) -> None:
        mesh = node.index("mesh", self._meshes, "mesh")
        if mesh >= 0:
            copies = self._copies(node, world)
            self._found.meshes += [mesh] * len(copies)
            self._found.nodes += [number] * len(copies)
            self._found.matrices += copies
            self._found.as_instances += [node.extension("EXT_mesh_gpu_instancing") is not None] * len(copies)
            if len(self._found.meshes) > INSTANCES_MAX:
                raise self._json.fault(f"places more than {INSTANCES_MAX} meshes", "nodes")
        camera = node.index("camera", len(self._cameras), "camera")
        if camera >= 0:
            name = node.text("name", "") or self._cameras[camera].text("name", "") or f"camera {number}"
            found = self._camera(self._cameras[camera], name, world)
            if found is not None:
                self._found.cameras.append(replace(found, name=self._names.unused(name)))
        light = node.extension("KHR_lights_punctual")
        if light is not None:
            which = light.index("light", len(self._lights), "light")
            if which < 0:
                raise light.fault("is missing", "light")
            self._light(self._lights[which], node, world)

    def _copies(self, node: JsonMap, world: Matrix) -> list[Matrix]:
        instancing = node.extension("EXT_mesh_gpu_instancing")
        if instancing is None:
            return [world]
        attributes = instancing.inner("attributes")
        kinds = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
        columns = {}
        for key in attributes.keys():  # noqa: SIM118, a JsonMap is no dict
            if key not in kinds:
                self._left.note(f"the instance attribute {key[:_NAME_LETTERS_MAX]}")
        for key, kind in kinds.items():
            accessor = attributes.index(key, len(self._accessors), "accessor")
            if accessor >= 0:
                if self._accessors.count(accessor) > INSTANCES_MAX:
                    raise instancing.fault(f"has more than {INSTANCES_MAX} instances")
                columns[key] = self._accessors.doubles(accessor, kind)
        counts = {len(column) for column in columns.values()}
        if len(counts) != 1:
            raise instancing.fault("has attributes of different counts, or none")
        count = counts.pop()
        places = columns.get("TRANSLATION", np.zeros((count, 3)))
        turns = columns.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
        scales = columns.get("SCALE", np.ones((count, 3)))
        if not all(np.isfinite(part).all() for part in (places, turns, scales)):
            raise instancing.fault("has an instance whose transform is none")
        unturned = (turns**2).sum(axis=1) <= 1e-6
        self._left.note(_UNTURNED, int(unturned.sum()))
        turns = np.where(unturned[:, None], (0.0, 0.0, 0.0, 1.0), turns)
        copies = product(world, from_many_parts(places, turns, scales))
        if not (np.abs(copies) <= COORDINATE_ABS_MAX).all():
            raise instancing.fault("has a transform that is beyond measure")
        return list(copies)

    def _camera(self, entry: JsonMap, name: str, world: Matrix) -> Camera | None:
        """None if its node leaves it nowhere to look."""
        matrix = rigid(world)
        if matrix is None:
            # A mirror would turn its right into its left; where it stands, looks and has its up stays.
            matrix = rigid(world * np.array([-1.0, 1.0, 1.0, 1.0]))
            self._left.note("cameras under a flat transform" if matrix is None else "mirrored cameras, shown unmirrored")
        if matrix is None:
            return None
        kind = entry.text("type")
        if kind == "perspective":
            view = entry.inner(kind)
            yfov = view.number("yfov")
            near, far = view.number("znear", 0.0), view.number("zfar", _FAR)
            aspect = view.number("aspectRatio", 0.0)
            self._left.note(_MOVED, int(not 0.0 < yfov < math.pi))
            yfov = min(max(yfov, _VIEW_EDGE), math.pi - _VIEW_EDGE)
            return Camera(name, matrix, yfov=yfov, aspect=self._bounded(aspect, 0.0, 1e6), near=self._near(near, far))
        if kind != "orthographic":
            raise entry.fault(f"is the unknown {kind!r}", "type")
        view = entry.inner(kind)
        xmag, ymag = abs(view.number("xmag")), abs(view.number("ymag"))
        near, far = view.number("znear", 0.0), view.number("zfar", _FAR)
        if not (xmag > 0 and ymag > 0 and xmag / ymag <= 1e6 and ymag < COORDINATE_ABS_MAX):
            raise view.fault(f"has xmag {xmag}, ymag {ymag}: a view without size")
        return Camera(name, matrix, "orthographic", ymag=ymag, aspect=xmag / ymag, near=self._near(near, far))

    def _near(self, near: float, far: float) -> float:
        """Nothing is cut off there when rendering, so two planes that contradict each other are no reason to refuse a file."""
        if 0 <= near < far:
            return near
        self._left.note("near and far planes of cameras that contradict each other")
        return 0.0

    def _bounded(self, value: float, least: float, most: float) -> float:
        self._left.note(_MOVED, int(not least - _ROUNDING <= value <= most + _ROUNDING))
        return min(max(value, least), most)

    def _light(self, entry: JsonMap, node: JsonMap, world: Matrix) -> None:
        kind = entry.text("type")
        if kind not in _LIGHTS:
            raise entry.fault(f"is the unknown {kind!r}", "type")
        intensity = entry.number("intensity", 1.0)
        tint = entry.numbers("color", (1.0, 1.0, 1.0))
        intensity, tint = self._bounded(intensity, 0.0, 1e30), tuple(self._bounded(part, 0.0, 1e30) for part in tint)
        if intensity * max(tint) > 1e30:
            raise entry.fault("has a colour that is beyond measure")
        axis = -world[:3, 2]
        length = math.sqrt(float((axis**2).sum()))
        if length == 0 and kind != "point":
            self._left.note("lights whose transform leaves them no direction")
            return
        way = (axis / length).tolist() if length else [0.0, 0.0, -1.0]
        spot = entry.inner("spot")
        inner, outer = spot.number("innerConeAngle", 0.0), spot.number("outerConeAngle", math.pi / 4)
        outer = max(self._bounded(outer, 0.0, math.pi / 2), 2.0 * _CONE_EDGE)
        # A hard edge is written as two cones alike.
        inner = min(self._bounded(inner, 0.0, outer), outer - _CONE_EDGE)
        place = world[:3, 3].tolist()
        light = PunctualLight(
            name=node.text("name", "") or entry.text("name", ""),
            kind=_LIGHTS[kind],
            position=(place[0], place[1], place[2]),
            direction=(way[0], way[1], way[2]),
            color=(tint[0] * intensity, tint[1] * intensity, tint[2] * intensity),
            inner_cone=inner,
            outer_cone=outer,
            range=max(entry.number("range", 0.0), 0.0),
        )
        self._found.punctual.append(light)
