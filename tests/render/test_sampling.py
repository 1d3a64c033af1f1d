"""If this fails, a setting of how paths are drawn changes what it should not, or nothing."""

from __future__ import annotations

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import room
from scenefold.render.layers import BESIDE
from scenefold.render.sampling import Sampling

SKY = (0.1, 0.15, 0.3)


@pytest.fixture(scope="module")
def furnished() -> Rig:
    """With lamps, glass and metal: some paths find much more light than others."""
    return Rig(room(), 12)


def test_samplers_and_roulette_leave_the_mean_alone(furnished: Rig) -> None:
    usual = furnished.render(sky=SKY, samples=256)
    for sampling in (Sampling("independent"), Sampling(roulette_from=32), Sampling(roulette_from=1)):
        other = furnished.render(sky=SKY, samples=256, sampling=sampling)
        assert not np.array_equal(other.radiance, usual.radiance)
        error = np.sqrt((usual.variance + other.variance).astype(np.float64).sum(axis=(0, 1))) / usual.beauty[:, :, 0].size
        assert (np.abs(other.beauty.mean(axis=(0, 1)) - usual.beauty.mean(axis=(0, 1))) < 4 * error).all()


def test_a_limit_that_nothing_reaches_changes_no_bit(furnished: Rig) -> None:
    usual = furnished.render(sky=SKY)
    assert np.array_equal(furnished.render(sky=SKY, sampling=Sampling(clamp_direct=1e6, clamp_indirect=1e6)).radiance, usual.radiance)


def test_each_limit_darkens_its_own_light(furnished: Rig) -> None:
    usual = furnished.render(sky=SKY, layers=BESIDE)
    direct = furnished.render(sky=SKY, layers=BESIDE, sampling=Sampling(clamp_direct=0.05))
    indirect = furnished.render(sky=SKY, layers=BESIDE, sampling=Sampling(clamp_indirect=0.05))
    for name in ("emission", "direct"):
        assert np.array_equal(indirect.layers[name], usual.layers[name])
        assert direct.layers[name].sum() < usual.layers[name].sum()
    assert np.array_equal(direct.layers["indirect"], usual.layers["indirect"])
    assert indirect.layers["indirect"].sum() < usual.layers["indirect"].sum()
    # A lamp that the camera sees is as bright as the limit, and of its own colour.
    emission = direct.layers["emission"].reshape(-1, 3)
    seen = emission[emission[:, 0].argmax()]
    assert abs(seen.mean() - 0.05) < 1e-3
    assert np.allclose(seen / seen[0], np.array([17.0, 12.0, 4.0]) / 17.0, atol=0.01)


def test_limits_hold_on_any_number_of_nodes(furnished: Rig) -> None:
    sampling = Sampling("independent", 2, 0.5, 0.25)
    alone, together = (furnished.render("bounded-radial", nodes, sky=SKY, sampling=sampling) for nodes in (1, 3))
    assert np.array_equal(alone.radiance, together.radiance)
