"""The judge's network: cells to a score of each window."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from starling.learning.judge.cells import CELL_PX

WINDOW_PX = 96  # Side of a judged window; its context has twice this side.
WINDOW = WINDOW_PX // CELL_PX  # The same in cells.
_LEAST = 1e-3  # Share of shown cells below which a mean is taken as 0.
_DROPOUT = 0.3
_COARSE = 4  # Side of the coarsest cells, in cells.


class WindowJudge(nn.Module):
    """Scores windows by learned features of cells of 8, 16 and 32 px, and by their statistics.

    Features are averaged over a window and over its context. A score above 0 means real.
    """

    mean: Tensor  # (c, 1, 1) of the statistics over the training cells.
    scale: Tensor  # Inverse of their standard deviation.

    def __init__(self, channels: int, *, width: int = 32) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels, 1, 1))
        self.register_buffer("scale", torch.ones(channels, 1, 1))
        self.mixed = nn.Conv2d(channels, width, 1)
        self.middle = nn.Conv2d(width, width, 3, padding=1)
        self.coarse = nn.Conv2d(width, width, 3, padding=1)
        features = 2 * (channels + 3 * width)
        self.normal = nn.BatchNorm1d(features)
        self.head = nn.Sequential(
            nn.Dropout(_DROPOUT),
            nn.Linear(features, width),
            nn.ReLU(),
            nn.Dropout(_DROPOUT),
            nn.Linear(width, 1),
        )

    def forward(self, cells: Tensor, shown: Tensor) -> Tensor:
        """Score the windows of a grid that starts at the first cell.

        Args:
            cells: (b, c, rows, columns) shares; both sides are multiples of 12 cells.
            shown: (b, 1, rows, columns), 1 where cells count, else 0.

        Returns:
            (b, rows // 12, columns // 12).
        """
        fine = functional.relu(self.mixed((cells - self.mean) * self.scale)) * shown
        middle = functional.relu(self.middle(functional.avg_pool2d(fine, 2)))
        coarse = functional.relu(self.coarse(functional.avg_pool2d(middle, 2)))
        # Square roots even out the variances of shares (Hellinger).
        parts = [part.sqrt() for part in _windows(cells, shown)]
        for factor, layer in ((1, fine), (2, middle), (_COARSE, coarse)):
            parts += _windows(layer, functional.avg_pool2d(shown, factor), factor)
        features = torch.cat(parts, 1).movedim(1, -1)
        return self.head(self.normal(features.flatten(0, 2))).view(features.shape[:3])


def _windows(layer: Tensor, shown: Tensor, factor: int = 1) -> list[Tensor]:
    """Return means of a layer over shown cells of windows and of their contexts."""
    side = WINDOW // factor
    means = []
    for kernel, padding in ((side, 0), (2 * side, (side + 1) // 2)):
        # Sums of whole windows only; a context is cut at the border by zero weights.
        rows, columns = (length // side for length in layer.shape[-2:])
        pooled = [
            functional.avg_pool2d(image, kernel, side, padding)[..., :rows, :columns]
            for image in (layer * shown, shown)
        ]
        means.append(pooled[0] / pooled[1].clamp(min=_LEAST))
    return means
