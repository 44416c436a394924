"""Write a picture as PNG with 256 colours: `python tools/shrink_picture.py FROM TO`."""

import sys

from PIL import Image


def main(source: str, target: str) -> None:
    """Reduce the colours with dithering, so that gradients stay smooth."""
    picture = Image.open(source).convert("RGB")
    # Coverage keeps the colours of small legends, which a median cut merges.
    palette = picture.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=2, dither=Image.Dither.NONE)
    reduced = picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
    reduced.save(target, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
