"""Plans: what they say, what they refuse, and what is drawn of them."""

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
from starling.sim.datasets import draw
from starling.sim.datasets import plan as plans
from starling.sim.datasets.source import Heap, Word
from starling.sim.datasets.view import view

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
def test_what_is_drawn_lies_between_its_ends(low: float, width: float, whole: bool, seed: int):
    low, high = (np.floor(low), np.ceil(low + width)) if whole else (low, low + width)
    one = draw.read({"low": float(low), "high": float(high), "whole": whole}, "x")
    value = one.drawn(np.random.default_rng(seed))
    assert low <= value <= high and (type(value) is int or not whole)


def test_logarithmic_ranges_are_even_in_the_logarithm():
    one = draw.read({"low": 0.01, "high": 100.0, "log": True}, "x")
    rng = np.random.default_rng(0)
    drawn = np.log10([one.drawn(rng) for _ in range(4000)])
    assert drawn.min() >= -2 and drawn.max() <= 2
    np.testing.assert_allclose(np.histogram(drawn, 4)[0] / 4000, 0.25, atol=0.03)


@pytest.mark.parametrize(
    ("value", "said"),
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
        ({"of": [1], "low": 2}, "x must have no other key beside of"),
    ],
)
def test_what_holds_nothing_is_refused(value: Any, said: str):
    with pytest.raises(InputError, match=said):
        draw.read(value, "x")


def test_a_plan_is_read_from_its_file(tmp_path: Path):
    path = tmp_path / "plan.toml"
    path.write_text(tomli_w.dumps(SMALL))
    found = plans.read(path)
    assert found == plan() and found.count == 240
    assert found.layers == ("infrared", "truth") and found.missing == "stop"


@pytest.mark.parametrize(
    ("others", "said"),
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
        ({"source": [{"kind": "files", "paths": ["a.stl"]}]}, "must be of .ply"),
        ({"source": [{"kind": "files", "paths": ["a.ply"]}]}, "must be files that exist"),
        ({"source": [{"kind": "captures", "folder": "none"}]}, "captures must be a folder"),
        ({"source": [{"kind": "dropped", "folder": "none"}]}, "source 1.folder must hold meshes"),
        ({"sensor": [{"preset": "d436"}]}, "Known: d435"),
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
def test_what_cannot_be_is_refused_in_one_line(others: dict[str, Any], said: str):
    table = {key: value for key, value in {**SMALL, **others}.items() if value is not None}
    with pytest.raises(InputError, match=said) as refused:
        plans.from_table(table, Path("."))
    assert "\n" not in str(refused.value)


def test_a_view_follows_from_plan_and_number_alone():
    one, other = plan(), plan(scenes=1000)
    for number in (0, 5, 119):
        first, second = view(one, number), view(other, number)
        np.testing.assert_array_equal(first.own_from_left, second.own_from_left)
        assert first.setting == second.setting and first.seed == second.seed
        assert (first.fields, first.effects) == (second.fields, second.effects)
    assert view(plan(seed=8), 0).seed != view(one, 0).seed


def test_one_more_value_moves_no_other():
    sensors = [{**SMALL["sensor"][0], "effects": {"veil": {"low": 0, "high": 0.1}}}]
    one, other = view(plan(sensor=SMALL["sensor"][:1]), 3), view(plan(sensor=sensors), 3)
    assert one.fields == other.fields and one.seed == other.seed
    assert one.effects.keys() == {"lens_blur", "motion.y"} and other.effects.keys() == {"veil"}


def test_views_of_one_scene_share_it_and_nothing_else():
    views = [view(plan(), number) for number in range(120)]
    for scene in range(40):
        own = views[3 * scene : 3 * scene + 3]
        assert len({one.setting for one in own}) == len({one.room for one in own}) == 1
        assert len({one.seed for one in own}) == 3
    words = [one.setting.text for one in views[::3] if isinstance(one.setting, Word)]
    walls = sum(word.startswith("wall") for word in words)
    assert len(words) == 40 and 5 <= walls <= 22  # A third of them, by weight.
    assert len({one.name for one in views}) == 120
    assert {one.preset for one in views} == {"d435", "d415"}


def test_meshes_of_a_folder_are_dropped_by_lot(tmp_path: Path):
    for name in ("a.ply", "deep/b.glb", "c.stl"):
        (tmp_path / "things" / name).parent.mkdir(exist_ok=True, parents=True)
        trimesh.creation.box((1, 1, 1)).export(tmp_path / "things" / name)
    source = {
        "kind": "dropped",
        "folder": "things",
        "count": {"low": 2, "high": 6, "whole": True},
        "reflectance": {"low": 0.1, "high": 0.9},
    }
    found = plans.from_table({**SMALL, "source": [source]}, tmp_path)
    heaps = [view(found, number).setting for number in range(0, 120, 3)]
    assert all(isinstance(one, Heap) and 2 <= len(one.paths) <= 6 for one in heaps)
    names = {path.name for one in heaps if isinstance(one, Heap) for path in one.paths}
    assert names == {"a.ply", "b.glb"}
    for others, said in (
        ({"count": 0}, r"source 1.count must be in \[1"),
        ({"count": 1.5}, "source 1.count must be whole"),
        ({"count": {"low": 1, "high": 3}}, "source 1.count must be whole"),
        ({"reflectance": 1.5}, r"source 1.reflectance must be in \[0, 1\]"),
    ):
        with pytest.raises(InputError, match=said):
            plans.from_table({**SMALL, "source": [{**source, **others}]}, tmp_path)


def test_files_and_captures_are_drawn_too(tmp_path: Path, small_set: Path):
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "a.ply")
    files = {"kind": "files", "paths": ["a.ply"]}
    captured = {"kind": "captures", "folder": str(small_set)}
    found = plans.from_table({**SMALL, "source": [files, captured]}, tmp_path)
    words = {view(found, number).setting for number in range(0, 120, 3)}
    known = {one.room: one.known for one in words if isinstance(one, Word)}
    assert known.pop("a") is True and known and not any(known.values())
    assert dataclasses.is_dataclass(found)
