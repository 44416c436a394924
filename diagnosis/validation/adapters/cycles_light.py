r"""Render the light of the validation with Blender's Cycles instead of Starling's renderer.

    python -m starling.diagnosis.validation.adapters.cycles_light LIGHT OUT \
        --blender .blender/bin/python

LIGHT is a folder written by `light_sets`. OUT becomes a copy of it in which each `light.npz` is
rendered by Cycles. Scenes that OUT already holds are skipped, so a stopped run continues where it
stopped. `tools/blender.sh` installs the Python with `bpy`.
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

RECORD = "cycles.json"  # Settings of the rendering.
_SCRIPT = Path(job.__file__).with_name("render_with_blender.py")
_SET_FILES = (info.FILE, nominal.FILE)
_WRITTEN = (light.FILE, scene_file.FILE)  # Files of a scene that are written, not copied.
_INSTALL = "Install it with tools/blender.sh."


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
    """Render all scenes of a light folder; each is written completely or not at all.

    Args:
        source: folder of light.
        out: new folder, or folder of a stopped run.
        blender: Python with `bpy`.
        samples: samples per pixel. With 64 the error of a dot's image is 1 % of the mean at a focal
            length of 160 px, and less for larger dots.
        seed: first seed of the samples; every scene has its own.
        threads: number of threads; 0 uses all cores.
        track: wraps the loop over scenes.

    Raises:
        InputError: if a folder or a scene is refused, if `out` was rendered with other settings, or
            if Blender does not start or fails.
        WithheldError: if a light file is refused.
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
            work, scene_folder = Path(temporary), Path(temporary, "scene")
            # Both views of a scene use their own seed.
            job.write(
                cycles_job.job(folder, camera), work / "job", samples=samples, seed=seed + number
            )
            _render(blender, work, threads, folder.name)
            arrays = assemble.arrays(work / "job", work / "rendered")
            _copy(folder, scene_folder, out / folder.name)
            np.savez_compressed(scene_folder / light.FILE, allow_pickle=False, **arrays)
            light.read(scene_folder / light.FILE, camera.shape)
            scene_folder.rename(out / folder.name)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 1 if the input is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.cycles_light",
        description="Render a folder of light with Blender's Cycles.",
    )
    parser.add_argument(
        "light",
        type=Path,
        help="folder written by light_sets",
    )
    parser.add_argument("out", type=Path, help="new folder, or folder of a stopped run")
    parser.add_argument(
        "--blender",
        type=Path,
        default=Path(".blender/bin/python"),
        help="Python with bpy, see tools/blender.sh (default: %(default)s)",
    )
    parser.add_argument(
        "--samples", type=int, default=64, help="samples per pixel (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="first seed (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=0, help="0: all cores (the default)")
    options = parser.parse_args(arguments)
    try:
        with progress.on_stderr() as track:
            write(
                options.light,
                options.out,
                options.blender,
                samples=options.samples,
                seed=options.seed,
                threads=options.threads,
                track=track,
            )
    except (InputError, WithheldError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _begin(source: Path, out: Path, record: dict[str, Any]) -> None:
    """Create the folder, or check that an existing one has the same settings."""
    path, settings = out / RECORD, json.dumps(record, indent=1)
    if path.is_file():
        for name, text in ((RECORD, settings), *((n, _text(source / n)) for n in _SET_FILES)):
            if _text(out / name) != text:
                raise refuse(
                    name,
                    "must be as in the stopped run",
                    out / name,
                    "Use the same settings, or give another folder.",
                )
        return
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise refuse("out", "must be new, empty or of a stopped run", out, "Choose another place.")
    out.mkdir(parents=True, exist_ok=True)
    for name in _SET_FILES:
        shutil.copyfile(source / name, out / name)
    path.write_text(settings, encoding="utf-8")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise refuse(path.name, "must be readable", path, f"{error}.") from error


def _copy(folder: Path, target: Path, place: Path) -> None:
    """Copy the other files of a scene, with a `scene.toml` adapted to the new folder."""
    shutil.copytree(folder, target, ignore=shutil.ignore_patterns(*_WRITTEN))
    known = known_geometry.for_folder(cycles_job.captured(folder), place)
    assert known is not None  # The job needed it, so it exists.
    (target / scene_file.FILE).write_text(scene_file.dumps(known), encoding="utf-8")


def _version(blender: Path) -> str:
    """Return the version of Blender in an interpreter."""
    asks = "import bpy, sys; sys.stderr.write(bpy.app.version_string)"
    return _run([blender, "-I", "-c", asks], "blender", _INSTALL).strip()


def _render(blender: Path, work: Path, threads: int, scene: str) -> None:
    command = [blender, "-I", _SCRIPT, work / "job", work / "rendered", "--threads", str(threads)]
    _run(command, f"rendering of {scene}", "Run it again, or use another Blender.")
    if not (work / "rendered" / assemble.DONE).is_file():
        raise refuse(f"rendering of {scene}", "must finish", "no record of it", "Run it again.")


def _run(command: list[str | Path], name: str, remedy: str) -> str:
    """Run a command and return its standard error; Blender writes messages to standard output."""
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
            name, "must be a Python that runs", command[0], f"{error.strerror}. {_INSTALL}"
        ) from error
    if ran.returncode:
        last = (ran.stderr.strip().splitlines() or ["no message"])[-1]
        raise refuse(name, "must succeed", f"{last} (exit {ran.returncode})", remedy)
    return ran.stderr


if __name__ == "__main__":
    raise SystemExit(main())
