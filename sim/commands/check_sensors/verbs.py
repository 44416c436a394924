"""The verb `sensors check`: parse arguments, make one call, print the result."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional

from starling.sim.console import shell
from starling.sim.console.flags import Common, Shared


def sensors_check(
    names: Positional[tuple[str, ...]] = (),
    *,
    out: Path | None = None,
    seed: int = 0,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Simulate what vendors state of their cameras; print stated and simulated figures.

    Targets are flat, of reflectance 0.5. A missed figure is a result, not an error.

    Example: starling sensors check d435 --out out/sensors

    Args:
        names: Presets with a data sheet. By default all are checked.
        out: Folder to create for the tables and a picture of noise against distance.
        seed: Seed of the noise.
        force: Replace a folder that starling wrote earlier.
    """
    from starling.sim.commands.check_sensors import check, table
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = check.run(names, out, seed=seed, force=force, track=track)
    shell.say(result, json=common.json, as_text=table.text)
