"""If this fails, pictures show light wrongly: grey gets a tint, bright things change their hue, or a pixel that is no number spoils the rest."""

from __future__ import annotations

import colorsys
from typing import get_args, get_type_hints

import numpy as np
import numpy.typing as npt
import pytest

from scenectl.render import still
from scenefold.render import view as view_module
from scenefold.render.view import AGX, MIDDLE_GREY, VIEWS, agx, automatic_exposure, shown

views = pytest.mark.parametrize("view", list(VIEWS))


def codes(colours: object, view: str = AGX, exposure: float = 0.0) -> npt.NDArray[np.uint8]:
    """What each colour is shown as, uint8[n, 3]."""
    return shown(np.array(colours, np.float32).reshape(1, -1, 3), view, exposure).pixels[0]


def greys(values: object) -> npt.NDArray[np.float32]:
    return np.repeat(np.array(values, np.float32)[:, None], 3, axis=1)


def test_the_program_offers_every_view() -> None:
    assert get_args(get_type_hints(still)["view"]) == tuple(VIEWS)


@views
def test_greys_stay_grey_and_rise_from_black_to_white(view: str) -> None:
    ramp = codes(greys([0.0, *np.geomspace(1e-6, 100.0, 4000)]), view).astype(int)
    assert (ramp == ramp[:, :1]).all(), "no tint"
    assert (np.diff(ramp[:, 0]) >= 0).all() and ramp[0, 0] == 0 and ramp[-1, 0] == 255
    assert len(np.unique(ramp[:, 0])) > 240, "no banding"


@pytest.mark.parametrize(("view", "code"), [("agx", 128), ("filmic", 118), ("srgb", 118)])
def test_middle_grey_is_where_it_is_said_to_be(view: str, code: int) -> None:
    assert codes(greys([MIDDLE_GREY]), view).tolist() == [[code] * 3]
    assert codes(greys([MIDDLE_GREY / 4.0]), view, exposure=2.0).tolist() == [[code] * 3], "two stops brighter"


AGX_PINS = {
    (1.0, 0.1, 0.02): (0.83743, 0.44000, 0.29728),
    (0.1, 0.4, 1.0): (0.47433, 0.64886, 0.79997),
    (0.0, 1.0, 0.0): (0.31539, 0.83085, 0.31539),
    (4.0, 0.5, 0.1): (0.98059, 0.71316, 0.55715),
    (0.02, 0.01, 0.05): (0.16144, 0.10338, 0.28735),
    (0.001, 0.002, 0.0005): (0.01531, 0.02797, 0.00771),
}
"""Linear light, and the screen's signal of it: dark, bright, grey and saturated."""
PIN_ERROR = 2e-5


def farthest_from_the_pins() -> float:
    return float(np.abs(agx(np.array(list(AGX_PINS))) - np.array(list(AGX_PINS.values()))).max())


def test_colours_through_the_whole_of_agx() -> None:
    assert farthest_from_the_pins() < PIN_ERROR
    assert codes([[1.0, 0.1, 0.02], [0.02, 0.01, 0.05]]).tolist() == [[214, 112, 76], [41, 26, 73]]


def test_the_sigmoid_by_hand() -> None:
    """Of greys, which the matrices leave alone: one stop above middle grey, and one below."""
    height, step = 0.5, 1.0 / 16.5
    for stops, width, power in ((1.0, 6.5 / 16.5, 3.25), (-1.0, 10.0 / 16.5, 3.0)):
        scale = (height**-power - (2.0 * width) ** -power) ** (-1.0 / power)
        rise = 2.0 * step / (1.0 + (2.0 * step / scale) ** power) ** (1.0 / power)
        shown_as = agx(np.full((1, 3), MIDDLE_GREY * 2.0**stops))[0]
        assert shown_as == pytest.approx(0.5 + stops * rise, abs=1e-9)


def test_the_matrix_of_agx() -> None:
    expected = [[0.842399, 0.07843, 0.079171], [0.042399, 0.87843, 0.079171], [0.042399, 0.07843, 0.879171]]
    found = view_module._inset_matrix()
    assert np.abs(found - expected).max() < 1e-6
    assert np.abs(view_module._OUTSET_MATRIX @ found - np.eye(3)).max() < 1e-12


