"""What a surface scatters: layers, each a file of its own, over a body. In lanes.

The file of a layer, and that of the body, has three functions; each layer also has a field `pick` in what `seen` gives it, the
probability with which directions are drawn from it and not from what lies below, 0 where a material has no such layer:

    seen(hit)                            the layer as it is seen from where the ray comes; hit: `Hit`
    value(seen, wx, wy, wz, below)       (r, g, b, density, cosine) for light from the unit direction w
    draw(seen, lobe, u, v)               (x, y, z, whether it leaves): a direction by three numbers in [0, 1), on either side

`below` is `value` of what lies below, and the layer says how much of that it lets through; the body's `value` has none. A value is the BSDF without
its cosine, the density that of `draw`. Where `scatters_through` says so, w may lie on the other side of the geometric normal than the
viewer, and the layers give what comes through; elsewhere values of such directions mean nothing. What is linked here is one kernel for the compiler: a layer costs no call.
"""

from __future__ import annotations

from typing import Any, Final

from numba import njit

from scenefold.render import clear_coat_kernels as clear_coat
from scenefold.render import metallic_roughness_kernels as metallic_roughness
from scenefold.render import transmission_kernels as transmission
from scenefold.render.lane_values_kernels import any_lane, select

_BODY = (metallic_roughness.seen, metallic_roughness.value, metallic_roughness.draw)
_LAYERS: Final = (
    (clear_coat.seen, clear_coat.value, clear_coat.draw),
    (transmission.seen, transmission.value, transmission.draw),
)  # fmt: skip
"""From the top down. A new one is a line here."""
_LEAST = 1e-9


def _over(layer: tuple[Any, Any, Any], below: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
    """The three functions of a layer together with what lies below it."""
    layer_seen, layer_value, layer_draw = layer
    below_seen, below_value, below_draw = below

    @njit(error_model="numpy", _nrt=False, forceinline=True)
    def seen(hit):  # type: ignore[no-untyped-def]
        return layer_seen(hit), below_seen(hit)

    @njit(error_model="numpy", _nrt=False, forceinline=True)
    def value(both, wx, wy, wz):  # type: ignore[no-untyped-def]
        return layer_value(both[0], wx, wy, wz, below_value(both[1], wx, wy, wz))

    @njit(error_model="numpy", _nrt=False, forceinline=True)
    def draw(both, lobe, u, v):  # type: ignore[no-untyped-def]
        pick = both[0].pick
        x, y, z, leaves = below_draw(both[1], (lobe - pick) / (1.0 - pick), u, v)
        mine = lobe < pick
        if any_lane(mine):
            a, b, c, goes = layer_draw(both[0], lobe / max(pick, _LEAST), u, v)
            x, y, z, leaves = select(mine, a, x), select(mine, b, y), select(mine, c, z), select(mine, goes, leaves)
        return x, y, z, leaves

    return seen, value, draw


def _linked() -> tuple[Any, Any, Any]:
    whole = _BODY
    for layer in reversed(_LAYERS):
        whole = _over(layer, whole)
    return whole


seen, value, draw = _linked()
