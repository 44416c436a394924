"""Scores as text: all of them, aligned, and every failure."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.power import curves
from starling.diagnosis.validation.protocol.score import score
from starling.diagnosis.validation.protocol.score_table import opening, power, text

Make = Callable[..., Any]


def test_text_of_scores(effect: Make, say: Make, answer: Make, camera: Nominal) -> None:
    blur = {"lens_blur": 0.8}
    right = say("effects", effect("lens_blur", 0.8, "dot_blur"), cosine="lens_blur")
    wrong = say("effects", effect("dot_blur", 2.0), cosine=None)
    cases = [answer(blur, right, number=i, scenes=i % 2) for i in range(5)]
    cases += [answer(blur, wrong, number=5, scenes=1), answer({}, say("no gap"), number=6)]
    found = score(cases, camera, families={}, tier=1, left_out=[answer(blur, right, number=0)])
    written = text(json.loads(json.dumps(found)))
    lines = written.splitlines()
    assert lines[0] == "Withheld effects, tier 1: 1 null, 6 single, 0 pair, 1 unknown; 16 s"
    by_words = {line.split("  ")[0]: line.split() for line in lines}
    assert by_words["one effect: named first"][-6:] == [
        "0.359",
        "to",
        "1",
        ">=",
        "0.90",
        "MISSED",
    ]
    assert by_words["no effect: a gap alarmed of"][-3:] == ["<=", "0.05", "reached"]
    assert by_words["two effects: both in sets"][-5:] == ["-", ">=", "0.75", "not", "told"]
    assert "two effects: both named" not in by_words  # No case tells, and nothing is asked.
    assert by_words["lens_blur"] == ["lens_blur", "6", "0.833", "0.833", "0", "90"]
    assert by_words["cosine"] == ["cosine", "0.833"]
    assert "lens_blur: lens_blur 5, dot_blur 1" in lines
    assert "left out: lens_blur: lens_blur 1" in lines
    assert lines[-3:] == [
        "Failures, 2:",
        "case 0, scenes 0: left out: lens_blur 0.8: said lens_blur 0.8 (or dot_blur)",
        "case 5, scenes 1: lens_blur 0.8: said dot_blur 2",
    ]
    table = lines[2 : lines.index("", 2)]
    assert len({line.index(">= 0.90") + 7 for line in table if ">= 0.90" in line}) == 1
    ends = {len(line) for line in table if line.endswith(("reached", "MISSED", "not told"))}
    assert len(ends) == 1


def test_every_score_has_a_line_of_its_own(camera: Nominal) -> None:
    """Numbers that no two scores share are each told once, beside what they are of."""
    found = score([], camera, families={}, tier=1)
    names = [key for key, value in found.items() if value is None]
    told = {name: 0.101 + 0.002 * number for number, name in enumerate(names)}
    lines = text({**found, **told}).splitlines()
    by_value = {cell: line for line in lines for cell in line.split() if cell.startswith("0.")}
    words = {name: by_value[f"{value:.3g}"] for name, value in told.items()}
    assert len(names) > 15 and len(set(words.values())) == len(names)
    for name, start in (
        ("coverage", "one effect: strength within the interval"),
        ("false_named", "no effect: an effect named"),
        ("pairs_first", "two effects: one of them named first"),
        ("unknown_recall_outside", "unknown effects: of those in no table"),
        ("unknown_recall_left_out", "unknown effects: of those left out with their twins"),
        ("unknown_recall_family", "unknown effects: of those left out without twins"),
        ("unknown_false", "others: said to be unknown"),
        ("unknown_false_effects", "one or two effects: said to be unknown"),
        ("closed_not_identifiable", "one or two effects: named, closing not told"),
    ):
        assert words[name].startswith(start), name


def test_what_is_closed_is_told_by_metric(camera: Nominal) -> None:
    found = score([], camera, families={}, tier=1)
    metric = {"bias_px": {"cases": 4, "median": 61.0}}
    lines = text({**found, "closed_by_metric": metric}).splitlines()
    title = next(line for line in lines if line.startswith("gap closed [%]"))
    assert title.split()[-2:] == ["cases", "median"]
    assert lines[lines.index(title) + 1].split() == ["bias_px", "4", "61"]


def test_what_scores_rest_on_is_said() -> None:
    every, some = {"asked": 6, "all": 6}, {"asked": 4, "all": 6}
    said = "The truth was opened once; the code is as it was sealed.\n"
    assert opening(1, code_as_sealed=True, sets=every) == said
    said = "Of 6 sets of scenes the first 4 were asked. " + said
    assert opening(1, code_as_sealed=True, sets=some) == said
    assert "opened 2 times; the code is as" in opening(2, code_as_sealed=True, sets=every)
    assert "3 times; the code is another than" in opening(3, code_as_sealed=False, sets=every)


def test_text_is_plain_and_narrow(effect: Make, say: Make, answer: Make, camera: Nominal) -> None:
    rivals = [f"some_rather_long_name_{i}" for i in range(12)]
    said = say("effects", *(effect(name, 1.0, *rivals) for name in rivals))
    cases = [answer({"lens_blur": 0.8}, said, number=i) for i in range(2)]
    many = [answer({"lens_blur": 0.8}, say("effects", effect(name))) for name in rivals]
    written = text(score([*cases, *many], camera, families={}, tier=2))
    assert written.isascii()
    assert max(map(len, written.splitlines())) <= 120
    assert all(line == line.rstrip() for line in written.splitlines())


def test_text_of_nothing(camera: Nominal) -> None:
    written = text(score([], camera, families={}, tier=4))
    assert written.startswith("Withheld effects, tier 4: 0 null, 0 single, 0 pair, 0 unknown; 0 s")
    assert written.endswith("\n\nFailures, 0:\nnone\n")
    assert "Answers by truth" not in written and "matcher" not in written
    assert "few alarms are built in, and there are no intervals" in " ".join(written.split())
    noticed = text({**score([], camera, families={}, tier=2), "matcher_noticed": 0.95})
    assert (
        "\n\nscored is the image alone; that the matcher is another was noticed: 0.95\n" in noticed
    )


def test_text_of_power_curves(say: Make, answer: Make, camera: Nominal) -> None:
    veils = [answer({"veil": veil}, say("no gap")) for veil in (0.1, 0.05)]
    assert power(curves(veils, camera)).splitlines() == [
        "effect  departure  cases  alarm  named  found",
        "veil         0.05      1      0      0      0",
        "veil          0.1      1      0      0      0",
    ]
