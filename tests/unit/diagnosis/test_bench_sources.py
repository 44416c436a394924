"""What is kept of simulated scenes is made again where any of its code is another."""

from __future__ import annotations

import ast
from pathlib import Path

from starling.diagnosis.which import table

ROOT = Path(table.__file__).parents[2]


def read_by(module: str) -> set[str]:
    """Modules of `diagnosis` that one imports, itself and theirs with it."""
    found: set[str] = set()
    todo = [module]
    while todo:
        name = todo.pop()
        path = ROOT.joinpath(*name.split(".")[1:]).with_suffix(".py")
        if name in found or not path.is_file():
            continue
        found.add(name)
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                many = (f"{node.module}.{alias.name}" for alias in node.names)
                todo += [
                    one for one in (node.module, *many) if one.startswith("starling.diagnosis.")
                ]
    return found


def test_all_that_readings_and_features_are_made_by_is_in_the_name():
    named = {str(path.relative_to(ROOT)) for path in table._SOURCES}
    for module in read_by("starling.diagnosis.scenes.scene_model") | read_by(
        "starling.diagnosis.features.observation"
    ):
        path = Path(*module.split(".")[1:]).with_suffix(".py")
        assert any(str(one) in named for one in (path, *path.parents)), module
