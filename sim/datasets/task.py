"""Some consecutive views of a plan: what one worker makes at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.patterns.errors import InputError
from starling.sim.captures.info import CaptureInfo
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.render_view import Row, Taken, take


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """Views of a shard."""

    number: int
    views: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Made:
    """What a worker made of a task."""

    number: int
    views: tuple[Taken, ...]
    skipped: tuple[dict[str, Any], ...] = ()  # Views whose scene was not to be had, and why.

    @property
    def rows(self) -> list[Row]:
        """Of the index, of all frames."""
        return [row for one in self.views for row in one.rows]


def tasks(plan: Plan, frames: int) -> list[Task]:
    """Part a plan's views, in order, into tasks of so many frames, of one view at least."""
    size = max(1, frames // plan.frames)
    count = plan.scenes * plan.views
    return [
        Task(number=number, views=tuple(range(begin, min(begin + size, count))))
        for number, begin in enumerate(range(0, count, size))
    ]


def make(plan: Plan, info: CaptureInfo, out: Path, task: Task) -> Made:
    """Take a task's views (arguments as `taken.take`).

    Raises:
        InputError: as `taken.take`, if the plan stops at what is missing.
    """
    views: list[Taken] = []
    skipped: list[dict[str, Any]] = []
    for number in task.views:
        try:
            views.append(take(plan, number, info, out))
        except InputError as error:
            if plan.missing == "stop":
                raise
            skipped.append({"view": number, "why": str(error)})
    return Made(number=task.number, views=tuple(views), skipped=tuple(skipped))
