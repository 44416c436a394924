"""Cache of semi-global searches, so that checks and refinement can be varied cheaply."""

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
    """Stores the first `most` searches; later searches are computed but not stored."""

    most: int  # Capacity in searches, about 20 bytes per pixel each.
    _stored: dict[_Key, Winners] = field(default_factory=dict, repr=False)

    def winners(
        self,
        left: NDArray,
        right: NDArray,
        matcher: Matcher,
        engine: CensusSemiGlobal,
        search: Callable[[], Winners],
    ) -> Winners:
        """Return the stored winners of a search, or run it.

        Args:
            left, right: (h, w) the pair.
            matcher: supplies the search range.
            engine: the matcher's engine. Its thresholds on winners do not affect the key.
            search: runs the search.
        """
        pair = hashlib.blake2b(np.ascontiguousarray(left).tobytes())
        pair.update(np.ascontiguousarray(right).tobytes())
        search_settings = replace(engine, second_peak=0.0, neighbour_peak=0.0)
        key = (
            f"{left.shape} {left.dtype} {pair.hexdigest()}",
            search_settings,
            matcher.min_disparity_px,
            matcher.search_px,
        )
        if key in self._stored:
            return self._stored[key]
        computed = search()
        if len(self._stored) < self.most:
            self._stored[key] = computed
        return computed
