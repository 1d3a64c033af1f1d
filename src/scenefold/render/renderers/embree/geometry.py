"""The geometry that a node holds for a job, as one Embree scene.

Groups of prototype 0 are triangle geometries of the top scene itself, each under its group number. Every other
prototype is a scene of its own, attached once for each of its instances; so an instance is always
intersected in its prototype's space, with the matrix as it was stored.

Embree rounds an instance's box when it carries that into the world, so that rays which only touch the instance
would meet it or miss it by what of it is held. Two triangles without area, a little outside, widen each prototype.
"""

from __future__ import annotations

import numpy as np

from scenefold.render.arrays import F32, F64
from scenefold.render.contract import HeldScene
from scenefold.render.renderers.embree.library import Device
from scenefold.render.renderers.embree.margins import widened_boxes
from scenefold.render.renderers.embree.tree_memory import TreeMemory
from scenefold.render.see_through_kernels import is_see_through

_MARGIN_TRIANGLES = np.array([[0, 1, 2], [3, 4, 5]], np.uint32)


class HeldGeometry:
    """Embree's trees over the held groups. `close()` frees them; the arrays must live as long as this."""

    def __init__(self, scene: HeldScene, memory: TreeMemory | None = None) -> None:
        """`memory`: what the trees may take; NoRoomForTrees if that is too little."""
        self._device = Device(memory)
        self._top = self._device.new_scene()
        self._prototypes: dict[int, int] = {}
        try:
            self._build(scene)
        except BaseException:
            self.close()
            raise

    def _build(self, scene: HeldScene) -> None:
        arrays = scene.arrays
        self.has_see_through = False
        """Whether any held triangle may let rays pass: else nobody needs to draw numbers for that."""
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
        self._margins: list[F32] = []
        boxes = widened_boxes(scene)
        for prototype, target in self._prototypes.items():
            self._widen(target, *boxes[prototype])
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

    def _widen(self, target: int, low: F64, high: F64) -> None:
        margin = np.zeros((7, 3), np.float32)  # one row more than is used: Embree loads four floats at once
        margin[:3], margin[3:6] = low, high
        self._margins.append(margin)
        self._device.add_triangles(target, self.first_instance_id, margin[:6], _MARGIN_TRIANGLES)

    def _prototype_scene(self, prototype: int) -> int:
        if prototype not in self._prototypes:
            self._prototypes[prototype] = self._device.new_scene()
        return self._prototypes[prototype]
