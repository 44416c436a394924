"""Plausible ranges: every end is accepted, the next number beyond is refused."""

import math

import pytest

from starling.patterns.errors import InputError
from starling.sim import quantities
from starling.sim.quantities import QUANTITIES


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_both_ends_are_plausible_and_the_next_numbers_are_not(quantity: str) -> None:
    plausible = QUANTITIES[quantity]
    for end, beyond in ((plausible.low, -math.inf), (plausible.high, math.inf)):
        quantities.check("value", end, quantity)
        with pytest.raises(InputError, match=r"value must be (in|> 0)"):
            quantities.check("value", math.nextafter(end, beyond), quantity)


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400, "1", True])
def test_a_value_that_is_no_finite_number_is_refused(quantity: str, value: float) -> None:
    with pytest.raises(InputError, match=r"value must be (in|> 0)"):
        quantities.check("value", value, quantity)


def test_the_refusal_names_the_likely_cause() -> None:
    with pytest.raises(InputError, match="divide nanoseconds by 1e9"):
        quantities.check("timestamp", 1722328243768045898, "time_s")


def test_the_focal_length_is_compared_with_the_width() -> None:
    quantities.check_focal("fx_px", 0.02 * 640, 640)
    with pytest.raises(InputError, match=r"fx_px must be in \[12\.8, 6\.4e\+06\]; got 12\.7"):
        quantities.check_focal("fx_px", 12.7, 640)


def test_an_inverted_camera_matrix_is_named() -> None:
    with pytest.raises(InputError, match="is the matrix inverted"):
        quantities.check_focal("fx_px", 1 / 600, 640)
