"""Scenes of a plan, loaded and set up once for the views that follow each other."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from sim import scenes, sensors
from sim.generation import dropped
from sim.generation.dropped import Lying
from sim.generation.source import Heap
from sim.generation.view import View
from sim.stage import Stage

_KEPT = 2  # The views of one scene may have two presets.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Set:
    """A scene in Mitsuba, and where what was dropped into it lies."""

    stage: Stage
    lying: tuple[Lying, ...] = ()


class Stages:
    """The scenes that were needed last."""

    def __init__(self) -> None:
        """Begin with none."""
        self._kept: OrderedDict[tuple[int, str], Set] = OrderedDict()

    def of(self, view: View) -> Set:
        """A view's scene, as its preset would see it.

        Raises:
            InputError: if a file is missing or damaged.
        """
        key = (view.scene, view.preset)
        if key not in self._kept:
            self._kept[key] = _set(view)
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]


def _set(view: View) -> Set:
    sensor = sensors.load(view.preset)
    if isinstance(view.setting, Heap):
        scene, lying = dropped.scene(view.setting, sensor)
        return Set(stage=Stage(scene), lying=lying)
    return Set(stage=Stage(scenes.load(view.setting.text, sensor)))
