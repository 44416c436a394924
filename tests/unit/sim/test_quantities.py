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
        with pytest.raises(InputError, match="value must be in"):
            quantities.check("value", math.nextafter(end, beyond), quantity)


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400, "1", True])
def test_a_value_that_is_no_finite_number_is_refused(quantity: str, value: float) -> None:
    with pytest.raises(InputError, match="value must be in"):
        quantities.check("value", value, quantity)


def test_the_refusal_names_the_likely_cause() -> None:
    with pytest.raises(InputError, match="divide nanoseconds by 1e9"):
        quantities.check("timestamp", 1722328243768045898, "time_s")
