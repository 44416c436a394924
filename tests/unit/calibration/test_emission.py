"""Directions from an emitter, and how they move with all that a fit frees."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from starling.calibration.pattern import emission
from starling.calibration.pattern.emission import Alignment, Directions, Seen
from starling.sim.geometry import frames

FOCAL_PX = 450.0
# Directions are single precision: 1e-7 of a cosine, over two steps of 1e-3 m and more.
STEP_M, STEP_RAD, STEP_PX = 2e-3, 4e-3, 1.0
RELATIVE = 5e-3  # Of the largest derivative: the differences' own third order is 1e-3 of it.

positions = st.tuples(*[st.floats(-0.1, 0.1)] * 3).map(np.array)
rotations = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
scales = st.floats(0.98, 1.02)
alignments = st.builds(
    Alignment,
    offset_y=st.floats(-2, 2),
    roll=st.floats(-2, 2),
    offset_x=st.floats(-2, 2),
    focal_baseline=st.floats(-1, 1),
)


def _seen(side: str = "right") -> Seen:
    """Points between 0.5 and 3 m over a field of 60 by 40 degrees."""
    rng = np.random.default_rng(3)
    slopes = rng.uniform([-0.6, -0.4], [0.6, 0.4], (40, 2))
    depth = rng.uniform(0.5, 3.0, (40, 1))
    points = np.concatenate([slopes, np.ones((40, 1))], axis=1) * depth
    points[:, 0] += 0.05 if side == "right" else 0.0
    return Seen(
        points_m=points.astype(np.float32),
        slopes=slopes.astype(np.float32),
        side="right" if side == "right" else "left",
        focal_px=FOCAL_PX,
    )


def _central(at: Callable[[float], Directions], step: float) -> np.ndarray:
    return (at(step).cosines.astype(np.float64) - at(-step).cosines) / (2 * step)


def _check(partial: np.ndarray, difference: np.ndarray) -> None:
    np.testing.assert_allclose(partial, difference, atol=RELATIVE * np.abs(difference).max() + 1e-6)


@given(positions, rotations, scales)
def test_place(position: np.ndarray, rotation: tuple[float, float, float], scale: float) -> None:
    """Against central differences; the cosines themselves are held by the test of a known dot."""
    points = _seen().points_m

    def at(place: np.ndarray) -> Directions:
        return emission.directions(points, position_m=place, rotation_deg=rotation, scale=scale)

    partials = emission.place_partials(at(position))
    for axis in range(3):
        along = np.eye(3)[axis]
        _check(partials[axis], _central(lambda by, a=along: at(position + by * a), STEP_M))


@given(positions, rotations, scales)
def test_turn(position: np.ndarray, rotation: tuple[float, float, float], scale: float) -> None:
    """Turns are about the projector's own axes, whatever its rotation is already."""
    points = _seen().points_m
    axes = Rotation.from_rotvec(rotation, degrees=True)

    def at(turn: np.ndarray) -> Directions:
        x, y, z = (axes * Rotation.from_rotvec(turn)).as_rotvec(degrees=True)
        return emission.directions(points, position_m=position, rotation_deg=(x, y, z), scale=scale)

    partials = emission.turn_partials(at(np.zeros(3)))
    for axis in range(2):
        along = np.eye(3)[axis]
        _check(partials[axis], _central(lambda by, a=along: at(by * a), STEP_RAD))


@given(positions, rotations, scales)
def test_scale(position: np.ndarray, rotation: tuple[float, float, float], scale: float) -> None:
    points = _seen().points_m

    def at(by: float) -> Directions:
        return emission.directions(
            points, position_m=position, rotation_deg=rotation, scale=scale + by
        )

    _check(emission.scale_partial(at(0.0)), _central(at, 1e-2))


@given(positions, rotations, scales, alignments)
def test_right(
    position: np.ndarray,
    rotation: tuple[float, float, float],
    scale: float,
    alignment: Alignment,
) -> None:
    """Each of `RIGHT`, from any alignment: the points of the pixels move, seen from one place."""
    seen = _seen()

    def at(vector: np.ndarray) -> Directions:
        return emission.directions(
            seen.moved(Alignment.of(vector)),
            position_m=position,
            rotation_deg=rotation,
            scale=scale,
        )

    start = alignment.as_vector()
    partials = emission.right_partials(seen, at(start))
    for number in range(len(emission.RIGHT)):
        along = np.eye(4)[number]
        _check(partials[number], _central(lambda by, a=along: at(start + by * a), STEP_PX))


@given(alignments)
def test_the_left_image_is_never_off(alignment: Alignment) -> None:
    seen = _seen("left")
    np.testing.assert_array_equal(seen.moved(alignment), seen.points_m)
    there = emission.directions(
        seen.points_m, position_m=np.zeros(3), rotation_deg=(0, 0, 0), scale=1.0
    )
    assert not emission.right_partials(seen, there).any()


def test_where_the_right_image_is_off_its_pixels_show_other_points() -> None:
    """A point lands down and right of where it should: its pixel's own ray ends up off it.

    All with numbers by hand: focal length 450 px, 2 m away, on the axis and at a tangent of 0.5.
    """
    axis = Seen(
        points_m=np.array([[0.05, 0, 2.0]], np.float32),
        slopes=np.zeros((1, 2), np.float32),
        side="right",
        focal_px=FOCAL_PX,
    )
    moved = axis.moved(Alignment(offset_x=0.9, offset_y=0.45))
    np.testing.assert_allclose(moved, [[0.05 - 0.004, -0.002, 2.0]], atol=1e-7)
    # Less baseline by 1 mm: the imager stands that much further left, and so does what it shows.
    shorter = axis.moved(Alignment(focal_baseline=1e-3 * FOCAL_PX))
    np.testing.assert_allclose(shorter, [[0.049, 0, 2.0]], atol=1e-7)
    beside = dataclasses.replace(
        axis,
        points_m=np.array([[1.05, 0, 2.0]], np.float32),
        slopes=np.array([[0.5, 0]], np.float32),
    )
    # Turned clockwise, a point right of the axis lands lower: the pixel here shows a higher one.
    turned = beside.moved(Alignment(roll=0.9))
    np.testing.assert_allclose(turned, [[1.05, -0.002, 2.0]], atol=1e-7)


def test_cosines_of_a_known_point() -> None:
    """Seen from the emitter's own axes, over the scale."""
    position, rotation = np.array([0.03, 0.01, -0.02]), (3.0, -8.0, 5.0)
    local = np.array([0.3, -0.2, 1.5])
    point = position + frames.rotation(rotation) @ local
    there = emission.directions(
        point[None].astype(np.float32), position_m=position, rotation_deg=rotation, scale=0.99
    )
    far = np.linalg.norm(local)
    np.testing.assert_allclose(there.cosines, local[None, :2] / far / 0.99, atol=1e-6)
    np.testing.assert_allclose(there.range_m, far, rtol=1e-6)


@given(alignments)
def test_a_vector_and_back(alignment: Alignment) -> None:
    assert Alignment.of(alignment.as_vector()) == alignment
