"""Conversion of dataclass trees to tables and back, with unions by `kind`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest
import tomli_w

from starling.patterns.errors import InputError
from starling.sim.sensor import structure


@dataclass(frozen=True, kw_only=True)
class Round:
    radius_m: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Square:
    side_m: float
    turned: bool = False


@dataclass(frozen=True, kw_only=True)
class Tree:
    shape: Round | Square
    round: Round = field(default_factory=Round)
    label: str | None = None
    mode: Literal["a", "b"] = "a"
    place_m: tuple[float, float] = (0.0, 0.0)
    count: int = 0
    bits: Literal[8, 10] = 8
    branches: tuple[Round, ...] = ()


TREE = Tree(
    shape=Square(side_m=2.0), label="x", place_m=(1.0, 2.0), branches=(Round(), Round(radius_m=2))
)


def test_round_trip_through_toml() -> None:
    for tree in (TREE, Tree(shape=Round())):
        table = tomllib.loads(tomli_w.dumps(structure.to_table(tree)))
        assert structure.from_table(Tree, table) == tree
    assert structure.to_table(TREE)["shape"] == {"kind": "Square", "side_m": 2.0, "turned": False}
    assert "label" not in structure.to_table(Tree(shape=Round()))


def test_whole_numbers_are_accepted_as_floats() -> None:
    tree = structure.from_table(Tree, {"shape": {"kind": "Square", "side_m": 2}, "bits": 10})
    assert isinstance(tree.shape, Square) and type(tree.shape.side_m) is float


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "shape must be given; got nothing"),
        ({"shape": 3}, "shape must be a table; got 3"),
        ({"shape": {}}, r"shape.kind must be a known name; got None. Known:"),
        ({"shape": {"kind": "Sqare"}}, r"got 'Sqare'. Known: Square, Round"),
        ({"shape": {"kind": ["Square"]}}, r"shape.kind must be a known name"),
        ({"shape": {"kind": "Square"}}, r"shape.side_m must be given"),
        ({"shape": {"kind": "Round", "radus_m": 1}}, r"key in shape must be .*Known: radius_m"),
        ({"round": []}, "round must be a table"),
        ({"mode": "c"}, "mode must be a known name; got 'c'"),
        ({"mode": ["a"]}, "mode must be a known name"),
        ({"bits": 9}, r"bits must be one of 8, 10; got 9. Choose one of them."),
        ({"bits": "8"}, r"bits must be one of 8, 10; got '8'"),
        ({"place_m": 3}, "place_m must be a list of 2"),
        ({"place_m": [1, "2"]}, "place_m must be of type float; got '2'"),
        ({"branches": 3}, r"branches must be a list; got 3. Give \[\] for none."),
        ({"branches": [{}, 3]}, r"branches.1 must be a table; got 3"),
        ({"branches": [{"radus_m": 1}]}, r"key in branches.0 must be .*Known: radius_m"),
        ({"count": True}, "count must be of type int; got True"),
        ({"count": 1.5}, "count must be of type int; got 1.5"),
        ({"label": 3}, "label must be of type str; got 3"),
        ({"round": {"radius_m": 10**400}}, r"round.radius_m must fit in 64 bits; got a"),
        ({"count": -(10**400)}, "count must fit in 64 bits; got a whole number of 1330 bits"),
        ({"place_m": [[1 << 20_000]]}, "place_m must fit in 64 bits"),
        ({"label": {"x": 1 << 20_000}}, r"label.x must fit in 64 bits"),
        ({3: 3}, "key must be a known name; got 3"),
        ({"other": 1}, "key must be a known name; got 'other'"),
    ],
)
def test_wrong_tables_are_refused(table: dict[Any, Any], message: str) -> None:
    whole = {"shape": {"kind": "Round"}, **table} if table else table
    with pytest.raises(InputError, match=message):
        structure.from_table(Tree, whole)


def test_a_value_that_is_not_a_table_is_refused() -> None:
    with pytest.raises(InputError, match="Tree must be a table; got 3"):
        structure.from_table(Tree, 3)  # type: ignore[arg-type]


def test_edits() -> None:
    assert structure.edit(TREE, "shape.side_m", 3).shape == Square(side_m=3.0)
    assert structure.edit(TREE, "shape", {"kind": "Round"}).shape == Round()
    assert structure.edit(TREE, "label", "y").label == "y"
    assert structure.edit(TREE, "branches", [{}]).branches == (Round(),)
    assert structure.edit(TREE, "place_m", [3, 4]).place_m == (3.0, 4.0)
    with pytest.raises(InputError, match=r"field in shape must be a known name; got 'radius_m'"):
        structure.edit(TREE, "shape.radius_m", 3)
    with pytest.raises(InputError, match="label has no fields"):
        structure.edit(TREE, "label.x", 3)
    with pytest.raises(InputError, match="field must be a known name; got ''"):
        structure.edit(TREE, "", 3)
