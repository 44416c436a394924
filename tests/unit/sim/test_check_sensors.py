"""Check of sensors without rendering: geometry, judgement, tables, picture, verb."""

from __future__ import annotations

import dataclasses
import json
import math
import types
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.commands.check_sensors import check, measurement, picture, planes, table
from starling.sim.commands.check_sensors.check import CheckedCamera, FigureComparison
from starling.sim.commands.check_sensors.measurement import CameraMeasurement, field_deg
from starling.sim.commands.check_sensors.planes import FlatTarget
from starling.sim.scene.scene import Ambient
from starling.sim.sensor import datasheets, modes, presets
from starling.sim.sensor.datasheets import Datasheet, StatedFigure
from starling.sim.sensor.edits import with_values
from tests.unit.command_line import Capsys, refused, run

D435 = presets.load("d435")
NEAR = StatedFigure(figure="minimum_distance_m", value=(0.195,), source="sheet, table 4")
FIELD = StatedFigure(
    figure="horizontal_field_deg", value=(84.0, 90.0), source="sheet", mode="1280x720"
)
FILL = StatedFigure(figure="fill_pct", value=(99.0,), distance_m=4.0, source="sheet")


def _camera(preset: str = "d435", *, noise: bool = True) -> CheckedCamera:
    """A camera of three figures: one of them reached, one missed, one in another mode."""
    return CheckedCamera(
        preset=preset,
        camera="Intel RealSense D435",
        mode="848x480",
        comparisons=(
            FigureComparison(stated=NEAR, simulated=0.17412, outcome="reached"),
            FigureComparison(stated=FIELD, simulated=None, outcome="mode not available"),
            FigureComparison(stated=FILL, simulated=math.nan, outcome="missed"),
        ),
        noise_mm={0.3: math.nan, 1.0: 4.0, 2.0: 16.0} if noise else {},
    )


def _shot(depth_m: np.ndarray, truth_m: np.ndarray) -> Any:
    """A reading with these depth maps."""
    truth = types.SimpleNamespace(depth_m=truth_m.astype(np.float32))
    return types.SimpleNamespace(
        depth=types.SimpleNamespace(depth_m=depth_m.astype(np.float32)),
        layers=types.SimpleNamespace(truth=truth),
    )


@pytest.mark.parametrize(
    ("focal_px", "centre_px", "size_px", "expected_deg"),
    [
        (320.0, 319.5, 640, 90.0),
        (320.0 / math.sqrt(3), 319.5, 640, 120.0),
        (640.0, -0.5, 640, 45.0),  # All columns lie on one side of the axis.
        (320.0, 639.5, 640, math.degrees(math.atan(2.0))),
    ],
)
def test_field_between_the_outer_edges(
    focal_px: float, centre_px: float, size_px: int, expected_deg: float
) -> None:
    assert field_deg(focal_px, centre_px, size_px) == pytest.approx(expected_deg)


def test_field_of_depth_is_what_both_imagers_see() -> None:
    """HFOV / 2 + atan(tan(HFOV / 2) - B / Z): D400 datasheet 337029, section 4.4."""
    sensor = with_values(D435, [("fx_px", 424.0), ("cx_px", 423.5), ("baseline_m", 0.05)])
    expected_deg = 45 + math.degrees(math.atan(1 - 0.05 / 0.5))
    assert measurement.depth_field_deg(sensor, 0.5) == pytest.approx(expected_deg)
    stated = StatedFigure(
        figure="horizontal_depth_field_deg", value=(87.0,), distance_m=0.5, source="sheet"
    )
    assert CameraMeasurement(sensor).simulated(stated) == pytest.approx(expected_deg)


def test_geometric_band_is_f_b_over_z() -> None:
    sensor = with_values(D435, [("fx_px", 400.0), ("baseline_m", 0.05)])
    assert planes.geometric_band_px(sensor, 1.0) == 20
    assert planes.geometric_band_px(sensor, 0.5) == 40
    assert planes.geometric_band_px(sensor, 0.02) == sensor.width
    assert planes.geometric_band_px(presets.load("kinect-v1"), 1.0) == 0


