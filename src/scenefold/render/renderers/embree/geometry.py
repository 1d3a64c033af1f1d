"""The geometry that a node holds for a job, as one Embree scene.

Groups of prototype 0 are triangle geometries of the top scene itself, each under its group number. Every other
prototype is a scene of its own, attached once for each of its instances; so an instance is always
intersected in its prototype's space, with the matrix as it was stored.
"""

from __future__ import annotations

import numpy as np

from scenefold.render.contract import HeldScene
from scenefold.render.renderers.embree.library import Device
from scenefold.render.see_through_kernels import is_see_through


class HeldGeometry:
    """Embree's trees over the held groups. `close()` frees them; the arrays must live as long as this."""

    def __init__(self, scene: HeldScene) -> None:
        self._scene = scene
        arrays = scene.arrays
        self._device = Device()
        self._top = self._device.new_scene()
        self._prototypes: dict[int, int] = {}
        self.has_see_through = False
        """Whether any held triangle may let rays pass: else shadow rays need no filter."""
        see_through_materials = np.array([is_see_through(row) for row in arrays.materials])
        self.first_instance_id = int(arrays.group_first.shape[0])
        for held in scene.groups:
            target = self._top if held.prototype == 0 else self._prototype_scene(held.prototype)
            first = int(arrays.group_first[held.group])
            see_through = bool(see_through_materials[arrays.triangle_material[first : first + held.triangles]].any())
            self.has_see_through = self.has_see_through or see_through
            self._device.add_triangles(
                target, held.group, arrays.vertices, arrays.triangles[first : first + held.triangles], int(see_through)
            )
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
