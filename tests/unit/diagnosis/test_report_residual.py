"""What a page, its figures and its sentences say of a learned residual."""

from __future__ import annotations

import dataclasses
import json

from diagnosis.howfar.residual import Absorption, Residual
from diagnosis.report import figures
from diagnosis.report.page import page
from sim import record
from tests.unit.diagnosis import test_report as made
from tests.unit.diagnosis.read_page import Reader

LEARNT = Residual(
    alone={"ndp_brier": 0.25, "ndp_1_auc": 0.5},
    bound={"ndp_brier": 0.09375, "ndp_1_auc": 0.375},
    absorption=Absorption(gain_before=0.15625, gain_after=0.03125, share=0.8, interval=(0.6, 0.9)),
)


def test_a_learned_residual_stands_beside_how_far():
    one = made.diagnosis(residual=LEARNT)
    text = Reader(page(one)).text
    assert "before 0.25 after 0.125 floor 0.0625 bound 0.09375" in text
    assert "Taken over by the effects: 80 %, 95 % interval [60, 90] %." in text
    assert "before 0.1562 after 0.03125" in text
    assert "residual takes the Brier score of holes from 0.25 to 0.0938. The effects take" in text
    assert "over 80 % [60, 90] of that gain." in text
    told = json.loads(record.dumps(figures.figures(one)))
    assert told["howfar"]["ndp_brier"]["bound"] == 0.09375
    assert told["howfar"]["ndp_brier"]["after"] == 0.125
    assert "bound" not in told["howfar"]["bias_px"]
    assert told["absorption"]["share"] == 0.8 and told["absorption"]["interval"] == [0.6, 0.9]
    assert "learned residual" not in page(made.FULL)
    assert json.loads(record.dumps(figures.figures(made.FULL)))["absorption"] == {}


def test_of_one_scene_or_no_gain_the_share_has_no_interval_or_is_none():
    assert LEARNT.absorption is not None
    single = dataclasses.replace(LEARNT.absorption, interval=None)
    text = page(made.diagnosis(residual=dataclasses.replace(LEARNT, absorption=single)))
    assert "by the effects: 80 %; one scene gives no interval." in text
    assert "take over 80 % of that gain." in text
    unknown = dataclasses.replace(LEARNT.absorption, share=None, interval=None)
    text = page(made.diagnosis(residual=dataclasses.replace(LEARNT, absorption=unknown)))
    assert "the network does not gain for sure" in text and "That is no gain for sure" in text


def test_without_effects_the_bound_stands_alone():
    bare = dataclasses.replace(LEARNT, absorption=None)
    one = made.diagnosis(
        kind="no gap", arms=(made.found(made.NOTHING),), howfar=None, residual=bare
    )
    text = Reader(page(one)).text
    assert "before 0.25 bound 0.09375" in text and "before 0.5 bound 0.375" in text
    assert "Gain of the network" not in text
    told = json.loads(record.dumps(figures.figures(one)))
    assert told["howfar"]["ndp_1_auc"] == {
        "before": 0.5, "after": None, "floor": None, "closed_pct": None, "interval": None,
        "bound": 0.375,
    }  # fmt: skip
    assert told["absorption"] == {}