def test_strip_sees_the_middle_rows() -> None:
    strip = planes.strip(D435)
    assert (strip.width, strip.height) == (848, 96)
    assert strip.cy_px == pytest.approx(D435.cy_px - 192)
    low = with_values(D435, [("height", 64), ("cy_px", 31.5)])
    assert planes.strip(low) == low


def test_figures_of_a_scaled_plane() -> None:
    """Depth of a plane is 1 % too far; its RMS is from its own plane, so it is 0."""
    truth = np.full((100, 848), 2.0)
    depth = 1.01 * truth
    depth[:, :30] = np.nan
    depth[:10, 30:] = 9.0  # Wrong depth is none.
    figures = planes.figures(_shot(depth, truth), D435, 2.0)
    assert figures.accuracy_pct == pytest.approx(1.0, abs=1e-4)
    assert figures.bias_pct == pytest.approx(1.0, abs=1e-4)
    near = planes.figures(_shot(0.99 * truth, truth), D435, 2.0)
    assert (near.bias_pct, near.median_error_pct) == pytest.approx((-1.0, 1.0), abs=1e-4)
    assert figures.plane_rms_pct == pytest.approx(0.0, abs=1e-4)
    assert figures.fill_pct == 100.0  # The central 80 % starts at row 10 and column 85.
    assert figures.left_band_pct == pytest.approx(100 * 30 / 848)
    reachable = 848 - round(D435.focal_baseline_px_m / 2.0)
    assert figures.reachable_fill_pct == pytest.approx(100 * 0.9 * 818 / reachable)


def test_figures_of_noise() -> None:
    rng = np.random.default_rng(0)
    truth = np.full((200, 300), 1.0)
    depth = truth + rng.normal(0, 0.01, truth.shape)
    figures = planes.figures(_shot(depth, truth), D435, 1.0)
    # A normal law cut at its quantiles of 0.5 and 99.5 %.
    assert figures.plane_rms_pct == pytest.approx(0.962, rel=0.01)
    assert figures.bias_pct == pytest.approx(0.0, abs=0.03)
    assert figures.accuracy_pct == pytest.approx(0.6745, rel=0.03)  # Median of a half-normal law.


def test_plane_fits_leave_outliers_out() -> None:
    truth = np.full((100, 200), 1.0)
    depth = truth.copy()
    depth[50, 30:90] = 1.09  # 60 of the 12800 central pixels, 0.47 %.
    figures = planes.figures(_shot(depth, truth), D435, 1.0)
    assert figures.plane_rms_pct == pytest.approx(0.0, abs=1e-3)
    depth[50, 30:140] = 1.09
    figures = planes.figures(_shot(depth, truth), D435, 1.0)
    assert figures.plane_rms_pct > 0.3


@pytest.mark.parametrize("depth_m", [math.nan, 5.0])
def test_figures_without_right_depth(depth_m: float) -> None:
    truth = np.full((60, 80), 1.0)
    figures = planes.figures(_shot(np.full((60, 80), depth_m), truth), D435, 1.0)
    assert math.isnan(figures.accuracy_pct) and math.isnan(figures.plane_rms_pct)
    assert figures.fill_pct == 0.0
    assert figures.left_band_pct == 100.0


def test_reachable_area_may_be_empty() -> None:
    truth = np.full((60, 80), 0.05)
    assert planes.figures(_shot(truth, truth), D435, 0.05).reachable_fill_pct == 0.0


@pytest.mark.parametrize(
    ("end_m", "start_m"), [(0.17, 0.195), (0.3, 0.195), (0.195, 0.195), (0.05, 0.2)]
)
def test_near_end_of_the_range(end_m: float, start_m: float) -> None:
    """The search ends within 0.35 % inside the range, from either side of its end."""
    nearest = measurement.range_end_m(lambda z: z >= end_m, start_m, outward=1 / 1.25)
    assert end_m <= nearest <= 1.0035 * end_m


