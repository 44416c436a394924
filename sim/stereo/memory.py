"""Winners of searches that were made before: checks and refinement are tried on them again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.matcher import CensusSemiGlobal, Matcher
from starling.sim.stereo.semiglobal import Winners

_Key = tuple[str, CensusSemiGlobal, int, int]


@dataclass(slots=True)
class Memory:
    """Keeps the first searches that it is asked for; later ones are made and forgotten."""

    most: int  # Searches that are kept, of some 20 bytes a pixel each.
    _kept: dict[_Key, Winners] = field(default_factory=dict, repr=False)

    def winners(
        self,
        left: NDArray,
        right: NDArray,
        matcher: Matcher,
        engine: CensusSemiGlobal,
        search: Callable[[], Winners],
    ) -> Winners:
        """Recall a search, or make it.

        Args:
            left, right: (h, w) the pair.
            matcher: whose range is searched.
            engine: its own; what it asks of winners afterwards is left aside.
            search: makes it.
        """
        pair = hashlib.blake2b(np.ascontiguousarray(left).tobytes())
        pair.update(np.ascontiguousarray(right).tobytes())
        asked = replace(engine, second_peak=0.0, neighbour_peak=0.0)
        key = (
            f"{left.shape} {left.dtype} {pair.hexdigest()}",
            asked,
            matcher.min_disparity_px,
            matcher.search_px,
        )
        if key in self._kept:
            return self._kept[key]
        found = search()
        if len(self._kept) < self.most:
            self._kept[key] = found
        return found
