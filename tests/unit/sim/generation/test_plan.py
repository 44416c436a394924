"""Plans: parsing, error messages, and drawing of views."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.datasets import draw, render_view
from starling.sim.datasets import plan as plans
from starling.sim.datasets.plan import view
from starling.sim.datasets.source import Pile, SceneSpecifier
from starling.sim.sensor import presets

SMALL: dict[str, Any] = {
    "seed": 7,
    "scenes": 40,
    "views": 3,
    "frames": 2,
    "layers": ["truth", "infrared"],
    "source": [
        {"kind": "builtin", "scene": "clutter", "number": {"low": 0, "high": 999, "whole": True}},
        {"kind": "builtin", "scene": "wall", "number": {"low": 0.5, "high": 3}, "weight": 0.5},
    ],
    "sensor": [
        {
            "preset": "d435",
            "set": {"projector.power_w": {"low": 0.05, "high": 0.3, "log": True}},
            "effects": {"lens_blur": {"of": [0.2, 0.4]}, "motion.y": 0.01},
        },
        {"preset": "d415"},
    ],
    "pose": {"shift_m": [{"low": -0.1, "high": 0.1}, 0, 0]},
}


def plan(**others: Any) -> plans.Plan:
    return plans.from_table({**SMALL, **others}, Path("."))


@given(st.floats(-5, 5), st.floats(0, 5), st.booleans(), st.integers(0, 2**32))
def test_drawn_values_lie_within_the_range(low: float, width: float, whole: bool, seed: int):
    low, high = (np.floor(low), np.ceil(low + width)) if whole else (low, low + width)
    first = draw.read({"low": float(low), "high": float(high), "whole": whole}, "x")
    value = first.drawn(np.random.default_rng(seed))
    assert low <= value <= high and (type(value) is int or not whole)


def test_logarithmic_ranges_are_uniform_in_the_logarithm():
    first = draw.read({"low": 0.01, "high": 100.0, "log": True}, "x")
    rng = np.random.default_rng(0)
    drawn = np.log10([first.drawn(rng) for _ in range(4000)])
    assert drawn.min() >= -2 and drawn.max() <= 2
    np.testing.assert_allclose(np.histogram(drawn, 4)[0] / 4000, 0.25, atol=0.03)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"low": 2, "high": 1}, "x.high must be >= x.low = 2; got 1"),
        ({"low": 1}, "x.high must be given"),
        ({"low": 1, "hihg": 2}, "key in x must be a known name; got 'hihg'. Known: high"),
        ({"low": float("nan"), "high": 1}, "x.low must be in"),
        ({"low": 0, "high": 1, "log": True}, "x.low must be > 0"),
        ({"low": 1, "high": 2, "log": True, "whole": True}, "no range of whole numbers"),
        ({"low": 0.5, "high": 1, "whole": True}, "x must have whole ends"),
        ({"low": 0, "high": 1, "log": "yes"}, "x.log must be true or false"),
        ({"of": []}, "x.of must list"),
        ({"of": [1], "low": 2}, "x must have no key other than of"),
    ],
)
def test_empty_ranges_and_choices_are_refused(value: Any, message: str):
    with pytest.raises(InputError, match=message):
        draw.read(value, "x")


def test_a_plan_is_read_from_its_file(tmp_path: Path):
    path = tmp_path / "plan.toml"
    path.write_text(tomli_w.dumps(SMALL))
    result = plans.read(path)
    assert result == plan() and result.count == 240
    assert result.layers == ("infrared", "truth") and result.missing == "stop"


@pytest.mark.parametrize(
    ("others", "message"),
    [
        ({"sceens": 3}, "key in plan must be a known name; got 'sceens'. Known: scenes"),
        ({"scenes": None}, "scenes must be given"),
        ({"scenes": 0}, r"scenes must be in \[1"),
        ({"scenes": 1.5}, "scenes must be a whole number"),
        ({"layers": []}, "layers must list"),
        ({"layers": ["thruth"]}, "layer must be a known name; got 'thruth'. Known: truth"),
        ({"missing": "ignore"}, "missing must be a known name"),
        ({"source": []}, "source must be one table or more"),
        ({"source": [{"kind": "bultin"}]}, "source 1.kind must be a known name"),
        ({"source": [{"kind": "builtin"}]}, "source 1.scene must be a text"),
        ({"source": [{"kind": "builtin", "scene": "cluter"}]}, "scene must be a known name"),
        (
            {"source": [{"kind": "builtin", "scene": "wall", "number": {"low": 0, "high": 1}}]},
            "wall's distance in metres must be in",
        ),
        (
            {"source": [{"kind": "builtin", "scene": "clutter", "number": {"low": 0, "high": 1}}]},
            "source 1.number must be whole",
        ),
        ({"source": [{"kind": "files", "paths": []}]}, "source 1.paths must list files"),
        ({"source": [{"kind": "files", "paths": ["a.step"]}]}, "must be of .ply"),
        ({"source": [{"kind": "files", "paths": ["a.ply"]}]}, "must be files that exist"),
        ({"source": [{"kind": "captures", "folder": "none"}]}, "captures must be a folder"),
        ({"source": [{"kind": "dropped", "folder": "none"}]}, "source 1.folder must hold meshes"),
        ({"sensor": [{"preset": "d436"}]}, "Known: d456, d435"),
        ({"sensor": [{"preset": "d435", "mode": "1x1"}]}, "mode must be a mode of d435; got '1x1'"),
        ({"sensor": [{"preset": "d435", "mode": 640}]}, "sensor 1.mode must be a text; got 640"),
        ({"sensor": [{"preset": "d435", "weight": 0}]}, "sensor 1.weight must be > 0"),
        ({"sensor": [{"preset": "d435", "set": 3}]}, "sensor 1.set must be a table"),
        ({"sensor": [{"preset": "d435", "set": {"projector.pwoer_w": 1}}]}, "pwoer_w"),
        (
            {"sensor": [{"preset": "d435", "set": {"projector.power_w": {"low": -1, "high": 1}}}]},
            "projector.power_w must be",
        ),
        ({"sensor": [{"preset": "d435", "effects": {"lens_blurr": 1}}]}, "Known: lens_blur"),
        ({"pose": 3}, "pose must be a table"),
        ({"pose": {"shift_m": [0, 0]}}, "pose.shift_m must be a list of 3"),
        ({"pose": {"turn_deg": [0, 0, "x"]}}, "pose.turn_deg.z must be in"),
    ],
)
def test_invalid_plans_are_refused_in_one_line(others: dict[str, Any], message: str):
    table = {key: value for key, value in {**SMALL, **others}.items() if value is not None}
    with pytest.raises(InputError, match=message) as refused:
        plans.from_table(table, Path("."))
    assert "\n" not in str(refused.value)


def test_view_depends_on_plan_and_number_only():
    item, changed = plan(), plan(scenes=1000)
    for number in (0, 5, 119):
        first, second = view(item, number), view(changed, number)
        np.testing.assert_array_equal(first.own_from_left, second.own_from_left)
        assert first.setting == second.setting and first.seed == second.seed
        assert (first.fields, first.effects) == (second.fields, second.effects)
    assert view(plan(seed=8), 0).seed != view(item, 0).seed


def test_a_sensor_is_in_its_mode_before_values_are_drawn():
    entry = {"preset": "d435", "mode": "424x240@60", "set": {"left.lens.blur_px": 0.7}}
    planned = view(plan(sensor=[entry]), 3)
    camera = render_view.camera(planned)
    assert camera.left.lens.blur_px == 0.7
    assert camera.right == presets.load("d435", mode="424x240@60").right
    assert (camera.width, camera.height) == (424, 240)
    assert view(plan(), 3).mode == ""


def test_additional_value_changes_no_other_value():
    sensors = [{**SMALL["sensor"][0], "effects": {"veil": {"low": 0, "high": 0.1}}}]
    first, second = view(plan(sensor=SMALL["sensor"][:1]), 3), view(plan(sensor=sensors), 3)
    assert first.fields == second.fields and first.seed == second.seed
    assert first.effects.keys() == {"lens_blur", "motion.y"} and second.effects.keys() == {"veil"}


@pytest.mark.slow
def test_views_of_one_scene_share_it_and_nothing_else():
    views = [view(plan(), number) for number in range(120)]
    for scene in range(40):
        expected = views[3 * scene : 3 * scene + 3]
        assert (
            len({item.setting for item in expected}) == len({item.room for item in expected}) == 1
        )
        assert len({item.seed for item in expected}) == 3
    words = [item.setting.text for item in views[::3] if isinstance(item.setting, SceneSpecifier)]
    walls = sum(word.startswith("wall") for word in words)
    assert len(words) == 40 and 5 <= walls <= 22  # A third of them, by weight.
    assert len({item.name for item in views}) == 120
    assert {item.preset for item in views} == {"d435", "d415"}


def test_meshes_of_a_folder_are_dropped_at_random(tmp_path: Path):
    for name in ("a.ply", "deep/b.glb", "c.stl"):
        (tmp_path / "things" / name).parent.mkdir(exist_ok=True, parents=True)
        trimesh.creation.box((1, 1, 1)).export(tmp_path / "things" / name)
    source = {
        "kind": "dropped",
        "folder": "things",
        "count": {"low": 2, "high": 6, "whole": True},
        "reflectance": {"low": 0.1, "high": 0.9},
    }
    result = plans.from_table({**SMALL, "source": [source]}, tmp_path)
    heaps = [view(result, number).setting for number in range(0, 120, 3)]
    assert all(isinstance(pile, Pile) and 2 <= len(pile.paths) <= 6 for pile in heaps)
    names = {path.name for pile in heaps if isinstance(pile, Pile) for path in pile.paths}
    assert names == {"a.ply", "b.glb"}
    for others, message in (
        ({"count": 0}, r"source 1.count must be in \[1"),
        ({"count": 1.5}, "source 1.count must be whole"),
        ({"count": {"low": 1, "high": 3}}, "source 1.count must be whole"),
        ({"reflectance": 1.5}, r"source 1.reflectance must be in \[0, 1\]"),
    ):
        with pytest.raises(InputError, match=message):
            plans.from_table({**SMALL, "source": [{**source, **others}]}, tmp_path)


def test_files_and_captures_are_drawn_too(tmp_path: Path, small_set: Path):
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "a.ply")
    files = {"kind": "files", "paths": ["a.ply"]}
    captured = {"kind": "captures", "folder": str(small_set)}
    result = plans.from_table({**SMALL, "source": [files, captured]}, tmp_path)
    words = {view(result, number).setting for number in range(0, 120, 3)}
    known = {
        specifier.room: specifier.known
        for specifier in words
        if isinstance(specifier, SceneSpecifier)
    }
    assert known.pop("a") is True and known and not any(known.values())
    assert dataclasses.is_dataclass(result)


def test_sets_of_too_many_frames_are_refused(tmp_path: Path):
    plan = {**SMALL, "scenes": 10**5, "views": 10**3, "frames": 2}
    with pytest.raises(
        InputError, match=r"scenes x views x frames must be in \[1, 1e\+08\]; got 2"
    ):
        plans.from_table(plan, tmp_path)
