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


class WindowJudge(nn.Module):
    """Scores windows by learned features of cells of 16 and 32 px, and by their statistics.

    Features are averaged over a window and over its context. A score above 0 means real.
    """

    mean: Tensor  # (c, 1, 1) of the statistics over the training cells.
    scale: Tensor  # Inverse of their standard deviation.

    def __init__(self, channels: int, *, width: int = 32) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels, 1, 1))
        self.register_buffer("scale", torch.ones(channels, 1, 1))
        self.mixed = nn.Conv2d(channels, width, 1)
        self.fine = nn.Conv2d(width, width, 3, padding=1)
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
            cells: (b, c, rows, columns) shares, 0 where cells do not count; both sides are
                multiples of 6 cells.
            shown: (b, 1, rows, columns), 1 where cells count, else 0.

        Returns:
            (b, rows // 6, columns // 6).
        """
        mixed = functional.relu(self.mixed((cells - self.mean) * self.scale)) * shown
        fine = functional.relu(self.fine(mixed)) * shown
        halved = functional.avg_pool2d(shown, 2)
        coarse = functional.relu(self.coarse(functional.avg_pool2d(fine, 2))) * halved
        # Square roots even out the variances of shares (Hellinger).
        parts = [part.sqrt() for part in _windows(cells, shown, WINDOW)]
        parts += [*_windows(mixed, shown, WINDOW), *_windows(fine, shown, WINDOW)]
        parts += _windows(coarse, halved, WINDOW // 2)
        features = torch.cat(parts, 1).movedim(1, -1)
        return self.head(self.normal(features.flatten(0, 2))).view(features.shape[:3])


def _windows(layer: Tensor, weight: Tensor, side: int) -> list[Tensor]:
    """Return means over windows and contexts of a layer, which is 0 where the weight is."""
    means = []
    for kernel, padding in ((side, 0), (2 * side, (side + 1) // 2)):
        # A context is cut at the border of the image.
        rows, columns = (length // side for length in layer.shape[-2:])
        pooled, total = (
            functional.avg_pool2d(image, kernel, side, padding)[..., :rows, :columns]
            for image in (layer, weight)
        )
        means.append(pooled / total.clamp(min=_LEAST))
    return means
