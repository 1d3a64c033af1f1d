"""The animations of a glTF at one moment: what they make of the translations, rotations, scales and weights of nodes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.faults import bad_file
from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.keyframes import Interpolation, Numbers, Track
from scenefold.scene.importers.moments import Moment
from scenefold.scene.importers.source import NotCarried

_KINDS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3", "weights": "SCALAR"}
_VALUES_MAX = 100_000_000
"""Numbers in all tracks that are read: channels may share an accessor thousands of times."""
_NAME_LETTERS_MAX = 40
_NAMES_SHOWN = 8


@dataclass(frozen=True, slots=True)
class Pose:
    """What moves at one moment, by node and path; what is not here stands as its node says."""

    moved: dict[tuple[int, str], Numbers] = field(default_factory=dict)

    def of(self, node: int, path: str) -> Numbers | None:
        """The animated value of a node: 3 numbers, 4 of a rotation (a unit), or one for each morph target. None: it is not animated."""
        return self.moved.get((node, path))


def read_pose(file: GltfFile, accessors: Accessors, left: NotCarried, moment: Moment) -> Pose:
    """The pose at a moment. LocalFault if nothing moves then, or a track that is needed is wrong.

    All animations play together, or the one that the moment names. Of two channels for one value the first in the file counts.
    """
    animations = file.json.maps("animations")
    pose, read = Pose(), 0
    if moment.time_s is None:
        left.note("animations, shown at rest", len(animations))
        return pose
    nodes = len(file.json.maps("nodes"))
    for animation in _playing(file, animations, moment):
        samplers = animation.maps("samplers")
        for channel in animation.maps("channels"):
            target = channel.inner("target")
            node, path = target.index("node", nodes, "node"), target.text("path")
            if node < 0 or path not in _KINDS:
                left.note(f"animation channels of {path[:_NAME_LETTERS_MAX]}{'' if node >= 0 else ' without a node'}")
            elif (node, path) in pose.moved:
                left.note("animation channels of what an earlier one moves")
            else:
                which = channel.index("sampler", len(samplers), "sampler")
                if which < 0:
                    raise channel.fault("is missing", "sampler")
                track = _track(samplers[which], accessors, path)
                read += track.values.size
                if read > _VALUES_MAX:
                    raise channel.fault(f"brings the file to more than {_VALUES_MAX} numbers in keyframes")
                pose.moved[node, path] = track.at(moment.time_s)
    return pose


def _playing(file: GltfFile, animations: list[JsonMap], moment: Moment) -> list[JsonMap]:
    if not animations:
        raise bad_file(file.path, "the file has no animation, so every moment of it looks the same", "give neither a time nor a frame")
    if moment.animation is None:
        return animations
    names = [animation.text("name", "") for animation in animations]
    named = [animation for animation, name in zip(animations, names, strict=True) if name == moment.animation]
    if not named:
        there = ", ".join(repr(name[:_NAME_LETTERS_MAX]) for name in names[:_NAMES_SHOWN] if name) or "none with a name"
        raise bad_file(file.path, f"the file has no animation {moment.animation!r}", f"choose one of those that it has: {there}")
    return named


def _track(sampler: JsonMap, accessors: Accessors, path: str) -> Track:
    text = sampler.text("interpolation", Interpolation.LINEAR)
    if text not in set(Interpolation):
        raise sampler.fault(f"is the unknown {text!r}", "interpolation")
    interpolation = Interpolation(text)
    times = _floats(sampler, accessors, "input", "SCALAR")[:, 0]
    values = _floats(sampler, accessors, "output", _KINDS[path])
    if not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise sampler.fault("has times that are not finite, or fall", "input")
    if not np.isfinite(values).all():
        raise sampler.fault("has values that are not finite", "output")
    parts = 3 if interpolation is Interpolation.CUBICSPLINE else 1
    rows = len(times) * parts
    if len(values) % rows or (path != "weights" and len(values) != rows):
        raise sampler.fault(f"has {len(values)} values for {len(times)} keyframes")
    # Of weights, each keyframe has one for each morph target.
    shaped = values.reshape(len(times), parts, -1)
    if parts == 1:
        shaped = np.broadcast_to(shaped, (len(times), 3, shaped.shape[2]))
    if path == "rotation" and not ((shaped[:, 1] ** 2).sum(axis=1) > 1e-6).all():
        raise sampler.fault("has a rotation that is none", "output")
    return Track(times, shaped, interpolation, turns=path == "rotation")


def _floats(sampler: JsonMap, accessors: Accessors, key: str, kind: str) -> NDArray[np.float64]:
    where = sampler.index(key, len(accessors), "accessor")
    if where < 0:
        raise sampler.fault("is missing", key)
    return accessors.doubles(where, kind)