@pytest.mark.parametrize(("end_m", "start_m"), [(6.2, 3.0), (8.5, 10.0), (3.0, 3.0)])
def test_far_end_of_the_range(end_m: float, start_m: float) -> None:
    farthest = measurement.range_end_m(lambda z: z <= end_m, start_m, outward=1.25)
    assert end_m / 1.0035 <= farthest <= end_m


def test_search_of_the_range_is_bounded() -> None:
    assert math.isnan(measurement.range_end_m(lambda _: False, 3.0, outward=1.25))
    everywhere = measurement.range_end_m(lambda _: True, 3.0, outward=1.25)
    assert everywhere == pytest.approx(3.0 * 1.25**8)


def test_light_of_a_target() -> None:
    room, sunny = (
        planes.scene(FlatTarget(distance_m=1.0, sunlight=sunlight), D435).ambient
        for sunlight in (False, True)
    )
    assert room == Ambient(irradiance_w_m2=planes.ROOM_W_M2)
    # The D435 has no filter: 50 klux have more than the 23 W/m^2 of a band of 50 nm.
    assert 23 < sunny.irradiance_w_m2 < 1000


def test_textured_target_has_the_reflectance_of_the_plain_one() -> None:
    (plain,) = planes.scene(FlatTarget(distance_m=1.0), D435).bodies
    (textured,) = planes.scene(FlatTarget(distance_m=1.0, target="textured"), D435).bodies
    assert plain.texture is None and textured.texture is not None
    assert textured.texture.mean() == pytest.approx(plain.material.reflectance, abs=0.01)
    assert textured.mesh.uv is not None


def test_geometry_is_compared_without_rendering() -> None:
    camera = CameraMeasurement(with_values(D435, [("fx_px", 424.0), ("cx_px", 423.5)]))
    field = dataclasses.replace(FIELD, value=(90.0,), mode="")
    comparison = check.compare(field, camera)
    assert comparison.simulated == pytest.approx(90.0) and comparison.outcome == "reached"
    baseline = StatedFigure(figure="baseline_mm", value=(51.0,), source="sheet")
    assert check.compare(baseline, camera).outcome == "missed"


def test_other_modes_are_not_simulated() -> None:
    comparison = check.compare(FIELD, None)
    assert comparison == FigureComparison(
        stated=FIELD, simulated=None, outcome="mode not available"
    )


def test_figures_are_simulated_in_their_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures without a mode are those of the preset's own size; NaN is a miss."""
    sizes: dict[str, set[str]] = {}

    def simulated(self: CameraMeasurement, stated: StatedFigure) -> float:
        sizes.setdefault(stated.mode, set()).add(modes.name_of(self.sensor))
        return math.nan

    monkeypatch.setattr(CameraMeasurement, "simulated", simulated)
    result = check.check("d435")
    assert result.mode == "848x480" and result.noise_mm == {}
    assert sizes.pop("") == {"848x480"}
    assert len(sizes) > 4 and all(size == {mode} for mode, size in sizes.items())
    assert {item.outcome for item in result.comparisons} == {"missed"}


def test_figures_are_simulated_with_their_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    step_px = ("matcher.refinement.quantum_px", 0.25)
    figures = (dataclasses.replace(FILL, mode=""), dataclasses.replace(FILL, settings=(step_px,)))
    monkeypatch.setattr(datasheets, "load", lambda _: Datasheet(camera="A", figures=figures))
    monkeypatch.setattr(
        CameraMeasurement, "simulated", lambda self, _: self.sensor.matcher.refinement.quantum_px
    )
    steps = [item.simulated for item in check.check("d435").comparisons]
    assert steps == [1 / 32, 0.25]


