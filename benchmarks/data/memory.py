"""Peak resident memory of the verbs that walk over frames, with few and with many frames.

    python benchmarks/data/memory.py [--frames 250 1000] [--only "export tum" match] [--seconds 400]

Frames have 160x120 pixels. Eight generated frames are linked repeatedly: as scenes of one frame in
eight rooms, or as repeats of one scene. Each verb runs alone on both numbers of frames, and VmRSS
of its processes is added up every 0.1 s. A verb is flat if the peak with many frames exceeds the
peak with few by at most 10 % + 20 MB. Slow verbs get a share of the frames.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import trimesh
from kill_generate import session

STARLING = (sys.executable, "-m", "starling")
SIZE = {"width": 160, "height": 120, "fx_px": 120, "fy_px": 120, "cx_px": 79.5, "cy_px": 59.5}
FLAGS = " ".join(f"--set {name}={value}" for name, value in SIZE.items())
D435 = f"--sensor d435 {FLAGS}"
DISTINCT = 8  # Generated frames; the others are links to them.
PERIOD_S = 0.1  # Time between two samples.
RELATIVE, ABSOLUTE_MB = 0.10, 20.0  # Greatest growth of a flat verb.
ONE_CLUTTER = 'kind = "builtin"\nscene = "clutter"\nnumber = 0'
CLUTTERS = 'kind = "builtin"\nscene = "clutter"\nnumber = { low = 0, high = 99, whole = true }'
DROPPED = 'kind = "dropped"\nfolder = "meshes"\ncount = 2'


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """A verb with its arguments, where `{...}` stands for a path or the number of frames."""

    name: str
    words: str
    out: str = " --out {folder}/{out}"  # Empty for a verb that writes no files.
    share: int = 1  # The number of frames is divided by it.


# Later runs read the output of earlier ones.
RUNS = (
    Run(name="simulate", words=f"simulate tabletop --frames {{n}} {D435}"),
    Run(name="generate folders", words="generate {folder}/views.toml --workers 2"),
    Run(name="generate shards", words="generate {folder}/views.toml --workers 2 --layout shards"),
    Run(name="generate one view", words="generate {folder}/repeats.toml --workers 1"),
    Run(name="verify folders", words="verify {folder}/generate-folders --sample 2", out=""),
    Run(name="verify shards", words="verify {folder}/generate-shards --sample 2", out=""),
    Run(name="verify one view", words="verify {folder}/generate-one-view --sample 0", out=""),
    Run(name="show", words="show {folder}/scenes", share=5),
    Run(name="match", words="match {folder}/scenes --sensor d435"),
    Run(name="compare", words="compare {folder}/scenes {folder}/scenes", out=""),
    Run(name="compare methods", words="compare {folder}/scenes --methods perfect", out=""),
    Run(name="export tum", words="export {folder}/repeats --layout tum"),
    Run(name="export ros2", words="export {folder}/repeats --layout ros2"),
    Run(name="import ros2", words="import {folder}/export-ros2/bag"),
    Run(name="export bop", words="export {folder}/objects --layout bop --meshes {sources}/meshes"),
    Run(name="fuse", words="fuse {folder}/export-tum --layout tum --sensor d435 --voxel 0.02"),
    Run(name="complete scenes", words="complete {folder}/scenes --method small"),
    Run(name="complete repeats", words="complete {folder}/repeats --method wls"),
    Run(name="train completion", words="train completion {folder}/scenes --steps 4"),
    Run(name="evaluate completion", words="evaluate completion {folder}/scenes --methods nearest"),
    Run(name="train trees", words="train trees {folder}/scenes", share=25),
    Run(name="train network", words="train network {folder}/scenes --steps 4"),
    Run(name="evaluate", words="evaluate {folder}/scenes --methods simple"),
    Run(
        name="calibrate scenes",
        # The images are too small to match windows, as the geometry fit does.
        words="calibrate {folder}/scenes --sensor d435 --free photometry",
        out=" --out {folder}/{out}.toml",
    ),
    Run(
        name="calibrate repeats",
        words="calibrate {folder}/repeats --sensor d435 --free noise",
        out=" --out {folder}/{out}.toml",
    ),
    Run(
        name="diagnose scenes",
        words="diagnose {folder}/scenes --sensor d435 --families read_noise",
        share=25,
    ),
    Run(
        name="diagnose repeats",
        words="diagnose {folder}/repeats --sensor d435 --families read_noise",
    ),
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Peak:
    """Result of a run."""

    mb: float
    seconds: float
    failure: str  # Empty if the run succeeded.


def main() -> None:
    """Print a row for each run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, nargs=2, default=(250, 1000))
    parser.add_argument("--only", nargs="+", default=[run.name for run in RUNS])
    parser.add_argument("--seconds", type=float, default=400.0)
    options = parser.parse_args()
    print("| verb | frames | peak [MB] | growth a frame [kB] | time [s] | flat |")
    print("|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as name:
        sources = Path(name)
        make_sources(sources)
        for run in (run for run in RUNS if run.name in options.only):
            counts = [count // run.share for count in options.frames]
            peaks = [measure(run, sources, count, options.seconds) for count in counts]
            print(row(run, counts, peaks), flush=True)


def row(run: Run, counts: list[int], peaks: list[Peak]) -> str:
    """Return a row of the table."""
    few, many = peaks
    growth_kb = 1e3 * (many.mb - few.mb) / (counts[1] - counts[0])
    flat = many.mb <= (1 + RELATIVE) * few.mb + ABSOLUTE_MB
    failures = "; ".join(peak.failure for peak in peaks if peak.failure)
    cells = [
        run.name,
        f"{counts[0]}, {counts[1]}",
        f"{few.mb:.0f}, {many.mb:.0f}",
        f"{growth_kb:.0f}",
        f"{few.seconds:.0f}, {many.seconds:.0f}",
        failures or ("yes" if flat else "**no**"),
    ]
    return f"| {' | '.join(cells)} |"


def make_sources(sources: Path) -> None:
    """Generate the distinct frames, and the meshes of dropped objects."""
    (sources / "meshes").mkdir()
    trimesh.creation.icosphere(radius=0.04).export(sources / "meshes" / "ball.ply")
    plans = {
        "scenes": plan(CLUTTERS, scenes=DISTINCT),
        "repeats": plan(ONE_CLUTTER, frames=DISTINCT),
        "objects": plan(DROPPED, scenes=DISTINCT),
    }
    for name, text in plans.items():
        path = sources / f"{name}.toml"
        path.write_text(text)
        command = [*STARLING, "generate", str(path), "--out", str(sources / name)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def plan(source: str, *, scenes: int = 1, views: int = 1, frames: int = 1) -> str:
    """Return a plan of D435s, seen from varied places."""
    fields = "\n".join(f"{name} = {value}" for name, value in SIZE.items())
    return f"""seed = 1
scenes = {scenes}
views = {views}
frames = {frames}
layers = ["infrared", "truth"]
[[source]]
{source}
[[sensor]]
preset = "d435"
[sensor.set]
{fields}
[pose]
shift_m = [{{ low = -0.1, high = 0.1 }}, 0, 0]
"""


def inputs(sources: Path, count: int) -> Path:
    """Return the folder of the inputs of this number of frames; make it if it is new."""
    folder = sources / f"frames-{count}"
    if folder.exists():
        return folder
    folder.mkdir()
    (folder / "views.toml").write_text(plan(ONE_CLUTTER, views=count))
    (folder / "repeats.toml").write_text(plan(ONE_CLUTTER, frames=count))
    for name in ("scenes", "objects", "repeats"):
        (folder / name).mkdir()
        shutil.copy(sources / name / "capture.toml", folder / name)
        scenes = sorted(path.parent for path in (sources / name).glob("*/room"))
        if name == "repeats":
            link(scenes[0], folder / name / "scene")
            for number in range(DISTINCT, count):
                link(scenes[0] / str(number % DISTINCT), folder / name / "scene" / str(number))
        else:
            for number in range(count):
                link(scenes[number % DISTINCT], folder / name / f"scene-{number:04d}")
    return folder


def link(source: Path, target: Path) -> None:
    """Copy a folder as hard links."""
    shutil.copytree(source, target, copy_function=os.link)


def measure(run: Run, sources: Path, count: int, seconds: float) -> Peak:
    """Run a verb in its own processes, and sample their resident memory."""
    folder = inputs(sources, count)
    words = (run.words + run.out).format(
        folder=folder, sources=sources, n=count, out=run.name.replace(" ", "-")
    )
    started, peak_mb, late = time.monotonic(), 0.0, False
    with tempfile.TemporaryFile("w+") as messages:
        process = subprocess.Popen(
            [*STARLING, *words.split()],
            stdout=subprocess.DEVNULL,
            stderr=messages,
            start_new_session=True,
        )
        while process.poll() is None:
            members = [process.pid, *session(process.pid)]
            peak_mb = max(peak_mb, sum(map(resident_mb, members)))
            if not late and time.monotonic() - started > seconds:
                late = True
                os.killpg(process.pid, signal.SIGTERM)
            time.sleep(PERIOD_S)
        messages.seek(0)
        last = (messages.read().strip().splitlines() or [""])[-1]
    failure = f"stopped after {seconds:.0f} s" if late else last if process.returncode else ""
    return Peak(mb=peak_mb, seconds=time.monotonic() - started, failure=failure)


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process [MB]; 0 if it has ended."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) * 1024 / 1e6
    return 0.0


if __name__ == "__main__":
    main()
