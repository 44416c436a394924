"""Sweeps without rendering: cameras, error messages and output files."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.commands.sweep import axes as sweep_axes
from starling.sim.commands.sweep import picture, sweep
from starling.sim.commands.sweep.axes import AXES
from starling.sim.commands.sweep.figures import Figures
from starling.sim.console import record
from starling.sim.reason import Reason
from starling.sim.render import emission
from starling.sim.sensor import edits, presets

BASE = presets.load("d435")
VALUES = {
    "baseline_m": (0.02, 0.15),
    "focal_px": (300.0,),
    "projector_x_m": (-0.05, 0.0),
    "dot_density": (0.5,),
}


def _result(full: bool = False) -> sweep.Sweep:
    """A sweep with synthetic figures; the second distance has no measured depth error."""
    cameras = tuple(sweep_axes.cameras(BASE, VALUES, full=full))
    holes = {cause.name.lower(): 0.01 for cause in Reason if cause}
    near, far = (
        Figures(
            bias_m=0.0,
            noise_m=noise_m,
            noise_px=0.1,
            wall_holes=0.0,
            holes=holes,
            wrong=0.02,
            unseen=0.05,
        )
        for noise_m in (2e-3, math.nan)
    )
    return sweep.Sweep(
        cameras=cameras,
        distances_m=(1.0, 2.0),
        figures=((near, far),) * len(cameras),
        reference=0,
    )


def test_one_axis_at_a_time() -> None:
    result = sweep_axes.cameras(BASE, VALUES)
    assert result[0].sensor == BASE
    assert len(result) == 1 + sum(map(len, VALUES.values()))
    for camera in result[1:]:
        assert sum(camera.values[name] != result[0].values[name] for name in AXES) == 1


def test_full_factorial_holds_every_combination_once() -> None:
    result = sweep_axes.cameras(BASE, VALUES, full=True)
    assert len(result) == math.prod(len(values) + 1 for values in VALUES.values())
    assert len({tuple(camera.values.values()) for camera in result}) == len(result)
    for name, values in VALUES.items():
        assert len(sweep_axes.along(name, result)) == len(values) + 1


def test_base_value_adds_no_second_camera() -> None:
    assert len(sweep_axes.cameras(BASE, {"baseline_m": (BASE.baseline_m, 0.1, 0.1)})) == 2


@given(
    st.fixed_dictionaries(
        {
            "baseline_m": st.floats(0.02, 0.15),
            "focal_px": st.floats(200, 1200),
            "projector_x_m": st.floats(-0.1, 0.2),
            "dot_density": st.floats(0.1, 8),
        }
    )
)
def test_every_axis_reads_back_what_was_set(values: dict[str, float]) -> None:
    sensor = BASE
    for name, value in values.items():
        sensor = AXES[name].write(sensor, value)
    assert {name: axis.read(sensor) for name, axis in AXES.items()} == values


def test_focal_length_changes_the_defocus() -> None:
    """f-number and pixels stay, so defocus goes with f^2; the projector keeps its field."""
    longer = sweep_axes.with_focal(BASE, 2 * BASE.fx_px)
    assert (longer.fx_px, longer.fy_px) == (2 * BASE.fx_px, 2 * BASE.fy_px)
    for side in (longer.left, longer.right):
        assert side.lens.defocus_px_m == pytest.approx(4 * BASE.left.lens.defocus_px_m)
    assert longer.projector == BASE.projector


def test_default_values_if_no_axis_is_named() -> None:
    assert set(sweep_axes.chosen(BASE, {})) == set(AXES)
    assert sweep_axes.chosen(BASE, {"baseline_m": [0.1], "focal_px": ()}) == {"baseline_m": (0.1,)}
    defaults = sweep_axes.chosen(BASE, {})["baseline_m"]
    assert (min(defaults), max(defaults)) == (0.02, 0.15)
    assert len(sweep_axes.cameras(BASE, sweep_axes.chosen(BASE, {}))) > 10


@pytest.mark.parametrize("name", sorted(emission.GENERATORS))
def test_density_multiplies_the_dots(name: str) -> None:
    """To 2 %: lattices have an edge, a tile's sites are whole numbers."""
    counts = []
    for density in (0.5, 1.0, 2.0):
        dots = emission.pattern(name, 60.0, 42.0, 0, density).dots
        assert dots is not None
        counts.append(len(dots))
    assert counts[0] / counts[1] == pytest.approx(0.5, rel=0.02)
    assert counts[2] / counts[1] == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize(
    ("sensor", "axes", "message"),
    [
        ("d435", {"baseline": [0.1]}, "axis must be a known name; got 'baseline'"),
        ("kinect-v1", {}, "sensor must be a stereo camera"),
        ("d435", {"baseline_m": [-0.1]}, "baseline_m must be > 0; got -0.1"),
        ("d435", {"focal_px": [0.0]}, "fx_px must be > 0; got 0.0"),
        ("d435", {"projector_x_m": [29.0]}, "projector.position_m.x must be in .*; got 29.0"),
        ("d435", {"dot_density": [0.0]}, "projector.dot_density must be in .*; got 0.0"),
    ],
)
def test_refused_before_any_rendering(sensor: str, axes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        sweep.sweep(presets.load(sensor), axes)
    if "axis" in message:
        with pytest.raises(InputError, match=message):
            sweep_axes.cameras(presets.load(sensor), axes)


@pytest.mark.parametrize(
    ("distances", "message"),
    [
        ([], "distance_m must hold a distance; got none"),
        ([1.0, 25.0], r"distance_m must be in \[0.1, 10\]; got 25.0"),
        ([math.nan], "distance_m must be in .*; got nan"),
    ],
)
def test_distances_refused(distances: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        sweep.sweep(BASE, {}, distances_m=distances)


def test_seed_refused() -> None:
    with pytest.raises(InputError, match=r"seed must be in .*; got -1"):
        sweep.sweep(BASE, {}, seed=-1)


def test_image_patterns_have_no_density_axis(tmp_path) -> None:
    """Another density is refused if requested, and left out of the default axes."""
    named = [("projector.pattern", str(tmp_path / "dots.png"))]
    camera = edits.with_values(BASE, named)
    assert not sweep_axes.chosen(camera, {})["dot_density"]
    assert len(sweep_axes.cameras(camera, {"dot_density": [2.0]})) == 2
    with pytest.raises(InputError, match=r"projector.dot_density must be 1 for .*; got 2"):
        emission.pattern(camera.projector.pattern, 60.0, 42.0, 0, 2.0)
    with pytest.raises(InputError, match="pattern file must be readable"):
        sweep.sweep(camera, {"baseline_m": [0.1]})


def test_density_is_swept_if_every_emitter_is_generated() -> None:
    camera = presets.load("d415")
    assert sweep_axes.chosen(camera, {})["dot_density"]
    first = edits.with_values(camera, [("projector.emitters.1.pattern", "dots.png")])
    assert not sweep_axes.chosen(first, {})["dot_density"]


def test_refused_sweep_leaves_nothing(tmp_path) -> None:
    with pytest.raises(InputError):
        sweep.run(BASE, {"baseline_m": [-1.0]}, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_cameras_without_figures_give_a_warning(tmp_path, monkeypatch) -> None:
    result = dataclasses.replace(_result(), reference=1)
    monkeypatch.setattr(sweep, "sweep", lambda *_, **__: result)
    message = (
        r"^no figures at 2 m, .* no depth: base \(no_surface\), baseline 20 mm \(no_surface\), "
    )
    with pytest.warns(UserWarning, match=message):
        sweep.run(BASE, {}, tmp_path / "out")


def test_tables_hold_every_camera_at_every_distance() -> None:
    """Missing figures are null in JSON and empty cells in CSV."""
    result = _result()
    plain = json.loads(record.dumps(sweep.listed(result)))
    rows = list(csv.DictReader(io.StringIO(sweep.table(result))))
    assert len(rows) == len(result.cameras) * 2
    assert [camera["name"] for camera in plain["cameras"]][:2] == ["base", "baseline 20 mm"]
    assert plain["cameras"][1]["points"][1]["noise_m"] is None
    assert rows[3]["noise_m"] == ""
    assert float(rows[2]["noise_m"]) == 2e-3
    assert float(rows[0]["law_m"]) == pytest.approx(0.1 / BASE.focal_baseline_px_m, rel=1e-5)
    assert float(rows[1]["law_m"]) == pytest.approx(4 * float(rows[0]["law_m"]), rel=1e-5)


@pytest.mark.parametrize("full", [False, True])
def test_picture_is_drawn(full: bool) -> None:
    assert picture.draw(_result(full)).startswith(b"\x89PNG")


def test_picture_groups_every_reason_once() -> None:
    grouped = [cause for _, causes in picture.GROUPS.values() for cause in causes]
    assert sorted(grouped) == sorted(cause.name.lower() for cause in Reason if cause)
