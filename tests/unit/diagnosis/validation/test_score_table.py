"""Scores as text: all scores, aligned, and all failures."""

from __future__ import annotations

import json

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.power import curves
from starling.diagnosis.validation.protocol.score import score
from starling.diagnosis.validation.protocol.score_table import opening, power, text
from tests.unit.diagnosis.validation.made_results import make_effect, make_result, make_verdict


def test_table_of_scores(camera: Nominal) -> None:
    blur = {"lens_blur": 0.8}
    right = make_verdict("effects", make_effect("lens_blur", 0.8, "dot_blur"), cosine="lens_blur")
    wrong = make_verdict("effects", make_effect("dot_blur", 2.0), cosine=None)
    cases = [make_result(blur, right, number=i, set_number=i % 2) for i in range(5)]
    cases += [
        make_result(blur, wrong, number=5, set_number=1),
        make_result({}, make_verdict("no gap"), number=6),
    ]
    scores = score(
        cases, camera, families={}, tier=1, left_out=[make_result(blur, right, number=0)]
    )
    written = text(json.loads(json.dumps(scores)))
    lines = written.splitlines()
    assert lines[0] == "Withheld effects, tier 1: 1 null, 6 single, 0 pair, 1 unknown; 16 s"
    by_label = {line.split("  ")[0]: line.split() for line in lines}
    top1 = by_label["one effect: top-1 accuracy"]
    assert top1[-6:] == ["0.359", "to", "1", ">=", "0.90", "MISSED"]
    assert by_label["no effect: a gap is reported"][-3:] == ["<=", "0.05", "reached"]
    pairs = by_label["two effects: both in credible sets"]
    assert pairs[-5:] == ["-", ">=", "0.75", "no", "cases"]
    assert "two effects: both named" not in by_label  # There is neither a case nor a goal.
    assert by_label["lens_blur"] == ["lens_blur", "6", "0.833", "0.833", "0", "90"]
    assert by_label["cosine"] == ["cosine", "0.833"]
    assert "lens_blur: lens_blur 5, dot_blur 1" in lines
    assert "left out: lens_blur: lens_blur 1" in lines
    assert lines[-3:] == [
        "Failures, 2:",
        "case 0, set 0: left out: lens_blur 0.8: reported lens_blur 0.8 (or dot_blur)",
        "case 5, set 1: lens_blur 0.8: reported dot_blur 2",
    ]
    table = lines[2 : lines.index("", 2)]
    assert len({line.index(">= 0.90") + 7 for line in table if ">= 0.90" in line}) == 1
    ends = {len(line) for line in table if line.endswith(("reached", "MISSED", "no cases"))}
    assert len(ends) == 1


def test_every_score_has_its_own_line(camera: Nominal) -> None:
    """Each score has a unique number, which appears once with its label."""
    scores = score([], camera, families={}, tier=1)
    names = [key for key, value in scores.items() if value is None]
    values = {name: 0.101 + 0.002 * number for number, name in enumerate(names)}
    lines = text({**scores, **values}).splitlines()
    by_value = {cell: line for line in lines for cell in line.split() if cell.startswith("0.")}
    labels = {name: by_value[f"{value:.3g}"] for name, value in values.items()}
    assert len(names) > 15 and len(set(labels.values())) == len(names)
    for name, start in (
        ("coverage", "one effect: interval contains the strength"),
        ("false_named", "no effect: an effect is named"),
        ("pairs_first", "two effects: top-1 effect is one of them"),
        ("unknown_recall_outside", "unknown effect: recall, effects outside the table"),
        ("unknown_recall_left_out", "unknown effect: recall, left out with confusable effects"),
        ("unknown_recall_family", "unknown effect: recall, left out with its family alone"),
        ("unknown_false", "none to two effects: reported as unknown"),
        ("unknown_false_effects", "one or two effects: reported as unknown"),
        ("remainder_recall", "unknown effect: a gap is reported that no known effect explains"),
        ("remainder_false", "none to two effects: a gap is reported that no known effect explains"),
        ("closed_not_identifiable", "one or two effects: named, gap reduction not identifiable"),
    ):
        assert labels[name].startswith(start), name


