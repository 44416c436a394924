"""Light for the check on withheld effects by another renderer than Starling's: Blender's Cycles.

    python -m starling.diagnosis.validation.adapters.cycles_light LIGHT OUT --blender .blender/bin/python

LIGHT is a folder that `starling.diagnosis.validation.adapters.light_sets.write` made; OUT is the like, its `light.npz` made
anew and all else copied. Scenes that OUT holds are left as they are, so a run that was stopped goes
on where it was. `tools/blender.sh` makes the other interpreter's environment.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from starling.diagnosis.validation.adapters import cycles_job
from starling.diagnosis.validation.camera import light, nominal
from starling.diagnosis.validation.camera.cycles import assemble, job
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.patterns.errors import InputError, refuse
from starling.sim.captures import info
from starling.sim.console import output, progress
from starling.sim.scene import scene_file
from starling.sim.scene.captured import known_geometry

RECORD = "cycles.json"  # How the light was rendered.
_SCRIPT = Path(job.__file__).with_name("render_with_blender.py")
_OF_SET = (info.FILE, nominal.FILE)
_MADE = (light.FILE, scene_file.FILE)  # What is not copied from a scene.
_MAKE = "Make its environment with tools/blender.sh."


def write(
    source: Path,
    out: Path,
    blender: Path,
    *,
    samples: int = 64,
    seed: int = 0,
    threads: int = 0,
    track: progress.Progress = progress.silent,
) -> None:
    """Render a light folder's scenes anew, each whole or not at all.

    Args:
        source: folder of light.
        out: folder to make or to go on with.
        blender: Python with `bpy`.
        samples: places in a pixel. With 64 a dot's image is good to 1 % of the mean at a focal
            length of 160 px, and better where dots are larger.
        seed: of these places; no two scenes have the same.
        threads: to render with, 0 for all cores.
        track: wraps the loop over scenes.

    Raises:
        InputError: if a folder or a scene cannot be used, `out` was rendered otherwise, or Blender
            cannot be run or fails.
        WithheldError: if a file of light cannot be used.
    """
    output.refuse_own_input(out, source)
    camera = nominal.read(source / nominal.FILE)
    scenes = sorted(path.parent for path in source.glob(f"*/{light.FILE}"))
    if not scenes:
        raise refuse("light", f"must hold SCENE/{light.FILE}", source, "Make the light first.")
    _begin(source, out, {"blender": _version(blender), "samples": samples, "seed": seed})
    for number, folder in enumerate(track(scenes, "render")):
        if (out / folder.name / light.FILE).is_file():
            continue
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as temporary:
            work, made = Path(temporary), Path(temporary, "scene")
            # Two views have a seed each.
            job.write(
                cycles_job.job(folder, camera), work / "job", samples=samples, seed=seed + number
            )
            _render(blender, work, threads, folder.name)
            arrays = assemble.arrays(work / "job", work / "rendered")
            _copy(folder, made, out / folder.name)
            np.savez_compressed(made / light.FILE, allow_pickle=False, **arrays)
            light.read(made / light.FILE, camera.shape)
            made.rename(out / folder.name)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 where something is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.cycles_light",
        description="Make a folder of light anew with Blender's Cycles.",
    )
    parser.add_argument(
        "light",
        type=Path,
        help="folder that starling.diagnosis.validation.adapters.light_sets made",
    )
    parser.add_argument("out", type=Path, help="folder to make, or to go on with")
    parser.add_argument(
        "--blender",
        type=Path,
        default=Path(".blender/bin/python"),
        help="Python with bpy, as tools/blender.sh makes it (default: %(default)s)",
    )
    parser.add_argument("--samples", type=int, default=64, help="in a pixel (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="default: %(default)s")
    parser.add_argument("--threads", type=int, default=0, help="default: all cores")
    asked = parser.parse_args(arguments)
    try:
        with progress.on_stderr() as track:
            write(
                asked.light,
                asked.out,
                asked.blender,
                samples=asked.samples,
                seed=asked.seed,
                threads=asked.threads,
                track=track,
            )
    except (InputError, WithheldError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _begin(source: Path, out: Path, record: dict[str, Any]) -> None:
    """Make the folder, or see that the one that is there was begun alike."""
    path, said = out / RECORD, json.dumps(record, indent=1)
    if path.is_file():
        for name, text in ((RECORD, said), *((n, _text(source / n)) for n in _OF_SET)):
            if _text(out / name) != text:
                raise refuse(
                    name,
                    "must be as it was when the folder was begun",
                    out / name,
                    "Go on as before, or give another folder.",
                )
        return
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise refuse("out", "must be new, empty or begun before", out, "Choose another place.")
    out.mkdir(parents=True, exist_ok=True)
    for name in _OF_SET:
        shutil.copyfile(source / name, out / name)
    path.write_text(said, encoding="utf-8")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise refuse(path.name, "must be readable", path, f"{error}.") from error


def _copy(folder: Path, made: Path, place: Path) -> None:
    """Copy what a scene's folder holds beside its light; its `scene.toml` for its new place."""
    shutil.copytree(folder, made, ignore=shutil.ignore_patterns(*_MADE))
    told = known_geometry.carried(cycles_job.captured(folder), place)
    assert told is not None  # The job was made of it.
    (made / scene_file.FILE).write_text(scene_file.dumps(told), encoding="utf-8")


def _version(blender: Path) -> str:
    """Version of the Blender that an interpreter has."""
    asks = "import bpy, sys; sys.stderr.write(bpy.app.version_string)"
    return _run([blender, "-I", "-c", asks], "blender", _MAKE).strip()


def _render(blender: Path, work: Path, threads: int, scene: str) -> None:
    command = [blender, "-I", _SCRIPT, work / "job", work / "rendered", "--threads", str(threads)]
    _run(command, f"rendering of {scene}", "Run it again, or with another Blender.")
    if not (work / "rendered" / assemble.DONE).is_file():
        raise refuse(f"rendering of {scene}", "must end", "no record of it", "Run it again.")


def _run(command: list[str | Path], name: str, remedy: str) -> str:
    """Run a command; what it says on standard error, for Blender itself talks on the other."""
    try:
        ran = subprocess.run(
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        )
    except OSError as error:
        raise refuse(
            name, "must be a Python that runs", command[0], f"{error.strerror}. {_MAKE}"
        ) from error
    if ran.returncode:
        last = (ran.stderr.strip().splitlines() or ["nothing said"])[-1]
        raise refuse(name, "must end well", f"{last} (exit {ran.returncode})", remedy)
    return ran.stderr


if __name__ == "__main__":
    raise SystemExit(main())
