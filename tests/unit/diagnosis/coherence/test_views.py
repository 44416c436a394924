"""Views of a scene: visible surfaces, directions of the pattern, and scenes as they are loaded."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.report import first_answer
from starling.diagnosis.scenes.observation import DepthObservation
from starling.diagnosis.scenes.selection import ignore_scene
from starling.diagnosis.scenes.strata import Strata, stratify
from starling.diagnosis.where.coherence import views
from starling.diagnosis.where.coherence.shares import CoherenceSplit
from starling.diagnosis.where.coherence.split import coherence_split
from tests.unit.diagnosis.coherence import made_pairs
from tests.unit.diagnosis.coherence.made_pairs import HEIGHT, INFO, WALLS, WIDTH, Amplitudes


def box(near_px: float, far_px: float) -> Strata:
    """Return the strata of a box before a wall."""
    disparity = np.full((HEIGHT, WIDTH), far_px, np.float32)
    disparity[60:160, 200:300] = near_px
    wall = made_pairs.strata_of(WALLS[0])
    return stratify(disparity, wall.expected, INFO, body=wall.body, projector=wall.projector)


def test_what_the_right_imager_does_not_see_is_left_out() -> None:
    """Left of a near thing, a strip as wide as the disparity's step is hidden."""
    surface = views.surface_pixels(box(70.0, 20.0))
    assert not surface[100, 150:200].any()
    assert surface[100, 120:135].all() and surface[20, 150:200].all()
    assert surface[100, 220:280].all()


def test_hidden_pixels_at_the_far_side_count() -> None:
    assert views.surface_pixels(box(70.0, 20.0))[100, 320:360].all()


@pytest.mark.parametrize("scale", [0.99, 1.0, 1.01])
def test_directions_follow_the_pattern_scale(scale: float) -> None:
    """The pattern scale multiplies direction cosines."""
    strata = made_pairs.strata_of(WALLS[0])
    place = views.directions(strata, scale).astype(np.float64)
    nominal = np.stack(
        [(place[..., 0] - INFO.cx_px) / INFO.fx_px, (place[..., 1] - INFO.cy_px) / INFO.fy_px], -1
    )
    cosines, seen = (
        each / np.sqrt(1 + np.sum(each**2, axis=-1, keepdims=True))
        for each in (nominal, strata.projector.astype(np.float64))
    )
    np.testing.assert_allclose(scale * cosines, seen, atol=1e-6)


def test_pattern_of_scaled_directions_repeats_at_its_scale() -> None:
    """A pattern whose scale differs by room repeats only if rooms are compared at their scales."""
    base, real, strata, rooms, _ = made_pairs.rooms_of(Amplitudes(pattern=3, noise=1))
    pattern = {}
    for scales in ([1.0] * 4, [0.98, 1.0, 1.02, 1.04]):
        split = coherence_split(base, real, strata, rooms, scales)
        pattern[scales[0]] = split.images[-1].pattern[0]
    assert pattern[1.0] > 0.85 and pattern[0.98] < 0.6


def test_places_without_direction_are_unknown() -> None:
    strata = made_pairs.strata_of(WALLS[0])
    x, y = views.pixel_grid(strata.counted.shape)
    view = views.SampledView(left_x=x, left_y=y, right_x=x, right_y=y, known=strata.counted)
    nothing = np.full_like(strata.projector, np.nan)
    assert not views.projector_view(view, nothing, strata.counted).known.any()
    inside = views.projector_view(view, views.directions(strata), strata.counted)
    assert 0.5 < inside.known.mean() < 1


def model_of(real: Any, base: Any) -> Any:
    return SimpleNamespace(
        name="attic",
        real=real,
        against=base,
        strata=made_pairs.strata_of(WALLS[0]),
        sensor=SimpleNamespace(projector=SimpleNamespace(pattern_scale=1.0)),
    )


def test_the_first_scenes_are_announced_as_they_are_loaded() -> None:
    lines: list[str] = []
    announce = first_answer.announcement(lines.append, None)
    real, base = made_pairs.pair(
        WALLS[0], Amplitudes(explained=3, scene=3, noise=1, simulated_noise=1), seed=0
    )
    depth = DepthObservation(device_px=np.full((1, HEIGHT, WIDTH), 9.0, np.float32))
    announce(model_of(depth, depth))
    assert lines == []
    for _ in range(5):
        announce(model_of(real, base))
    assert len(lines) == 3 and len(set(lines)) == 1
    words = lines[0].split()
    assert lines[0].startswith("attic: simulated captures explain 4") and len(words) <= 25
    assert "both imagers see 9" in lines[0] and "noise ratio" in lines[0]
    ignore_scene(model_of(real, base))


def test_no_scene_has_no_split() -> None:
    assert coherence_split([], [], [], [], []) == CoherenceSplit()
