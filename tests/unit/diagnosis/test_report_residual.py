"""The learned residual in the page, the figures and the sentences."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from starling.diagnosis.howfar.residual import Absorption, LearnedResidual
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
LEARNT = LearnedResidual(
    alone={"ndp_brier": 0.25, "ndp_1_auc": 0.5},
    bound={"ndp_brier": 0.09375, "ndp_1_auc": 0.375},
    absorption=GAIN,
)


def learnt(**gain: Any) -> LearnedResidual:
    return dataclasses.replace(LEARNT, absorption=dataclasses.replace(GAIN, **gain))


def test_learned_residual_is_shown_with_the_gap_reduction():
    diagnosis = made.diagnosis(residual=LEARNT)
    text = Reader(page(diagnosis)).text
    assert "before 0.25 after 0.125 floor 0.0625 bound 0.09375" in text
    assert "Absorbed by the effects: 75 %, 95 % interval [60, 90] %." in text
    assert "before 0.1562 after 0.0625 floor 0.03125" in text
    assert "residual changes the Brier score of holes from 0.25 to 0.0938. This gain" in text
    assert "The effects absorb 75 % [60, 90] of that." in text
    result = json.loads(record.dumps(figures.figures(diagnosis)))
    assert result["howfar"]["ndp_brier"]["bound"] == 0.09375
    assert result["howfar"]["ndp_brier"]["after"] == 0.125
    assert "bound" not in result["howfar"]["bias_px"]
    assert result["absorption"] == {**dataclasses.asdict(GAIN), "interval": [0.6, 0.9]}
    assert "learned residual" not in page(made.FULL)
    assert json.loads(record.dumps(figures.figures(made.FULL)))["absorption"] == {}


def test_one_scene_gives_no_interval():
    text = page(made.diagnosis(residual=learnt(interval=None)))
    assert "by the effects: 75 %; fewer than three rooms give no interval." in text
    assert "absorb 75 % of that." in text


def test_insignificant_gain_is_not_absorbed():
    text = Reader(
        page(made.diagnosis(residual=learnt(closable=False, share=None, interval=None)))
    ).text
    assert "to 0.0938. This gain does not significantly exceed" in text
    assert "The effects absorb" not in text and text.count("before and floor do not differ") > 1


def test_without_effects_only_the_bound_is_shown():
    bare = learnt(gain_after=None, share=None, interval=None)
    diagnosis = made.diagnosis(
        kind="no gap", segments=(made.segment_result(made.NOTHING),), howfar=None, residual=bare
    )
    text = Reader(page(diagnosis)).text
    assert "before 0.25 bound 0.09375" in text and "before 0.5 bound 0.375" in text
    assert "before 0.1562 floor 0.03125" in text and "No accepted effect could" in text
    assert "The effects absorb" not in text
    result = json.loads(record.dumps(figures.figures(diagnosis)))
    assert result["howfar"]["ndp_1_auc"] == {
        "before": 0.5,
        "after": None,
        "floor": None,
        "closed_pct": None,
        "interval": None,
        "bound": 0.375,
    }
    assert result["absorption"]["gain_after"] is None
