"""Hash what the verbs produce: shows that a change of the code moves no bit of the output.

    python tools/output_hashes.py OUT.json

Run it on both versions on one machine and compare the two files. It takes about ten minutes.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

SIZE = ("width=424", "height=240", "fx_px=215", "fy_px=215", "cx_px=211.5", "cy_px=119.5")
SMALL = [f"--set={edit}" for edit in SIZE]
SCENES = ("wall", "tabletop", "clutter")
EFFECTS = (  # One of each stage, and those that need a render.
    *("motion=2", "ambient=400", "metal=0.5", "interreflection=1"),
    *("laser_speckle=0.3", "wrong_pattern=1"),
    *("lens_blur=0.9", "read_noise=8", "uniqueness=20", "decimation=2"),
)
EXAMPLE = Path(__file__).parents[1] / "examples" / "07_data_set.py"  # Holds the plan.
# Keys that differ between runs or name the code.
VOLATILE = {"seconds", "versions", "out", "path", "report", "file", "version", "time", "stages"}


def main(out: Path) -> None:
    """Run the verbs in an empty folder and write one hash for each output."""
    hashes: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        for preset in sorted(json.loads(_run("sensors", "--json"))):
            for scene in SCENES:
                for seed in ("1", "2"):
                    _run("simulate", scene, "--sensor", preset, "--out", "s", "--seed", seed)
                    hashes[f"simulate {scene} {preset} {seed}"] = _folder(Path("s"))
        for effect in EFFECTS:
            hashes[f"effect {effect}"] = _effect(effect)
        hashes["match"] = _match()
        hashes["generate"] = _generate()
        _scenes_with_vignetting()
        groups = ("baseline", "focal", "projector", "photometry", "noise")
        fit = ("calibrate", "c", "--sensor", "d435", *SMALL, "--free", *groups)
        hashes["calibrate"] = _numbers(_run(*fit, "--out", "cal.toml", "--json"))
        families = ("vignetting", "veil", "read_noise", "tone_curve", "lens_blur", "uniqueness")
        even = "--set=imager.lens.vignetting=0"
        gap = ("diagnose", "c", "--sensor", "d435", *SMALL, even, "--families", *families)
        hashes["diagnose"] = _numbers(_run(*gap, "--out", "dia", "--json"))
    out.write_text(json.dumps(hashes, indent=1) + "\n", encoding="utf-8")


def _effect(effect: str) -> str:
    try:
        _run("simulate", "tabletop", "--sensor", "d435", *SMALL, "--effect", effect, "--out", "s")
    except subprocess.CalledProcessError:
        return "refused"
    return _folder(Path("s"))


def _match() -> str:
    scene = ("tabletop", "--sensor", "d415", *SMALL, "--frames", "2", "--seed", "3")
    _run("simulate", *scene, "--out", "m")
    return _numbers(_run("match", "m", "--sensor", "d415", "--out", "mo", "--json"))


def _generate() -> str:
    Path("plan.toml").write_text(_plan(), encoding="utf-8")
    _run("generate", "plan.toml", "--out", "g")
    return _folder(Path("g"))


def _plan() -> str:
    """Read the plan in the example, without importing the version that is tested."""
    for node in ast.parse(EXAMPLE.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "PLAN":
            return ast.literal_eval(node.value)
    raise RuntimeError(f"{EXAMPLE} has no PLAN")


def _scenes_with_vignetting() -> None:
    for number in ("1", "2", "3"):
        effect = ("--effect", "vignetting=4", "--frames", "2", "--seed", number)
        _run("simulate", f"clutter:{number}", "--sensor", "d435", *SMALL, *effect, "--out", number)
        for path in Path(number).iterdir():
            Path("c").mkdir(exist_ok=True)
            if not (Path("c") / path.name).exists():
                shutil.move(str(path), "c")


def _run(verb: str, *arguments: str) -> str:
    force = ("--force",) if verb == "simulate" else ()
    command = (sys.executable, "-m", "starling", verb, *arguments, *force)
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def _folder(path: Path) -> str:
    """Hash the images and pixel data below a folder."""
    kinds = {".png", ".exr", ".npy", ".npz", ".tar"}
    files = sorted(file for file in path.rglob("*") if file.suffix in kinds)
    parts = [f"{file.relative_to(path)} {_digest(file.read_bytes())}" for file in files]
    return _digest("\n".join(parts).encode())


def _numbers(text: str) -> str:
    """Hash the numbers of a JSON result, in the order of their keys; sentences do not count."""
    return _digest(json.dumps(_stable(json.loads(text)), sort_keys=True).encode())


def _stable(value: Any) -> Any:
    if isinstance(value, dict):
        stable = {key: item for key, item in value.items() if key not in VOLATILE}
        return {key: _stable(item) for key, item in stable.items() if not key.endswith("_s")}
    if isinstance(value, list):
        return [_stable(item) for item in value]
    return None if isinstance(value, str) else value


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute())