def test_values_by_our_definition_follow_the_vendors(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"median_error_pct": 0.6, "accuracy_pct": 2.4}
    monkeypatch.setattr(CameraMeasurement, "simulated", lambda _, stated: values[stated.figure])
    stated = StatedFigure(figure="median_error_pct", value=(2.0,), distance_m=4.0, source="sheet")
    comparison = check.compare(stated, CameraMeasurement(D435))
    assert (comparison.simulated, comparison.our_value, comparison.outcome) == (0.6, 2.4, "reached")
    camera = dataclasses.replace(_camera(), comparisons=(comparison,))
    assert "| 0.6 (2.4) | reached |" in table.markdown([camera])


def test_modes_that_a_preset_lacks_are_not_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    sheet = Datasheet(camera="A", figures=(dataclasses.replace(FIELD, mode="320x240"),))
    monkeypatch.setattr(datasheets, "load", lambda _: sheet)
    (comparison,) = check.check("d435").comparisons
    assert comparison.outcome == "mode not available"


def test_tables() -> None:
    cameras = table.listed([_camera()])
    near, field, fill = cameras["d435"]["figures"]
    assert near == {
        "figure": "minimum distance [m]",
        "stated": "<= 0.195",
        "simulated": 0.174,
        "our_value": None,
        "result": "reached",
        "source": "sheet, table 4",
    }
    assert (field["simulated"], field["result"]) == (None, "mode not available")
    assert (fill["simulated"], fill["result"]) == (None, "missed")
    lines = table.text(cameras).splitlines()
    assert lines[0] == "d435: Intel RealSense D435, 848x480"
    assert lines[1].split() == ["stated", "simulated", "result"]
    assert lines[2].split()[-4:] == ["<=", "0.195", "0.174", "reached"]
    page = table.markdown([_camera()]).splitlines()
    assert page[0] == "## d435: Intel RealSense D435, 848x480"
    assert page[4] == "| minimum distance [m] | <= 0.195 | 0.174 | reached | sheet, table 4 |"
    assert page[6] == "| fill rate, at 4 m [%] | >= 99 | - | missed | sheet |"


@pytest.mark.parametrize("count", [1, 2, 9])
def test_picture_is_small(count: int) -> None:
    cameras = [_camera(f"camera {number}") for number in range(count)]
    data = picture.draw(cameras)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None and image.shape == (440, 720, 3)
    assert len(data) < 100_000


def _check(preset: str, *, noise_m: Any = (), **_: Any) -> CheckedCamera:
    return _camera(preset, noise=bool(noise_m))


def test_run_writes_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "check", _check)
    out = tmp_path / "sensors"
    result = check.run(["d435", "d415", "d435"], out)
    assert list(result) == ["d435", "d415"]
    assert sorted(path.name for path in out.iterdir()) == [
        "noise.png",
        "sensors.json",
        "sensors.md",
        "starling.json",
    ]
    stored = json.loads((out / "sensors.json").read_text())
    assert stored["cameras"] == result
    assert stored["noise_mm"]["d415"] == {"0.3": None, "1.0": 4.0, "2.0": 16.0}
    assert json.loads((out / "starling.json").read_text())["arguments"]["names"] == [
        "d435",
        "d415",
    ]


@pytest.mark.parametrize(
    ("names", "seed", "message"),
    [
        (["d436"], 0, "camera must be a known name; got 'd436'. Known: d435"),
        (["d435"], -1, r"seed must be in \[0, "),
    ],
)
def test_bad_arguments_are_refused(
    names: list[str], seed: int, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        check.run(names, tmp_path / "out", seed=seed)
    assert not list(tmp_path.iterdir())


def test_verb(capsys: Capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "check", _check)
    code, out, _ = run("sensors", "check", "d435", capsys=capsys)
    assert code == 0 and out.startswith("d435: Intel RealSense D435, 848x480\n")
    code, out, _ = run("sensors", "check", "--json", capsys=capsys)
    assert code == 0 and "d455" in json.loads(out)
    assert "camera must be a known name" in refused("sensors", "check", "d4", capsys=capsys)
    code, out, _ = run("sensors", "check", "--help", capsys=capsys)
    assert code == 0 and "Example: starling sensors check d435" in out
