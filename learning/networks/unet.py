"""A U-Net of about 100,000 parameters for images of any size (Ronneberger et al., MICCAI 2015)."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

WIDTHS = (16, 24, 32, 32, 32)  # Channels at 1/2, 1/4, 1/8, 1/16 and 1/32 of the resolution.


class _Block(nn.Module):
    """Residual block of 3x3 convolutions: x + f(x), where f starts at zero.

    Starting as the identity replaces normalisation (Zhang et al., Fixup initialization, ICLR 2019),
    whose statistics would differ between whole images and training crops.
    """

    def __init__(self, width: int, layers: int) -> None:
        super().__init__()
        convolutions = [nn.Conv2d(width, width, 3, padding=1) for _ in range(layers)]
        _zero(convolutions[-1])
        self.layers = nn.ModuleList(convolutions)

    def forward(self, x: Tensor) -> Tensor:
        residual = x
        for layer in self.layers:
            residual = layer(functional.relu(residual))
        return x + residual


class UNet(nn.Module):
    """Maps images (b, c, h, w) to images (b, k, h, w); exactly zero before training.

    A 2x2 stem reads full resolution, and four channels a cell write it (sub-pixel convolution: Shi
    et al., CVPR 2016), at a quarter of the cost. An occlusion is as wide as a disparity step, up to
    about 100 pixels. With five levels, the receptive field reaches at least 120 pixels in every
    direction.
    """

    def __init__(self, inputs: int, outputs: int = 1, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        finer = widths[:-1]
        self.stride = 2 ** len(widths)
        self.stem = nn.Conv2d(inputs, widths[0], 2, stride=2)
        self.encode = nn.ModuleList(_Block(width, 2) for width in widths)
        self.down = nn.ModuleList(
            nn.Conv2d(above, below, 2, stride=2)
            for above, below in zip(finer, widths[1:], strict=True)
        )
        self.up = nn.ModuleList(
            nn.Conv2d(below, above, 1) for above, below in zip(finer, widths[1:], strict=True)
        )
        self.decode = nn.ModuleList(_Block(width, 1) for width in finer)
        self.head = nn.Conv2d(widths[0], 4 * outputs, 3, padding=1)
        _zero(self.head)

    def start_at(self, value: float) -> None:
        """Set the output of every pixel before training, instead of zero."""
        if self.head.bias is not None:
            nn.init.constant_(self.head.bias, value)

    def forward(self, x: Tensor) -> Tensor:
        height, width = x.shape[-2:]
        padding = (0, -width % self.stride, 0, -height % self.stride)
        x = self.stem(functional.pad(x, padding, mode="replicate") if any(padding) else x)
        skipped = []
        for encode, down in zip(self.encode, self.down, strict=False):
            skipped.append(encode(x))
            x = down(skipped[-1])
        x = self.encode[-1](x)
        for up, decode in zip(reversed(self.up), reversed(self.decode), strict=True):
            x = decode(functional.interpolate(up(x), scale_factor=2.0) + skipped.pop())
        output = functional.pixel_shuffle(self.head(functional.relu(x)), 2)
        return output[..., :height, :width]


def parameter_count(network: nn.Module) -> int:
    """Number of trainable parameters."""
    return sum(parameter.numel() for parameter in network.parameters())


def _zero(layer: nn.Module) -> None:
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)
