"""What of the table is tried where an effect is left out."""

from __future__ import annotations

from diagnosis import batch
from sim import effects

ALL = {row.family for row in effects.table()}


def test_nothing_is_left_out_unasked():
    assert batch._families(None, twins=True) is None


def test_a_family_goes_and_with_twins_all_that_look_alike():
    alone = batch._families("nir_reflectance", twins=False)
    assert alone is not None and ALL - set(alone) == {"reflectance"}
    both = batch._families("nir_reflectance", twins=True)
    # Its own page names the last two and projector power, whose page names it.
    twins = {"signal_gain", "ambient_gradient", "transparency"}
    assert both is not None and ALL - set(both) == {"reflectance", *twins}
