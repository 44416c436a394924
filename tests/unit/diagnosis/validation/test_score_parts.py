"""Selection of the cases of each score."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import breakdown
from starling.diagnosis.validation.protocol.score import score

Make = Callable[..., Any]


def test_gap_reduction_excludes_null_and_unknown_cases(
    make_effect: Make, make_verdict: Make, make_result: Make, camera: Nominal
) -> None:
    veil = make_verdict("effects", make_effect("veil"), closed=-50.0)
    single = make_result(
        {"lens_blur": 0.8}, make_verdict("effects", make_effect("lens_blur"), closed=30.0)
    )
    cases = [single, make_result({}, veil), make_result({"lens_ghost": 0.2}, veil)]
    scores = score(cases, camera, families={}, tier=1)["closed_by_metric"]
    assert scores == {"features of the image": {"median": 30.0, "identifiable": 1.0}}


def test_scene_sets_of_left_out_cases_count(
    make_effect: Make, make_verdict: Make, make_result: Make, camera: Nominal
) -> None:
    blur, none = (
        make_verdict("effects", make_effect("lens_blur")),
        make_verdict("none of the known"),
    )
    cases = [make_result({"lens_blur": 0.8}, blur, set_number=number) for number in (0, 1)]
    left_out = [make_result({"lens_blur": 0.8}, none, set_number=number) for number in (0, 1, 2)]
    scores = score(cases, camera, families={}, tier=1, left_out=left_out)
    assert scores["unknown_recall"] == 1.0 and "unknown_recall" in scores["intervals"]


def test_a_baseline_that_names_a_parameter_counts_for_its_effect(
    make_verdict: Make, make_result: Make
) -> None:
    table = make_verdict("no gap", cosine="lens_blur.core", random="veil.x")
    scores = breakdown.baselines([make_result({"lens_blur": 0.8}, table)])
    assert scores == {"cosine": {"top1": 1.0}, "random": {"top1": 0.0}}


def test_baselines_with_equal_accuracy_are_counted(
    make_effect: Make, make_verdict: Make, make_result: Make, camera: Nominal
) -> None:
    table = make_verdict(
        "effects", make_effect("lens_blur"), cosine="lens_blur", largest_drop="veil"
    )
    missed = make_verdict("no gap", cosine="veil", largest_drop="veil", random="lens_blur")
    right, wrong = (make_result({"lens_blur": 0.8}, verdict) for verdict in (table, missed))
    scores = [score(cases, camera, families={}, tier=1) for cases in ([right], [wrong], [])]
    assert [values["baselines_as_good"] for values in scores] == [1, 3, None]
