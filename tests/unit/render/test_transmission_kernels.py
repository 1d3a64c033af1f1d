"""If this fails, light is lost or made on its way through rough walls and glass, or goes elsewhere than its density says."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from make_glass_albedo import albedos

from scenefold.render import glass_albedo
from unit.render import transmission_probe_kernels as probe

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Wall:
    """A surface that lets light through: thin and rough, or the boundary of glass."""

    base: tuple[float, float, float] = (1.0, 1.0, 1.0)
    metallic: float = 0.0
    alpha: float = 0.25
    reflection: tuple[float, float, float, float] = (0.04, 0.04, 0.04, 1.0)
    thin: float = 0.0
    glass: float = 0.0
    ior: float = 1.5
    behind: bool = False

    def _looks(self) -> tuple[object, ...]:
        return (
            np.array(self.base), self.metallic, self.alpha, self.reflection, self.thin, self.glass, self.ior, self.behind,
        )  # fmt: skip

    def evaluate(self, wo: Floats, wi: Floats) -> Floats:
        """Value, density and cosine, f64[n, 5]."""
        found: Floats = probe.evaluations(np.ascontiguousarray(np.broadcast_to(wo, wi.shape)), np.ascontiguousarray(wi), *self._looks())
        return found

    def sample(self, wo: Floats, count: int, seed: int = 1) -> Floats:
        """Directions, f64[n, 3]; 0 where there is none."""
        found: Floats = probe.scattered(wo, *self._looks(), np.random.default_rng(seed).random((count, 3)))
        return found

    def shares(self, wo: Floats, count: int) -> tuple[Floats, Floats]:
        """What each drawn direction brings of an even light, f64[n, 3], and which of them lie beyond."""
        wi = self.sample(wo, count)
        found = self.evaluate(wo, wi)
        good = wi.any(axis=1) & (found[:, 3] > 0)
        weights = np.where(good[:, None], found[:, :3] * found[:, 4:] / np.where(good, found[:, 3], 1.0)[:, None], 0.0)
        return weights, wi[:, 2] < 0


def seen_from(cosine: float) -> Floats:
    sine, turn = math.sqrt(1 - cosine * cosine), 0.7
    return np.array([sine * math.cos(turn), sine * math.sin(turn), cosine])


def everywhere(count: int, seed: int) -> Floats:
    numbers = np.random.default_rng(seed).normal(size=(count, 3))
    found: Floats = numbers / np.linalg.norm(numbers, axis=1)[:, None]
    return found


@pytest.mark.parametrize("cosine", [0.05, 0.2, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("roughness", [0.1, *(pytest.param(each, marks=pytest.mark.long) for each in (0.2, 0.4, 0.8)), 0.3, 0.6, 1.0])
@pytest.mark.parametrize("reflection", [(0.04, 0.04, 0.04, 1.0), (0.2, 0.2, 0.2, 0.6), (0.0, 0.0, 0.0, 0.0)])
@pytest.mark.parametrize("thin", [0.6, 1.0])
def test_a_white_wall_gives_on_all_that_it_gets(thin: float, reflection: tuple[float, ...], roughness: float, cosine: float) -> None:
    count = 100_000
    wall = Wall(alpha=roughness**2, reflection=reflection, thin=thin)  # type: ignore[arg-type]
    weights, _ = wall.shares(seen_from(cosine), count)
    error = 4 * weights.std(axis=0) / math.sqrt(count)
    assert (error < 0.02).all()
    assert (np.abs(weights.mean(axis=0) - 1.0) < 0.004 + error).all(), (weights.mean(axis=0), error)


def test_metal_and_colour_take_from_what_passes() -> None:
    wo, count = seen_from(0.7), 200_000
    plain, beyond = Wall(thin=0.8).shares(wo, count)
    dyed, there = Wall(base=(0.5, 0.25, 1.0), metallic=0.5, thin=0.8).shares(wo, count)
    passed, coloured = plain[beyond].sum(axis=0) / count, dyed[there].sum(axis=0) / count
    assert coloured == pytest.approx(passed * 0.5 * np.array([0.5, 0.25, 1.0]), rel=0.02)


@pytest.mark.parametrize("behind", [False, True])
@pytest.mark.parametrize("cosine", [0.1, 0.4, 0.7, 1.0])
def test_smooth_glass_gives_on_all_that_it_gets(cosine: float, behind: bool) -> None:
    weights, beyond = Wall(alpha=1e-3, glass=1.0, behind=behind).shares(seen_from(cosine), 50_000)
    assert weights.mean(axis=0) == pytest.approx(1.0, abs=2e-3)
    if behind and cosine == 0.4:
        assert not beyond.any(), "all is reflected"


@pytest.mark.parametrize("behind", [False, True])
@pytest.mark.parametrize("ior", [1.1, 1.5, 2.4])
@pytest.mark.parametrize("roughness", [0.2, 0.5, 0.7, 1.0])
def test_rough_glass_gives_on_all_that_it_gets(roughness: float, ior: float, behind: bool) -> None:
    """Of even light, from without and from within; without what comes after several bounces half is lost at worst."""
    wall, count = Wall(alpha=roughness**2, glass=1.0, ior=ior, behind=behind), 20_000
    given = np.array([wall.shares(seen_from(math.sqrt((row + 0.5) / 40)), count)[0].mean() for row in range(40)])
    assert given.mean() == pytest.approx(1.0, abs=4e-3)
    assert given == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("within", [False, True])
def test_what_glass_keeps_is_read_as_it_was_integrated(within: bool) -> None:
    """In the kernel's lanes, in the table's own words, and anew by quadrature."""
    dice = np.random.default_rng(7)
    roughness, cosine, ior = dice.uniform(0.15, 1.0, 40), dice.uniform(0.05, 1.0, 40), dice.uniform(1.05, 2.5, 40)
    read = glass_albedo.kept(roughness, cosine, ior, within=within)
    in_kernel = probe.kept_by_glass(roughness**2, cosine, ior, within)
    assert in_kernel == pytest.approx(read, abs=1e-6)
    for one, (alpha, towards, index) in zip(read, zip(roughness**2, cosine, ior, strict=True), strict=True):
        assert one == pytest.approx(albedos(towards, alpha, [1 / index if within else index], 96)[0], rel=0.012)


def test_the_table_of_glass_is_what_its_tool_prints() -> None:
    """A few of its words, which are integrals at its nodes."""
    words = glass_albedo.TABLE.reshape(glass_albedo.ROUGHNESSES, glass_albedo.COSINES, glass_albedo.INDICES)
    for row, column, index in ((23, 23, 7), (12, 10, 5), (6, 20, 10)):
        root = (index / (glass_albedo.INDICES - 1)) ** 2
        ior, cosine = (1 + root) / (1 - root), (column / (glass_albedo.COSINES - 1)) ** 2
        outer, inner = albedos(cosine, (row / (glass_albedo.ROUGHNESSES - 1)) ** 2, [ior, 1 / ior])
        word = int(words[row, column, index])
        assert (word & 0xFFFF, word >> 16) == (round(outer * 65535), round(inner * 65535))


@pytest.mark.parametrize("eta", [1.5, 1 / 1.5, 1.001])
def test_fresnel_is_that_of_the_equations(eta: float) -> None:
    cosines = np.linspace(0.01, 1, 200)
    inside, outside = cosines.astype(complex), np.sqrt(1 - (1 - cosines**2) / eta**2 + 0j)
    s, p = (inside - eta * outside) / (inside + eta * outside), (eta * inside - outside) / (eta * inside + outside)
    found = probe.reflectances(cosines, eta)
    assert found[:, 0] == pytest.approx((abs(s) ** 2 + abs(p) ** 2) / 2, abs=1e-9)
    assert found[:, 1] == pytest.approx(outside.real, abs=1e-9)


WALLS = {
    "thin": Wall(thin=0.8, alpha=0.16), "dull": Wall(thin=1.0, alpha=1.0, base=(0.9, 0.5, 0.2)),
    "strong": Wall(thin=0.7, alpha=0.5, reflection=(0.2, 0.5, 0.1, 0.8), metallic=0.3), "glass": Wall(glass=1.0, alpha=0.36),
    "dense": Wall(glass=1.0, ior=2.4, alpha=0.6), "within": Wall(glass=1.0, behind=True, alpha=0.36),
    "partly": Wall(glass=0.6, base=(0.8, 0.5, 0.2), alpha=0.5), "partly within": Wall(glass=0.6, alpha=0.5, behind=True),
}  # fmt: skip


@pytest.mark.parametrize("cosine", [0.15, 0.6, 0.99])
@pytest.mark.parametrize("name", WALLS)
def test_directions_on_both_sides_are_drawn_with_the_density_that_is_told(name: str, cosine: float) -> None:
    """Chi-square over 24 x 24 equal solid angles of the whole sphere."""
    wall, wo, count, rows, columns, cuts = WALLS[name], seen_from(cosine), 200_000, 24, 24, 24
    wi = wall.sample(wo, count)
    wi = wi[wi.any(axis=1)]
    counts = np.histogram2d(wi[:, 2], np.arctan2(wi[:, 1], wi[:, 0]), (rows, columns), ((-1, 1), (-np.pi, np.pi)))[0]
    expected = np.zeros((rows, columns))
    for i in range(cuts):
        for j in range(cuts):
            z = (np.arange(rows) + (i + 0.5) / cuts) / rows * 2 - 1
            phi = (np.arange(columns) + (j + 0.5) / cuts) / columns * 2 * np.pi - np.pi
            r = np.sqrt(1 - z * z)
            grid = np.stack([np.outer(r, np.cos(phi)), np.outer(r, np.sin(phi)), np.repeat(z[:, None], columns, 1)], -1)
            expected += wall.evaluate(wo, grid.reshape(-1, 3))[:, 3].reshape(rows, columns)
    expected *= 4 * np.pi / (rows * columns) / cuts**2 * count
    filled = expected > 8
    distance = ((counts - expected) ** 2 / np.maximum(expected, 1e-9))[filled].sum()
    freedom = int(filled.sum())
    assert (distance - freedom) / math.sqrt(2 * freedom) < 5, "counts do not follow the density"
    assert expected.sum() <= count * 1.01


@pytest.mark.parametrize("name", ["thin", "dull", "strong", "glass", "dense"])
def test_light_takes_either_way_through_a_wall_alike(name: str) -> None:
    """The other way it is seen from behind, in a frame turned about. Light in glass is denser by the square of the index; and there it is one bounce
    that does so, before it makes up for all others."""
    forth = WALLS[name]
    back = Wall(**{**vars(forth), "behind": True})
    a, b = everywhere(4000, 3), everywhere(4000, 4)
    a[:, 2], b[:, 2] = abs(a[:, 2]), -abs(b[:, 2])
    there, here = forth.evaluate(a, b)[:, :3], back.evaluate(b * (1, 1, -1), a * (1, 1, -1))[:, :3]
    if forth.glass:
        here *= forth.ior**2
        for light, towards, within in ((there, a[:, 2], False), (here, -b[:, 2], True)):
            light *= glass_albedo.kept(forth.alpha**0.5, towards, forth.ior, within=within)[:, None]
    assert there.max() > 0 and np.abs(there - here).max() <= 1e-9 * there.max()


@pytest.mark.parametrize("ior", [1.0, 1.0 + 1e-7, 1.5, 1000.0])
@pytest.mark.parametrize("alpha", [1e-3, 1.0])
@pytest.mark.parametrize("behind", [False, True])
def test_numbers_are_sound_whatever_the_index(ior: float, alpha: float, behind: bool) -> None:
    wall = Wall(glass=1.0, ior=ior, alpha=alpha, behind=behind)
    for cosine in (1e-4, 0.3, 1.0):
        weights, _ = wall.shares(seen_from(cosine), 4000)
        least = glass_albedo.kept(alpha**0.5, cosine, ior, within=behind) if ior > 1.001 else 1.0
        assert np.isfinite(weights).all() and weights.min() >= 0 and weights.max() < 2 / least
        found = wall.evaluate(seen_from(cosine), everywhere(4000, 5))
        assert np.isfinite(found).all() and found.min() >= 0
    if ior <= 1.001:
        wi = wall.sample(seen_from(0.8), 1000)
        assert np.linalg.norm(wi + seen_from(0.8), axis=1).max() < 0.02, "nearly straight on"


def test_powers_of_colours() -> None:
    color, ways = (axis.ravel() for axis in np.meshgrid([1e-6, 0.1, 0.5, 0.9, 0.999, 1.0], [0.0, 0.01, 1.0, 3.3, 50.0, 1e30, math.inf]))
    found = probe.powers(color, ways)
    assert found == pytest.approx(color**ways, rel=2e-4, abs=1e-30)
    assert probe.powers(np.array([0.0, 0.0]), np.array([1e-3, math.inf])).tolist() == [0.0, 0.0]
    assert np.isfinite(probe.powers(np.array([0.5, 1e-45, 2.0]), np.full(3, math.nan))).all()
