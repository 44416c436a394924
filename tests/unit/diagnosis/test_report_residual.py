"""What a page, its figures and its sentences say of a learned residual."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from starling.diagnosis.howfar.residual import Absorption, Residual
from starling.diagnosis.report import figures
from starling.diagnosis.report.page import page
from starling.sim.console import record
from tests.unit.diagnosis import made_diagnosis as made
from tests.unit.diagnosis.read_page import Reader

GAIN = Absorption(
    gain_before=0.15625,
    gain_after=0.0625,
    gain_floor=0.03125,
    closable=True,
    share=0.75,
    interval=(0.6, 0.9),
)
LEARNT = Residual(
    alone={"ndp_brier": 0.25, "ndp_1_auc": 0.5},
    bound={"ndp_brier": 0.09375, "ndp_1_auc": 0.375},
    absorption=GAIN,
)


def learnt(**gain: Any) -> Residual:
    return dataclasses.replace(LEARNT, absorption=dataclasses.replace(GAIN, **gain))


def test_a_learned_residual_stands_beside_how_far():
    one = made.diagnosis(residual=LEARNT)
    text = Reader(page(one)).text
    assert "before 0.25 after 0.125 floor 0.0625 bound 0.09375" in text
    assert "Taken over by the effects: 75 %, 95 % interval [60, 90] %." in text
    assert "before 0.1562 after 0.0625 floor 0.03125" in text
    assert "residual takes the Brier score of holes from 0.25 to 0.0938, by 0.12 more than" in text
    assert "The effects take over 75 % [60, 90] of that." in text
    told = json.loads(record.dumps(figures.figures(one)))
    assert told["howfar"]["ndp_brier"]["bound"] == 0.09375
    assert told["howfar"]["ndp_brier"]["after"] == 0.125
    assert "bound" not in told["howfar"]["bias_px"]
    assert told["absorption"] == {**dataclasses.asdict(GAIN), "interval": [0.6, 0.9]}
    assert "learned residual" not in page(made.FULL)
    assert json.loads(record.dumps(figures.figures(made.FULL)))["absorption"] == {}


def test_of_one_scene_the_share_has_no_interval():
    text = page(made.diagnosis(residual=learnt(interval=None)))
    assert "by the effects: 75 %; fewer than three rooms give no interval." in text
    assert "take over 75 % of that." in text


def test_a_gain_that_is_none_for_sure_is_taken_over_by_nothing():
    text = page(made.diagnosis(residual=learnt(closable=False, share=None, interval=None)))
    assert "to 0.0938, not surely more than where nothing is off." in text
    assert "take over" not in text and text.count("before and floor do not differ") > 1


def test_without_effects_the_bound_stands_alone():
    bare = learnt(gain_after=None, share=None, interval=None)
    one = made.diagnosis(
        kind="no gap", arms=(made.found(made.NOTHING),), howfar=None, residual=bare
    )
    text = Reader(page(one)).text
    assert "before 0.25 bound 0.09375" in text and "before 0.5 bound 0.375" in text
    assert "before 0.1562 floor 0.03125" in text and "No effect is accepted that could" in text
    assert "The effects take over" not in text
    told = json.loads(record.dumps(figures.figures(one)))
    assert told["howfar"]["ndp_1_auc"] == {
        "before": 0.5,
        "after": None,
        "floor": None,
        "closed_pct": None,
        "interval": None,
        "bound": 0.375,
    }
    assert told["absorption"]["gain_after"] is None
