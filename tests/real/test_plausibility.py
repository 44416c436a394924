"""Real captures pass the plausibility checks; deliberate errors are detected."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from starling.calibration.correlation import high_passed, local_ncc, right_in_left
from starling.calibration.observation import Observation, truth_px
from starling.calibration.plausibility import checks
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.metrics import depth_edges
from starling.sim.sensor import presets, resolve


def _folder(captures: Path, name: str) -> Path:
    if not (captures / name).is_dir():
        pytest.skip(f"no capture set {name} in {captures}")
    return captures / name


def _observation(scene: capture.CapturedScene) -> Observation:
    """A scene's images; its surface is not built, which takes longer and is not looked at."""
    frame = scene.frame(0)
    left, right, left_off, right_off = (
        None if image is None else image.astype(np.float32)
        for image in (frame.ir_left, frame.ir_right, frame.ir_left_off, frame.ir_right_off)
    )
    return Observation(
        name=scene.name,
        room=scene.room,
        info=scene.info,
        left=left,
        right=right,
        left_off=left_off,
        right_off=right_off,
        depth_m=frame.depth_m,
        truth_m=scene.truth_m(),
        scene=None,
        metric=False,
        repeats=None,
    )


def _observations(folder: Path, *names: str) -> tuple[Observation, ...]:
    scenes = capture.open_set(folder).scenes
    return tuple(_observation(scene) for scene in scenes if not names or scene.name in names)


@pytest.fixture(scope="module")
def three(captures: Path) -> tuple[Observation, ...]:
    """Three rooms: the best, a far one and the sunlit one."""
    return _observations(_folder(captures, "d415-faro"), "0060", "0742", "5881")


def _refusal(observations: tuple[Observation, ...], requested: str = "d415") -> str:
    sensor = observations[0].info.geometry_into(presets.load(requested))
    with pytest.raises(InputError) as caught:
        checks.check(observations, sensor)
    return str(caught.value)


@pytest.mark.long
def test_every_room_passes(captures: Path) -> None:
    folder = _folder(captures, "d415-faro")
    sensor = resolve.load("d415", captures=str(folder))
    everything = _observations(folder)
    assert len(everything) == 15
    assert checks.check(everything, sensor) == ()
    for item in everything:
        assert checks.check([item], sensor) == ()


def test_the_table_passes(captures: Path) -> None:
    """Half of it is texture without dots, and its reference is of another background.

    There the device's own depth agrees with the infrared pair and not with the reference.
    """
    folder = _folder(captures, "d415-table")
    sensor = resolve.load("d415", captures=str(folder))
    (table,) = _observations(folder)
    (message,) = checks.check([table], sensor)
    assert message.startswith(
        "reference depth of scene table disagrees with its infrared pair in 2"
    )
    assert checks.check([dataclasses.replace(table, truth_m=None)], sensor) == ()
    off = dataclasses.replace(
        table, left=table.left_off, right=table.right_off, left_off=None, right_off=None
    )
    assert _refusal((off,)).startswith("captures must show the projector's dots; got dots in")


def test_depth_alone_passes(captures: Path) -> None:
    folder = _folder(captures, "kinect-v1-tables")
    assert checks.check(_observations(folder), presets.load("kinect-v1")) == ()


@pytest.mark.parametrize("requested", ["d435", "d455"])
def test_wrong_preset_is_detected(three: tuple[Observation, ...], requested: str) -> None:
    assert _refusal(three, requested).endswith("Preset d415 fits better.")


@pytest.mark.parametrize("factor", [1000.0, 10.0, 1e-3])
def test_wrong_depth_unit_is_detected(three: tuple[Observation, ...], factor: float) -> None:
    wrong = [dataclasses.replace(item, truth_m=np.float32(factor) * item.truth_m) for item in three]
    message = _refusal(tuple(wrong))
    assert float(message.split("got depths ")[1].split()[0]) == pytest.approx(factor, rel=0.01)
    message = _refusal((three[0], wrong[1], three[2]))
    assert message.startswith("reference depth of scene 0742 must have the scale")


def test_swapped_images_are_detected(three: tuple[Observation, ...]) -> None:
    for item in three:
        swapped = dataclasses.replace(item, left=item.right, right=item.left)
        assert "must not be swapped" in _refusal((swapped,))


def test_another_view_of_the_same_room_is_detected(captures: Path) -> None:
    """Two similar poses in one room: at most a third of the windows agree."""
    first, second = _observations(_folder(captures, "d415-faro"), "3617", "3629")
    wrong = dataclasses.replace(first, truth_m=second.truth_m)
    message = _refusal((wrong, second))
    assert message.startswith(
        "reference depth of scene 3617 must show the same scene as its infrared pair"
    )


@pytest.mark.parametrize(
    ("name", "median", "quartile"), [("0060", 0.976, 0.966), ("3049", 0.962, 0.938)]
)
def test_ceiling_of_the_correlation(
    captures: Path, name: str, median: float, quartile: float
) -> None:
    """The right image warped onto the left by the scanner's disparity, as measured before."""
    (item,) = _observations(_folder(captures, "d415-faro"), name)
    disparity = truth_px(item)
    assert disparity is not None and item.left is not None and item.right is not None
    warped, inside = right_in_left(item.right, disparity)
    usable = inside & ~depth_edges(disparity)
    result = local_ncc(high_passed(item.left), high_passed(warped), usable)
    assert len(result) > 1500
    assert np.median(result) == pytest.approx(median, abs=0.002)
    assert np.percentile(result, 25) == pytest.approx(quartile, abs=0.002)
