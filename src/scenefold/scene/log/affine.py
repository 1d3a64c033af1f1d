"""What a log has done to a space so far: one factor for all axes, then an offset (specs/16-scene-log.md, Transforms).

    world = home · factor + offset            home = (world - offset) / factor

`home` is where a point lay when the space was created, in the box of its lattice; `world` is where it lies now.
Every step is monotone in every coordinate, in float64 too: a point inside a box is carried to a point inside the
carried box. So a query that carries its box back finds whatever was put with the very same arithmetic.

Steps are composed exactly and rounded once, so there and back again is where it began, however far it went.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from scenefold.scene.log.dyadic import Dyadic

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class Affine:
    """A uniform scale about the world's origin, then a translation."""

    factor: float
    offset: tuple[float, ...]
    exact: tuple[Dyadic, ...] = field(default=(), repr=False, compare=False)
    """Factor and offset before they were rounded; by default as they stand here."""

    @classmethod
    def identity(cls, dimensions: int) -> Self:
        return cls(1.0, (0.0,) * dimensions)

    @property
    def is_identity(self) -> bool:
        return self.factor == 1.0 and not any(self.offset)

    def translated(self, by: tuple[float, ...]) -> Affine:
        """This, and then a translation."""
        return _rounded(*_translated(self._exactly(), by))

    def scaled(self, by: float) -> Affine:
        """This, and then a scale about the world's origin."""
        return _rounded(*_scaled(self._exactly(), by))

    def carried_on(self, steps: Iterable[tuple[float, tuple[float, ...]]]) -> Affine:
        """This, and then many steps, each a factor and an offset: what one at a time gives, and rounded once.

        A scale leaves the offset of its step at 0, a translation the factor at 1: one of the two is nothing.
        """
        begun = exact = self._exactly()
        for factor, offset in steps:
            exact = _scaled(exact, factor) if factor != 1.0 else _translated(exact, offset)
        return self if exact is begun else _rounded(*exact)

    def _exactly(self) -> tuple[Dyadic, ...]:
        return self.exact or tuple(map(Dyadic.of, (self.factor, *self.offset)))

    def apply(self, points: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """World positions float64[..., D] of home positions."""
        import numpy as np

        with np.errstate(over="ignore", invalid="ignore"):
            found: npt.NDArray[np.float64] = np.asarray(points, np.float64) * self.factor + np.asarray(self.offset)
        return found

    def undo(self, points: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Home positions float64[..., D] of world positions."""
        import numpy as np

        with np.errstate(over="ignore", invalid="ignore"):
            found: npt.NDArray[np.float64] = (np.asarray(points, np.float64) - np.asarray(self.offset)) / self.factor
        return found


def _translated(exact: Sequence[Dyadic], by: tuple[float, ...]) -> tuple[Dyadic, ...]:
    factor, *offset = exact
    return (factor, *(here.plus(Dyadic.of(step)) for here, step in zip(offset, by, strict=True)))


def _scaled(exact: Sequence[Dyadic], by: float) -> tuple[Dyadic, ...]:
    step = Dyadic.of(by)
    return tuple(here.times(step) for here in exact)


def _rounded(factor: Dyadic, *offset: Dyadic) -> Affine:
    return Affine(factor.rounded(), tuple(here.rounded() for here in offset), (factor, *offset))
