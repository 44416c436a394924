"""Frames that diffusion draws from, each read when it is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from starling.learning.completion.data.fingerprint import fingerprint
from starling.learning.completion.data.layouts import Listed
from starling.learning.completion.data.training_frame import Holes, none_has_depth, training_frame
from starling.learning.completion.diffusion.samples import Sample


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Unread:
    """Listed frames as `Samples`: none is kept, so a data set may be larger than memory.

    Whether a frame has depth is seen when it is read. One that has none gives its place to the
    next in order that has, so that what is drawn depends on the frames alone.
    """

    frames: Sequence[Listed]  # At least one, with truth.
    holes: Holes
    seed: int  # Of random holes.
    shares: dict[int, float] = field(default_factory=dict)  # Of those read: number -> holes, 0..1.

    @property
    def identity(self) -> str:
        """Text that changes with the frames, found without reading an image.

        Raises:
            InputError: as `fingerprint`.
        """
        return f"{fingerprint(self.frames)} holes {self.holes}"

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, number: int) -> Sample:
        """Read one.

        Raises:
            InputError: whatever is wrong with a frame; if none has depth.
        """
        for place in (*range(number, len(self)), *range(number)):
            if (sample := self._read(place)) is not None:
                return sample
        raise none_has_depth(len(self))

    def _read(self, place: int) -> Sample | None:
        if self.shares.get(place) == 1:
            return None
        one = self.frames[place].load()
        ready = training_frame(one, self.holes, seed=self.seed, number=place)
        self.shares[place] = 1.0 if ready is None else float(1 - ready.valid.mean())
        return None if ready is None else Sample(ready.frame, ready.truth())
