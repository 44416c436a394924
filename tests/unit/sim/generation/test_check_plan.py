"""A plan that would stop midway is refused before its first frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import tomli_w
import trimesh

from starling.patterns.errors import InputError
from starling.sim.datasets import check_plan
from starling.sim.datasets import plan as plans
from starling.sim.datasets.generate import generate
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes

WALL = {"kind": "builtin", "scene": "wall", "number": 1.0}
PLAN: dict[str, Any] = {"seed": 1, "scenes": 3, "source": [WALL], "sensor": [{"preset": "d435"}]}


@pytest.mark.parametrize("name", ["wall", "staircase"])
def test_both_ends_of_a_builtin_range_can_be_built(name: str) -> None:
    for number in (0.05, 50.0):
        scenes.refuse_number(name, number)
        assert MitsubaScene(scenes.named(name, str(number))).shapes


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ({"effects": {"nir_reflectance": {"low": 1, "high": 1000}}}, "effect nir_reflectance: fin"),
        ({"effects": {"temporal_filter": 0.4}}, "post.temporal_alpha must be 1 for a single frame"),
        ({"set": {"left.bit_depth": {"of": [8, 10]}}}, "bit_depth and dropped_bits of right must"),
    ],
)
def test_ends_of_sensor_and_scene_effects_are_tried(sensor: Any, message: str) -> None:
    table = {**PLAN, "sensor": [{"preset": "d435", **sensor}]}
    with pytest.raises(InputError, match=message):
        check_plan.refuse_failing(plans.from_table(table, Path(".")))


def mesh(path: Path, wide_m: float) -> str:
    path.parent.mkdir(exist_ok=True)
    trimesh.creation.box((wide_m, wide_m, wide_m)).export(path)
    return str(path)


def test_meshes_are_loaded_once_at_the_start(tmp_path: Path) -> None:
    def source(name: str) -> Any:
        return {"source": [WALL, {"kind": "files", "paths": [name], "weight": 1e-9}]}

    (tmp_path / "broken.ply").write_bytes(b"ply\n")
    large = mesh(tmp_path / "large.ply", 300.0)
    for name, message in (
        ("broken.ply", "source 2: scene must be a mesh"),
        (large, "source 2: mesh must be at most 100 m wide; got 300 m"),
    ):
        plan = {**PLAN, **source(str(tmp_path / name))}
        with pytest.raises(InputError, match=message):
            check_plan.refuse_failing(plans.from_table(plan, tmp_path))
        check_plan.refuse_failing(plans.from_table({**plan, "missing": "skip"}, tmp_path))
    (tmp_path / "plan.toml").write_text(tomli_w.dumps({**PLAN, **source(large)}))
    with pytest.raises(InputError, match="mesh must be at most 100 m wide"):
        generate(tmp_path / "plan.toml", tmp_path / "set", workers=1)
    assert not (tmp_path / "set").exists()


def test_mitsuba_files_are_loaded_at_the_start(tmp_path: Path) -> None:
    path = tmp_path / "room.xml"
    source = {"kind": "files", "paths": [path.name]}
    plan = {**PLAN, "source": [WALL, source]}
    for content, message in (
        ("<scene", "source 2: scene must be"),
        ('<scene version="3.0.0"></scene>', "source 2: scene must hold shapes"),
    ):
        path.write_text(content)
        with pytest.raises(InputError, match=message):
            check_plan.refuse_failing(plans.from_table(plan, tmp_path))
    path.write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    check_plan.refuse_failing(plans.from_table(plan, tmp_path))


def test_a_pile_without_room_is_refused(tmp_path: Path) -> None:
    mesh(tmp_path / "things" / "box.ply", 0.4)
    source = {"kind": "dropped", "folder": "things", "count": 9}
    with pytest.raises(InputError, match=r"view 0 of the plan: meshes must have room on a table"):
        check_plan.refuse_failing(plans.from_table({**PLAN, "source": [source]}, tmp_path))


def test_captures_without_reference_are_refused(small_set: Path) -> None:
    (small_set / "a" / "truth.png").unlink()
    source = {"kind": "captures", "folder": str(small_set)}
    with pytest.raises(InputError, match=r"source 1: captures must have truth.png and ir_left.png"):
        check_plan.refuse_failing(plans.from_table({**PLAN, "source": [source]}, Path(".")))
