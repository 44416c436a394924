"""Checks of a plan before its first frame: what would stop the run later is refused at once."""

from __future__ import annotations

from starling.patterns import errors
from starling.sim.datasets import mesh_pile, render_view
from starling.sim.datasets.plan import Plan, view
from starling.sim.datasets.source import Captured, Dropped, Pile, SceneFiles
from starling.sim.scene import mitsuba_xml, sources
from starling.sim.simulate import refuse_impossible

_VIEWS = 64  # Views whose drawn values are tried; `plan.read` tries the ends of every range.


def refuse_failing(plan: Plan) -> None:
    """Load every mesh and Mitsuba XML of a plan once, and draw its first views.

    Scenes of files and piles are not checked if the plan says `missing = "skip"`.

    Raises:
        InputError: if a mesh is damaged or not in metres, a Mitsuba XML cannot be loaded, or a
            captured scene lacks depth or image.
            Also if a pile has no room on its table, or drawn values are invalid together.
    """
    if plan.missing == "stop":
        for number, source in enumerate(plan.sources, 1):
            with errors.naming(f"source {number}"):
                _refuse_files(source)
    for number in range(min(plan.scenes * plan.views, _VIEWS)):
        planned = view(plan, number)
        with errors.naming(f"view {number} of the plan"):
            refuse_impossible(render_view.camera(planned), plan.frames)
            if isinstance(planned.setting, Pile) and plan.missing == "stop":
                mesh_pile.refuse_crowded(planned.setting)


def _refuse_files(source: object) -> None:
    if isinstance(source, (SceneFiles, Dropped)):
        for path in source.paths:
            if path.suffix.lower() in sources.MESH_SUFFIXES:
                sources.refuse_mesh(path)
            else:
                mitsuba_xml.load(path)
    if isinstance(source, Captured):
        for path in source.paths:
            if not (path / "truth.png").is_file() or not any(path.glob("*/ir_left.png")):
                rule = "must have truth.png and ir_left.png"
                raise errors.refuse("captures", rule, path, "Leave the scene out.")
