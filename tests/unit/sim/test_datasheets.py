"""Data sheets: those of the presets, thresholds of reached figures, and refusals."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from starling.patterns import InputError
from starling.sim.sensor import datasheets, presets
from starling.sim.sensor.datasheets import Datasheet, StatedFigure
from starling.sim.sensor.datasheets.figures import FIGURES, reached, stated
from starling.sim.sensor.edits import with_values

SHEETS = sorted(Path(datasheets.__file__).parent.glob("*.toml"))
ENTRY = 'figure = "accuracy_pct"\nvalue = 2\ndistance_m = 2\nsource = "sheet"'


def _read(tmp_path: Path, text: str) -> Datasheet:
    path = tmp_path / "camera.toml"
    path.write_text(text, encoding="utf-8")
    return datasheets.read(path)


@pytest.mark.parametrize("path", SHEETS, ids=lambda path: path.stem)
def test_packaged_sheets_are_valid(path: Path) -> None:
    sheet = datasheets.read(path)
    assert sheet.camera and sheet.figures
    for figure in sheet.figures:
        with_values(presets.load(path.stem), figure.settings)


def test_sheets_without_a_preset_are_not_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presets, "names", lambda: ["d435", "camera-without-sheet"])
    assert datasheets.names() == ["d435"]
    with pytest.raises(InputError, match=r"camera must be a known name; got 'd405'. Known: d435"):
        datasheets.load("d405")


def test_sheet_of_a_preset_is_loaded() -> None:
    sheet = datasheets.load("d435")
    assert sheet.camera == "Intel RealSense D435"
    (baseline,) = [item for item in sheet.figures if item.figure == "baseline_mm"]
    assert baseline.value == (50.0,)


@pytest.mark.parametrize(
    ("figure", "value", "inside", "outside"),
    [
        ("minimum_distance_m", (0.195,), (0.1, 0.195), (0.1951,)),
        ("maximum_distance_m", (3.0,), (3.0, 9.0), (2.999,)),
        ("accuracy_pct", (2.0,), (0.0, 2.0), (2.001,)),
        ("fill_pct", (99.0,), (99.0, 100.0), (98.99,)),
        ("baseline_mm", (50.0,), (49.5, 50.5), (49.49, 50.51)),
        ("horizontal_field_deg", (87.0,), (86.0, 88.0), (85.99, 88.01)),
        ("horizontal_field_deg", (84.0, 90.0), (84.0, 90.0), (83.99, 90.01)),
        ("sunlight_change_pct", (-5.0, 100.0), (-5.0, 1.0), (-5.01,)),
        ("fill_without_projector_pct", (0.0, 50.0), (0.0, 50.0), (50.01,)),
    ],
)
def test_thresholds_of_reached_figures(
    figure: str, value: tuple[float, ...], inside: tuple[float, ...], outside: tuple[float, ...]
) -> None:
    kind = FIGURES[figure]
    assert all(reached(kind, value, simulated) for simulated in inside)
    assert not any(reached(kind, value, simulated) for simulated in (*outside, math.nan))


@pytest.mark.parametrize(
    ("figure", "value", "expected"),
    [
        ("minimum_distance_m", (0.195,), "<= 0.195"),
        ("maximum_distance_m", (3.0,), ">= 3"),
        ("baseline_mm", (50.0,), "50 +- 0.5"),
        ("accuracy_pct", (0.5, 2.0), "0.5 to 2"),
    ],
)
def test_stated_values_are_printed(figure: str, value: tuple[float, ...], expected: str) -> None:
    assert stated(FIGURES[figure], value) == expected


def test_label_has_the_conditions() -> None:
    entry = StatedFigure(
        figure="fill_pct",
        value=(99.0,),
        source="sheet",
        mode="848x480",
        distance_m=4.0,
        target="textured",
        settings=(("matcher.refinement.quantum_px", 0.03125),),
    )
    conditions = "at 4 m, textured target, mode 848x480, quantum_px 0.03125"
    assert entry.label == f"fill rate, {conditions} [%]"


def test_settings_are_a_table_of_paths(tmp_path: Path) -> None:
    settings = 'settings = { "matcher.refinement.quantum_px" = 0.03125 }'
    (entry,) = _read(tmp_path, f'camera = "A"\n[[figures]]\n{ENTRY}\n{settings}').figures
    assert entry.settings == (("matcher.refinement.quantum_px", 0.03125),)


@pytest.mark.parametrize("figure", [name for name, kind in FIGURES.items() if kind.our_figure])
def test_our_figure_is_of_the_same_kind(figure: str) -> None:
    vendors, ours = FIGURES[figure], FIGURES[FIGURES[figure].our_figure]
    assert (vendors.unit, vendors.sense) == (ours.unit, ours.sense) and not ours.our_figure


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("accuracy_pct", "acuracy_pct", "figure must be a known name; got 'acuracy_pct'. Known: a"),
        ("value = 2", "value = []", r"value must be a number or \[low, high\]; got \[\]. Example"),
        ("value = 2", "value = [1, 2, 3]", r"value must be a number or \[low, high\]; got \[1"),
        ("value = 2", "value = 200", r"value must be in \[0, 100\]; got 200.0. The unit is %."),
        ("value = 2", "value = nan", r"value must be in \[0, 100\]; got nan. The unit is %."),
        ("value = 2", "value = [2, 1]", r"value must be \[low, high\]; got \[2.0, 1.0\]. Swap"),
        ("value = 2", 'value = "2"', "value must be a list; got '2'"),
        ("value = 2", "", "value must be given; got nothing"),
        ('"sheet"', '""', "source must name a document; got ''. Every figure has one."),
        ("distance_m = 2", "distance_m = 2000", r"distance_m must be in \[0.05, 50\]; got 2000.0"),
        ("distance_m = 2", "", "distance_m must be given; got None. It is for accuracy_pct."),
        ("accuracy_pct", "maximum_distance_m", "distance_m must be left out; got 2.0. It is for"),
        ("value", 'mode = "HD"\nvalue', "mode must be WIDTHxHEIGHT; got 'HD'. Example: 848x480."),
        ("value", 'target = "dark"\nvalue', "target must be a known name; got 'dark'. Known: "),
        ("value", "unit = 1\nvalue", "key must be a known name; got 'unit'"),
        ("value", "settings = 1\nvalue", "settings must be a list; got 1. Give"),
    ],
)
def test_damaged_figures_are_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    text = f'camera = "A"\n[[figures]]\n{ENTRY.replace(old, new)}'
    with pytest.raises(InputError, match=rf"camera.toml: figure 1: {message}"):
        _read(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('camera = "A"', "figures must hold a figure; got none. Add"),
        (f"[[figures]]\n{ENTRY}", "camera must be of type str; got None. Quote"),
        ('camera = "A"\nfigures = 1', "figures must be of type list; got 1. Write"),
        ('camera = "A"\nfigures = [1]', "figure 1: StatedFigure must be a table; got 1"),
        ('camera = "A"\nvendor = "B"', "key must be a known name; got 'vendor'. Known: camera"),
        (
            f'camera = "A"\n[[figures]]\n{ENTRY}\n[[figures]]\n{ENTRY}',
            r"figures must be stated once; got Z accuracy, at 2 m \[%\]. Drop one.",
        ),
    ],
)
def test_damaged_sheets_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"camera.toml: {message}"):
        _read(tmp_path, text)
