"""Which cases a score is of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import breakdown
from starling.diagnosis.validation.protocol.score import score

Make = Callable[..., Any]


def test_closed_by_metric_is_of_one_or_two_effects_alone(
    effect: Make, say: Make, answer: Make, camera: Nominal
) -> None:
    veil = say("effects", effect("veil"), closed=-50.0)
    single = answer({"lens_blur": 0.8}, say("effects", effect("lens_blur"), closed=30.0))
    cases = [single, answer({}, veil), answer({"lens_ghost": 0.2}, veil)]
    found = score(cases, camera, families={}, tier=1)["closed_by_metric"]
    assert found == {"features of the image": {"median": 30.0, "identifiable": 1.0}}


def test_sets_of_what_is_left_out_count(
    effect: Make, say: Make, answer: Make, camera: Nominal
) -> None:
    blur, none = say("effects", effect("lens_blur")), say("none of the known")
    cases = [answer({"lens_blur": 0.8}, blur, scenes=number) for number in (0, 1)]
    left = [answer({"lens_blur": 0.8}, none, scenes=number) for number in (0, 1, 2)]
    found = score(cases, camera, families={}, tier=1, left_out=left)
    assert found["unknown_recall"] == 1.0 and "unknown_recall" in found["intervals"]


def test_a_baseline_that_names_a_parameter_names_its_effect(say: Make, answer: Make) -> None:
    said = say("no gap", cosine="lens_blur.core", random="veil.x")
    found = breakdown.baselines([answer({"lens_blur": 0.8}, said)])
    assert found == {"cosine": {"top1": 1.0}, "random": {"top1": 0.0}}


def test_a_simpler_way_that_names_as_many_is_counted(
    effect: Make, say: Make, answer: Make, camera: Nominal
) -> None:
    said = say("effects", effect("lens_blur"), cosine="lens_blur", largest_drop="veil")
    missed = say("no gap", cosine="veil", largest_drop="veil", random="lens_blur")
    right, wrong = (answer({"lens_blur": 0.8}, one) for one in (said, missed))
    found = [score(cases, camera, families={}, tier=1) for cases in ([right], [wrong], [])]
    assert [one["baselines_as_good"] for one in found] == [1, 3, None]
