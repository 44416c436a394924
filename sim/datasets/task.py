"""Tasks of a worker: consecutive views of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.patterns.errors import InputError
from starling.sim.captures.info import CaptureInfo
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.render_view import RenderedView, Row, render


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """The views of one shard."""

    number: int
    views: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskResult:
    """Views that a worker rendered for a task."""

    number: int
    views: tuple[RenderedView, ...]
    skipped: tuple[dict[str, Any], ...] = ()  # Views whose scene is missing, with the reason.

    @property
    def rows(self) -> list[Row]:
        """Rows of the index for all frames."""
        return [row for view in self.views for row in view.rows]


def tasks(plan: Plan, frames: int) -> list[Task]:
    """Split a plan's views, in order, into tasks of `frames` frames, at least one view each."""
    size = max(1, frames // plan.frames)
    count = plan.scenes * plan.views
    return [
        Task(number=number, views=tuple(range(begin, min(begin + size, count))))
        for number, begin in enumerate(range(0, count, size))
    ]


def make(plan: Plan, info: CaptureInfo, out: Path, task: Task) -> TaskResult:
    """Render a task's views (arguments as in `render_view.render`).

    Raises:
        InputError: as `render_view.render`, if the plan says `missing = "stop"`.
    """
    views: list[RenderedView] = []
    skipped: list[dict[str, Any]] = []
    for number in task.views:
        try:
            views.append(render(plan, number, info, out))
        except InputError as error:
            if plan.missing == "stop":
                raise
            skipped.append({"view": number, "why": str(error)})
    return TaskResult(number=task.number, views=tuple(views), skipped=tuple(skipped))
