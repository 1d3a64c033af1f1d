"""If this fails, an image's layers are taken for one another on their way, or a renderer is asked for what it does not make."""

from __future__ import annotations

import numpy as np
import pytest

from scenectl.image_values import LAYER_NAMES, USUAL_LAYERS, Layers
from scenefold.base.errors import LocalFault, UsageFault
from scenefold.render.contract import check_layers_written, load_renderer
from scenefold.render.layers import BESIDE, KINDS, USUAL, check_layers, columns_of, image_bytes, in_order, packed, unpacked
from scenefold.render.sum_columns import ALL_AOVS, FULL, ONE_PART, PLAIN, PLAIN_AOVS, THREE_PARTS, SumColumns


def test_the_program_offers_every_layer() -> None:
    assert LAYER_NAMES == BESIDE and USUAL_LAYERS.names == USUAL


def test_layers_are_named_in_any_order_and_made_in_one() -> None:
    assert Layers.parse("samples, albedo").names == in_order(("samples", "albedo")) == ("albedo", "samples")
    assert Layers.parse("all").names == BESIDE and Layers.parse("none").names == ()
    check_layers(BESIDE)
    assert Layers.parse("beauty").names == () and Layers.parse("beauty,depth").names == ("depth",), "it is always there"
    for wrong in ("", "albedo,", "albedo,albedo", "all,albedo", "shine"):
        with pytest.raises(ValueError):
            Layers.parse(wrong)
    for names in (("beauty",), ("shine",), ("depth", "albedo"), ("depth", "depth")):
        with pytest.raises(UsageFault):
            check_layers(names)


@pytest.mark.parametrize("names", [(), USUAL, BESIDE, ("object_id", "variance")])
def test_an_image_comes_out_as_it_went_in(names: tuple[str, ...]) -> None:
    dice, layers = np.random.default_rng(1), {}
    for name in ("beauty", *names):
        kind = KINDS[name]
        shape = (5, 7, len(kind.channels)) if len(kind.channels) > 1 else (5, 7)
        layers[name] = (dice.random(shape) * 2**31).astype(kind.dtype)
    image = packed(layers)
    assert len(image) == image_bytes(names, 35)
    found = unpacked(image, names, 7, 5)
    assert list(found) == ["beauty", *names]
    assert all(np.array_equal(found[name], layer) and found[name].dtype == layer.dtype for name, layer in layers.items())


def test_only_the_columns_that_are_needed_are_summed() -> None:
    assert columns_of(()) == columns_of(USUAL) == columns_of(("samples", "variance")) == PLAIN
    assert columns_of(("direct", "depth")) == SumColumns(THREE_PARTS, PLAIN_AOVS)
    assert columns_of(("object_id",)) == SumColumns(ONE_PART, ALL_AOVS)
    assert columns_of(BESIDE) == FULL


class _Plain:
    """A renderer that says nothing of columns."""

    numeric_class = open = print


class _Features(_Plain):
    def columns(self) -> SumColumns:
        return SumColumns(ONE_PART, ALL_AOVS)


def test_a_renderer_is_not_asked_for_what_it_does_not_write() -> None:
    check_layers_written(load_renderer("embree"), (*USUAL, "samples", "variance"))
    check_layers_written(_Plain(), USUAL)  # type: ignore[arg-type]
    check_layers_written(_Features(), ("position", "material_id"))  # type: ignore[arg-type]
    with pytest.raises(LocalFault, match="does not make the layers emission, position"):
        check_layers_written(_Plain(), ("emission", "albedo", "position"))  # type: ignore[arg-type]
    with pytest.raises(LocalFault, match="does not make the layer direct"):
        check_layers_written(_Features(), ("direct", "position"))  # type: ignore[arg-type]
