"""The geometry that a node holds for a job, as one Embree scene.

Groups of prototype 0 are triangle geometries of the top scene itself, each under its group number. Every other
prototype is a scene of its own, attached once for each of its instances; so an instance is always
intersected in its prototype's space, with the matrix as it was stored.
"""

from __future__ import annotations

import numpy as np

from scenefold.render.contract import HeldScene
from scenefold.render.renderers.embree.library import Device


class HeldGeometry:
    """Embree's trees over the held groups. `close()` frees them; the arrays must live as long as this."""

    def __init__(self, scene: HeldScene) -> None:
        self._scene = scene
        arrays = scene.arrays
        self._device = Device()
        self._top = self._device.new_scene()
        self._prototypes: dict[int, int] = {}
        self.first_instance_id = int(arrays.group_first.shape[0])
        for held in scene.groups:
            target = self._top if held.prototype == 0 else self._prototype_scene(held.prototype)
            first = int(arrays.group_first[held.group])
            self._device.add_triangles(target, held.group, arrays.vertices, arrays.triangles[first : first + held.triangles])
        for target in self._prototypes.values():
            self._device.commit(target)
        for instance, prototype in scene.instances:
            if prototype in self._prototypes:
                matrix = arrays.instance_matrices[instance].astype(np.float32)
                self._device.add_instance(self._top, self.first_instance_id + instance - 1, self._prototypes[prototype], matrix)
        self._device.commit(self._top)
        self._device.check("building the trees")

    @property
    def scene_address(self) -> int:
        """The top scene, for rtcIntersect1 and rtcOccluded1."""
        return self._top

    def close(self) -> None:
        """Free all trees."""
        self._device.release(self._top, *self._prototypes.values())

    def _prototype_scene(self, prototype: int) -> int:
        if prototype not in self._prototypes:
            self._prototypes[prototype] = self._device.new_scene()
        return self._prototypes[prototype]