def test_gap_reduction_is_listed_by_metric(camera: Nominal) -> None:
    scores = score([], camera, families={}, tier=1)
    metric = {"bias_px": {"cases": 4, "median": 61.0}}
    lines = text({**scores, "closed_by_metric": metric}).splitlines()
    title = next(line for line in lines if line.startswith("gap reduction [%]"))
    assert title.split()[-2:] == ["cases", "median"]
    assert lines[lines.index(title) + 1].split() == ["bias_px", "4", "61"]


def test_conditions_of_the_scores() -> None:
    complete, partial = {"asked": 6, "all": 6}, {"asked": 4, "all": 6}
    line = "The truth was opened once; the code is the sealed code.\n"
    assert opening(1, code_as_sealed=True, sets=complete) == line
    line = "The first 4 of 6 scene sets are scored. " + line
    assert opening(1, code_as_sealed=True, sets=partial) == line
    assert "opened 2 times; the code is the" in opening(2, code_as_sealed=True, sets=complete)
    assert "3 times; the code differs from" in opening(3, code_as_sealed=False, sets=complete)


def test_text_is_ascii_and_at_most_120_wide(camera: Nominal) -> None:
    names = [f"some_rather_long_name_{i}" for i in range(12)]
    table = make_verdict("effects", *(make_effect(name, 1.0, *names) for name in names))
    cases = [make_result({"lens_blur": 0.8}, table, number=i) for i in range(2)]
    many = [
        make_result({"lens_blur": 0.8}, make_verdict("effects", make_effect(name)))
        for name in names
    ]
    written = text(score([*cases, *many], camera, families={}, tier=2))
    assert written.isascii()
    assert max(map(len, written.splitlines())) <= 120
    assert all(line == line.rstrip() for line in written.splitlines())


def test_table_without_cases(camera: Nominal) -> None:
    written = text(score([], camera, families={}, tier=4))
    assert written.startswith("Withheld effects, tier 4: 0 null, 0 single, 0 pair, 0 unknown; 0 s")
    assert written.endswith("\n\nFailures, 0:\nnone\n")
    assert "Answers by true effect" not in written and "matcher" not in written
    assert "Scene sets share rooms, so there are no intervals." in " ".join(written.split())
    tier_2 = text({**score([], camera, families={}, tier=2), "matcher_noticed": 0.95})
    line = "Only the image segment is scored. The second matcher was detected: 0.95"
    assert f"\n\n{line}\n" in tier_2


def test_table_of_power_curves(camera: Nominal) -> None:
    veils = [make_result({"veil": veil}, make_verdict("no gap")) for veil in (0.1, 0.05)]
    assert power(curves(veils, camera)).splitlines() == [
        "effect  departure  cases  alarm  named  found",
        "veil         0.05      1      0      0      0",
        "veil          0.1      1      0      0      0",
    ]


def test_table_of_an_imperfect_base(camera: Nominal) -> None:
    right = make_verdict("effects", make_effect("lens_blur", 1.9), cosine="veil")
    cases = [
        make_result({"lens_blur": 1.9}, right, texture=0.1),
        make_result({}, make_verdict("none of the known"), disc_spot=0.7),
    ]
    lines = text(score(cases, camera, families={}, tier=5)).splitlines()
    by_label = {line.split("  ")[0]: line.split() for line in lines}
    named = by_label["one effect: it is named"]
    assert named[-4:] == ["1", ">=", "0.85", "reached"]
    assert by_label["no effect: an effect is named"][-3:] == ["<=", "0.05", "reached"]
    cosine = by_label["one effect: top-1 accuracy of the nearest response by cosine"]
    assert cosine[-1] == "0"
    assert by_label["beyond the range"][3:5] == ["1", "1"]
    assert by_label["texture"][:3] == ["texture", "1", "1"]
    assert "disc_spot" in by_label
    assert max(map(len, lines)) <= 120
