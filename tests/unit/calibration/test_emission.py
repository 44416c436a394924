"""Direction cosines from an emitter, and their derivatives."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from starling.calibration.pattern import emission
from starling.calibration.pattern.emission import Directions, RightAlignment, SurfacePoints
from starling.sim.geometry import frames

FOCAL_PX = 450.0
# Directions are single precision: 1e-7 of a cosine, over two steps of 1e-3 m and more.
STEP_M, STEP_RAD, STEP_PX = 2e-3, 4e-3, 1.0
RELATIVE = 5e-3  # Tolerance over the largest derivative; finite differences err by 1e-3 of it.

positions = st.tuples(*[st.floats(-0.1, 0.1)] * 3).map(np.array)
rotations = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
scales = st.floats(0.98, 1.02)
alignments = st.builds(
    RightAlignment,
    offset_y=st.floats(-2, 2),
    roll=st.floats(-2, 2),
    offset_x=st.floats(-2, 2),
    focal_baseline=st.floats(-1, 1),
)


def _seen(side: str = "right") -> SurfacePoints:
    """Return points between 0.5 and 3 m in a field of 60 by 40 degrees."""
    rng = np.random.default_rng(3)
    slopes = rng.uniform([-0.6, -0.4], [0.6, 0.4], (40, 2))
    depth = rng.uniform(0.5, 3.0, (40, 1))
    points = np.concatenate([slopes, np.ones((40, 1))], axis=1) * depth
    points[:, 0] += 0.05 if side == "right" else 0.0
    return SurfacePoints(
        points_m=points.astype(np.float32),
        slopes=slopes.astype(np.float32),
        side="right" if side == "right" else "left",
        focal_px=FOCAL_PX,
    )


def _central(directions_at: Callable[[float], Directions], step: float) -> np.ndarray:
    return (directions_at(step).cosines.astype(np.float64) - directions_at(-step).cosines) / (
        2 * step
    )


def _check(partial: np.ndarray, difference: np.ndarray) -> None:
    np.testing.assert_allclose(partial, difference, atol=RELATIVE * np.abs(difference).max() + 1e-6)


@given(positions, rotations, scales)
def test_position_derivatives(
    position: np.ndarray, rotation: tuple[float, float, float], scale: float
) -> None:
    """Derivatives by position match central differences."""
    points = _seen().points_m

    def directions_at(place: np.ndarray) -> Directions:
        return emission.directions(points, position_m=place, rotation_deg=rotation, scale=scale)

    partials = emission.place_partials(directions_at(position))
    for axis in range(3):
        along = np.eye(3)[axis]
        _check(
            partials[axis],
            _central(lambda change, a=along: directions_at(position + change * a), STEP_M),
        )


@given(positions, rotations, scales)
def test_rotation_derivatives(
    position: np.ndarray, rotation: tuple[float, float, float], scale: float
) -> None:
    """Rotations are about the projector's axes, for any initial rotation."""
    points = _seen().points_m
    axes = Rotation.from_rotvec(rotation, degrees=True)

    def directions_at(turn: np.ndarray) -> Directions:
        x, y, z = (axes * Rotation.from_rotvec(turn)).as_rotvec(degrees=True)
        return emission.directions(points, position_m=position, rotation_deg=(x, y, z), scale=scale)

    partials = emission.turn_partials(directions_at(np.zeros(3)))
    for axis in range(2):
        along = np.eye(3)[axis]
        _check(
            partials[axis], _central(lambda change, a=along: directions_at(change * a), STEP_RAD)
        )


@given(positions, rotations, scales)
def test_scale_derivative(
    position: np.ndarray, rotation: tuple[float, float, float], scale: float
) -> None:
    points = _seen().points_m

    def directions_at(change: float) -> Directions:
        return emission.directions(
            points, position_m=position, rotation_deg=rotation, scale=scale + change
        )

    _check(emission.scale_partial(directions_at(0.0)), _central(directions_at, 1e-2))


@given(positions, rotations, scales, alignments)
def test_right_image_derivatives(
    position: np.ndarray,
    rotation: tuple[float, float, float],
    scale: float,
    alignment: RightAlignment,
) -> None:
    """Derivatives by each name in `RIGHT` match central differences at any alignment."""
    points = _seen()

    def directions_at(vector: np.ndarray) -> Directions:
        return emission.directions(
            points.shifted(RightAlignment.from_vector(vector)),
            position_m=position,
            rotation_deg=rotation,
            scale=scale,
        )

    start = alignment.as_vector()
    partials = emission.right_partials(points, directions_at(start))
    for number in range(len(emission.RIGHT)):
        along = np.eye(4)[number]
        _check(
            partials[number],
            _central(lambda change, a=along: directions_at(start + change * a), STEP_PX),
        )


@given(alignments)
def test_the_left_image_has_no_alignment(alignment: RightAlignment) -> None:
    seen = _seen("left")
    np.testing.assert_array_equal(seen.shifted(alignment), seen.points_m)
    rays = emission.directions(
        seen.points_m, position_m=np.zeros(3), rotation_deg=(0, 0, 0), scale=1.0
    )
    assert not emission.right_partials(seen, rays).any()


def test_a_misaligned_right_image_shows_other_points() -> None:
    """A shift of the right image moves the points of its pixels in the opposite direction.

    The expected numbers are for f = 450 px, 2 m, on the axis and at a tangent of 0.5.
    """
    axis = SurfacePoints(
        points_m=np.array([[0.05, 0, 2.0]], np.float32),
        slopes=np.zeros((1, 2), np.float32),
        side="right",
        focal_px=FOCAL_PX,
    )
    moved = axis.shifted(RightAlignment(offset_x=0.9, offset_y=0.45))
    np.testing.assert_allclose(moved, [[0.05 - 0.004, -0.002, 2.0]], atol=1e-7)
    # A baseline that is shorter by 1 mm moves the imager and its points to the left.
    shorter = axis.shifted(RightAlignment(focal_baseline=1e-3 * FOCAL_PX))
    np.testing.assert_allclose(shorter, [[0.049, 0, 2.0]], atol=1e-7)
    off_axis = dataclasses.replace(
        axis,
        points_m=np.array([[1.05, 0, 2.0]], np.float32),
        slopes=np.array([[0.5, 0]], np.float32),
    )
    # A clockwise rotation moves points right of the axis down, so the pixel shows a higher point.
    turned = off_axis.shifted(RightAlignment(roll=0.9))
    np.testing.assert_allclose(turned, [[1.05, -0.002, 2.0]], atol=1e-7)


def test_cosines_of_a_known_point() -> None:
    """Cosines refer to the projector's axes and are divided by the scale."""
    position, rotation = np.array([0.03, 0.01, -0.02]), (3.0, -8.0, 5.0)
    local = np.array([0.3, -0.2, 1.5])
    point = position + frames.rotation(rotation) @ local
    rays = emission.directions(
        point[None].astype(np.float32), position_m=position, rotation_deg=rotation, scale=0.99
    )
    far = np.linalg.norm(local)
    np.testing.assert_allclose(rays.cosines, local[None, :2] / far / 0.99, atol=1e-6)
    np.testing.assert_allclose(rays.range_m, far, rtol=1e-6)


@given(alignments)
def test_alignment_vector_round_trip(alignment: RightAlignment) -> None:
    assert RightAlignment.from_vector(alignment.as_vector()) == alignment
