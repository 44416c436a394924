"""Type aliases of the arrays that images are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]  # (h, w) or (h, w, n).
Mask = NDArray[np.bool_]  # (h, w), True where a statement holds.
Labels = NDArray[np.uint32]  # (h, w) codes or object numbers.