@pytest.mark.parametrize("name", ["_SLOPE", "_TOE", "_SHOULDER", "_INSET", "_STOPS_BELOW", "_STOPS_ABOVE", "_PIVOT_X", "_PIVOT_Y"])
def test_the_pins_hold_every_constant(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A change of a hundredth shows."""
    monkeypatch.setattr(view_module, name, getattr(view_module, name) * 1.01)
    matrix = view_module._inset_matrix()
    monkeypatch.setattr(view_module, "_INSET_MATRIX", matrix)
    monkeypatch.setattr(view_module, "_OUTSET_MATRIX", np.linalg.inv(matrix))
    assert farthest_from_the_pins() > 10.0 * PIN_ERROR


@views
def test_a_colour_that_grows_brighter_never_gets_darker(view: str) -> None:
    directions = np.random.default_rng(3).random((200, 3)) ** 2
    steps = np.geomspace(1e-4, 300.0, 120)
    ramps = codes((directions[:, None] * steps[None, :, None]).reshape(-1, 3), view).reshape(200, 120, 3).astype(int)
    assert (np.diff(ramps.max(axis=2), axis=1) >= 0).all()
    luminance = ramps @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luminance, axis=1) >= -0.5).all()


@pytest.mark.parametrize("colour", [[1, 0.1, 0.02], [1, 0.5, 0.1], [0.1, 0.4, 1], [0, 1, 0], [1, 0, 0], [0, 0, 1], [0.9, 0.1, 0.8]])
def test_highlights_grow_pale_and_keep_their_hue(colour: list[float]) -> None:
    """Over twelve stops, as long as there is a hue to speak of, and never so far as clipping moves it."""
    steps = 2.0 ** np.arange(-4.0, 9.0)
    hues, saturations = [], []
    for red, green, blue in codes(np.array(colour) * steps[:, None]).astype(float) / 255:
        hue, saturation, _ = colorsys.rgb_to_hsv(red, green, blue)
        hues.append(hue * 360.0)
        saturations.append(saturation)
    assert (np.diff(saturations) <= 0.005).all() and saturations[-1] < 0.06
    coloured = [hue for hue, saturation in zip(hues, saturations, strict=True) if saturation > 0.3]
    assert max(coloured) - min(coloured) < 20.0


def test_agx_leaves_room_where_plain_srgb_clips() -> None:
    bright = greys([1.0, 2.0, 4.0, 8.0])
    assert (np.diff(codes(bright)[:, 0].astype(int)) >= 5).all() and codes(bright)[-1, 0] < 255
    assert codes(bright, "srgb").tolist() == [[255] * 3] * 4


def test_bright_colours_fade_to_white_and_dark_ones_stay_in_filmic() -> None:
    assert codes([[400.0, 40.0, 4.0]], "filmic").min() > 240
    assert codes([[0.5, 0.1, 0.05]], "filmic").tolist() == [[188, 89, 63]]


@views
def test_a_scene_in_any_unit_is_shown_neither_black_nor_burnt_out(view: str) -> None:
    picture = np.random.default_rng(5).uniform(0.02, 1.0, (30, 40, 3)).astype(np.float32)
    assert automatic_exposure(picture) == 0.0, "a well exposed image is left alone"
    for factor in (1e-4, 300.0, 4e6):
        assert 60 < float(np.median(shown(picture * np.float32(factor), view).pixels)) < 220
    assert shown(np.zeros((4, 4, 3), np.float32), view).exposure == 0.0


@views
def test_what_is_no_number_is_black_what_is_infinite_is_bright_and_both_are_counted(view: str) -> None:
    odd = [[np.nan] * 3, [np.inf] * 3, [-np.inf] * 3, [-1.0] * 3, [0.2, np.nan, 0.2], [0.18] * 3, [3e38] * 3]
    picture = shown(np.array([odd], np.float32), view, 0.0)
    assert picture.not_finite == 4
    assert picture.pixels[0, :4, 0].tolist() == [0, 255, 0, 0] and picture.pixels[0, 6].tolist() == [255] * 3
    assert picture.pixels[0, 5].tolist() == codes([[0.18] * 3], view).tolist()[0], "others are as they would be alone"
