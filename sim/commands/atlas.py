"""`starling atlas`: one page and one picture for every effect of the table."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim import effects, metrics
from starling.sim.arrays import Image
from starling.sim.commands.compare import dot_contrast
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, OutputFolder
from starling.sim.effects import Effect, Parameter, Stage, Value, setting, written
from starling.sim.imaging.imager import Infrared
from starling.sim.plotting import panels, sheet
from starling.sim.plotting.sheet import Panel
from starling.sim.render import backend
from starling.sim.scene import sources
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, refuse_impossible, sequence
from starling.sim.stereo.depth import disparity_from_depth, from_code, to_code

SCENE = "tabletop"
# Effects that are visible only together with others, and the settings that show them.
SHOWN_WITH: dict[str, dict[str, Value]] = {
    "rolling_shutter": {"motion": 1.0},
    "black_level": {"quantisation": 8.0},
    "blooming": {"projector_power": 2.0},
    "dropped_bits": {"quantisation": 8},
    "spot_shape": {"lens_blur": 1.5},
    "noise_colour": {"shot_noise": 1.0, "read_noise": 40.0},
}
_FRAMES = 6  # Frames with the temporal filter on: enough for it to settle.
_CROP = (0.42, 0.40, 0.36)  # Left, top and size of the infrared crop, relative to the image.
_DPI = 65  # Resolution of the pictures [dots per inch].

_STAGES = {
    Stage.SCENE: "Scene",
    Stage.LIGHT: "Projector",
    Stage.OPTICS: "Optics",
    Stage.IMAGER: "Imager",
    Stage.MATCHER: "Matcher",
    Stage.POST: "Post-processing",
}

# Short names of figures; the index defines them.
_LABELS = {
    "mean level [share of full scale]": "mean level",
    "disparity bias [px]": "bias [px]",
    "disparity NMAD [px]": "NMAD [px]",
    "off by more than 1 px [%]": "over 1 px [%]",
}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Drawing:
    """The cameras that one effect is drawn with."""

    row: Effect
    without: tuple[Sensor, Scene]
    affected: Mapping[Value, tuple[Sensor, Scene]]  # By value; the largest change is drawn.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Measured:
    """A simulated shot and its figures."""

    shot: Shot
    truth_m: Image  # Reference depth of the errors [m].
    error_px: Image
    figures: dict[str, float]


def atlas(
    out: Path,
    sensor: Sensor,
    *,
    names: Iterable[str] = (),
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Draw effects, each next to the same camera without the effect.

    Effects up to the imager are drawn with the ideal camera. Effects of matcher and
    post-processing show only on noisy images, so they are drawn with the sensor as it is.

    Args:
        out: folder to create.
        sensor: supplies geometry, pattern and matcher.
        names: effects to draw; empty draws all.
        force: replace an earlier atlas.
        track: wraps the loop over effects.

    Returns:
        `{"out", "files", "seconds", "effects": {NAME: {"value", "without", "with"}}}`.

    Raises:
        InputError: if an effect is unknown, the sensor cannot show it, or the folder cannot be
            written; raised before any rendering.
    """
    started = time.perf_counter()
    rows = [effects.named(name) for name in dict.fromkeys(names)] or list(effects.table())
    scene = sources.load(SCENE, sensor)
    ideal = setting.ideal(sensor, scene)
    # Ambient light stays on: with the projector alone, shadows would be black.
    ideal = ideal[0], setting.on_scene(ideal[1], {"ambient": scene.ambient.irradiance_w_m2})
    drawings = [_drawing(row, ideal, (sensor, scene)) for row in rows]
    plain: dict[int, _Measured] = {}  # By the camera's `id`; most effects share one of two.
    figures: dict[str, Any] = {}
    with OutputFolder(out, force=force) as folder:
        for drawing in track(drawings, "atlas"):
            row, base = drawing.row, drawing.without
            if id(base) not in plain:
                plain[id(base)] = _measure(*base)
            without = plain[id(base)]
            # The reference depth is that of the scene without the effect.
            shots = {
                value: _measure(*camera, truth_m=without.truth_m)
                for value, camera in drawing.affected.items()
            }
            value, affected = max(shots.items(), key=lambda item: _changed(without, item[1]))
            folder.write(f"{row.name}.jpg", _picture(row, value, without, affected))
            measured = {"without": without.figures, "with": affected.figures}
            folder.write(f"{row.name}.md", effect_page(row, value, measured))
            figures[row.name] = {"value": value, **measured}
        folder.write("index.md", index_page(rows))
        arguments = {"sensor": sensor.name, "scene": SCENE, "effects": [row.name for row in rows]}
        folder.write(RECORD, record.of_run("atlas", arguments, figures, backend.renderer()))
    return {
        "out": str(folder.path),
        "files": 2 * len(rows) + 2,
        "seconds": round(time.perf_counter() - started, 3),
        "effects": figures,
    }


def _drawing(row: Effect, ideal: tuple[Sensor, Scene], preset: tuple[Sensor, Scene]) -> _Drawing:
    """Choose the camera and the values for drawing a row."""
    base = preset if row.stage in (Stage.MATCHER, Stage.POST) else ideal
    if row.name in SHOWN_WITH:
        base = setting.apply(*base, SHOWN_WITH[row.name])
    affected = {value: setting.apply(*base, {row.name: value}) for value in far_ends(row, *base)}
    for sensor, _ in affected.values():
        refuse_impossible(sensor, _frames(sensor))
    return _Drawing(row=row, without=base, affected=affected)


def far_ends(row: Effect, sensor: Sensor, scene: Scene) -> list[Value]:
    """Return values of a row's first parameter that are far from its current value.

    These are both ends of its range, or the far end if the value is at an end. For choices they
    are the first and the last.
    """
    parameter = row.parameters[0]
    base = setting.value(parameter, sensor, scene)
    if parameter.choices:
        return [end for end in (parameter.choices[0], parameter.choices[-1]) if end != base]
    low, high = parameter.low, parameter.high
    assert low is not None and high is not None  # A number has a range.
    if not isinstance(base, float):
        return [high]  # The sensor lacks the field; setting it raises the error.
    if low < base < high:
        return [low, high]
    return [low if base >= high else high]


def _changed(without: _Measured, affected: _Measured) -> float:
    """Share of pixels whose disparity error changes, appears or disappears."""
    same = np.isclose(without.error_px, affected.error_px, rtol=0, atol=0.01, equal_nan=True)
    return float(1 - same.mean())


def _frames(sensor: Sensor) -> int:
    return _FRAMES if sensor.post.temporal_alpha < 1 else 1


def _measure(sensor: Sensor, scene: Scene, *, truth_m: Image | None = None) -> _Measured:
    """Simulate and measure against a reference depth, by default the simulated scene's own."""
    *_, shot = sequence(scene, sensor, frames=_frames(sensor))
    if truth_m is None:
        truth_m = shot.layers.truth.depth_m
    truth = disparity_from_depth(truth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m)
    # Depth as it is written, in steps of the depth unit.
    unit = sensor.post.depth_unit_m
    disparity_px = disparity_from_depth(
        from_code(to_code(shot.depth.depth_m, unit), unit),
        focal_px=sensor.fx_px,
        baseline_m=sensor.baseline_m,
    )
    scored = metrics.disparity_figures(disparity_px, truth, metrics.scored_pixels(truth))
    return _Measured(
        shot=shot,
        truth_m=truth_m,
        error_px=disparity_px - truth,
        figures={
            "mean level [share of full scale]": float(shot.ir_left.mean()) / sensor.left.ceiling_dn,
            "dot contrast": dot_contrast(_bytes(shot.ir_left, sensor), 0.0),
            "disparity bias [px]": scored.bias_px,
            "disparity NMAD [px]": scored.nmad_px,
            "off by more than 1 px [%]": scored.bad1_pct,
            "no depth [%]": 100 * float(1 - shot.depth.valid.mean()),
        },
    )


def _bytes(infrared: Infrared, sensor: Sensor) -> NDArray[np.uint8]:
    """Scale an image to 8 bits; dot contrast is defined on 8 bits."""
    return np.rint(infrared * (255 / sensor.left.ceiling_dn)).astype(np.uint8)


def _picture(row: Effect, value: Value, without: _Measured, affected: _Measured) -> bytes:
    """Draw infrared, disparity error and holes: left without, right with the effect."""
    titles = ("without", f"{row.name} = {written(value)}")
    rows = [_top(without, affected, titles)]
    rows.append(
        [
            Panel(
                draw=partial(panels.error, error_px=measured.error_px, title="disparity error"),
                below_in=panels.BAR_IN,
            )
            for measured in (without, affected)
        ]
    )
    rows.append(
        [
            Panel(
                draw=partial(panels.reasons, reason=measured.shot.depth.reason, title="holes"),
                below_in=panels.legend_in(measured.shot.depth.reason),
            )
            for measured in (without, affected)
        ]
    )
    shape = without.shot.depth.valid.shape
    return sheet.draw(rows, shape, dpi=_DPI, kind="jpeg")


def _top(without: _Measured, affected: _Measured, titles: tuple[str, str]) -> list[Panel]:
    """Draw the infrared crop; with registered depth, draw depth before and after registration."""
    registered = affected.shot.registered_m
    if registered is not None:
        depths = (without.shot.depth.depth_m, registered)
        limits = panels.depth_limits(*depths)
        return [
            Panel(
                draw=partial(panels.depth, depth_m=depth, limits=limits, title=title),
                below_in=panels.BAR_IN,
            )
            for depth, title in zip(depths, titles, strict=True)
        ]
    cut = [_cropped(measured.shot.ir_left) for measured in (without, affected)]
    limits = panels.infrared_limits(cut[0])
    return [
        Panel(draw=partial(panels.infrared, image=image, limits=limits, title=title))
        for image, title in zip(cut, titles, strict=True)
    ]


def _cropped(infrared: Infrared) -> Infrared:
    """Cut out a part in which single dots are visible."""
    left, top, size = _CROP
    height, width = infrared.shape
    rows = slice(int(top * height), int((top + size) * height))
    return infrared[rows, int(left * width) : int((left + size) * width)]


def index_page(rows: Sequence[Effect]) -> str:
    """Write the index page, which lists all effects by stage."""
    lines = [
        "# Effect atlas",
        "",
        "Every effect of the table (`starling effects`), drawn on the `tabletop` scene by",
        "`starling atlas`. A picture shows infrared, disparity error and holes: without the effect",
        "on the left, with it on the right. The mean level is a share of full scale. Bias, NMAD",
        "and pixels over 1 px are of the disparity error. A page states where a new value needs a",
        "new render. In brackets: the family, where its name differs. Effects of one family share",
        "a physical cause.",
    ]
    for stage, title in _STAGES.items():
        listed = [row for row in rows if row.stage is stage]
        if listed:
            lines += ["", f"## {title}", "", *map(_entry, listed)]
    return "\n".join(lines) + "\n"


def effect_text(row: Effect) -> str:
    """Write one effect's row of the table as Markdown."""
    confusable = ", ".join(f"[{_words(name)}]({name}.md)" for name in row.confused_with)
    return "\n".join(
        [
            f"# {_words(row.name).capitalize()}",
            "",
            f"{row.imitates}",
            "",
            f"![without, with]({row.name}.jpg)",
            "",
            f"**Image.** {row.shows}",
            "",
            f"**Confused with.** {confusable or 'nothing'}.",
            "",
            f"**Law.** {row.law}",
            "",
            f"**Source.** {row.source}",
            "",
            *([f"**New render.** {row.rerender}.", ""] if row.rerender else []),
            "| parameter | moves | neutral | range | unit |",
            "| --- | --- | --- | --- | --- |",
            *(_parameter(parameter) for parameter in row.parameters),
            "",
        ]
    )


def effect_page(row: Effect, value: Value, figures: Mapping[str, Mapping[str, float]]) -> str:
    """Write one effect's page: the table's text and the figures of the picture.

    Args:
        row: row of the effect table.
        value: drawn value of its first parameter.
        figures: `{"without": {NAME: number}, "with": {NAME: number}}`.
    """
    lines = [
        f"Measured on the picture, {row.parameters[0].name} = {written(value)}:",
        "",
        "| | without | with |",
        "| --- | --- | --- |",
        *(
            f"| {_LABELS.get(name, name)} | {without:.3g} | {figures['with'][name]:.3g} |"
            for name, without in figures["without"].items()
        ),
    ]
    return effect_text(row) + "\n" + "\n".join(lines) + "\n"


def _entry(row: Effect) -> str:
    family = "" if row.family == row.name else f" ({_words(row.family)})"
    return f"- [{_words(row.name)}]({row.name}.md){family}"


def _parameter(parameter: Parameter) -> str:
    moves = ", ".join(f"`{path}`" for path in parameter.paths)
    neutral = "as the sensor" if parameter.neutral is None else written(parameter.neutral)
    if parameter.choices:
        span = ", ".join(map(written, parameter.choices))
    else:
        span = f"{parameter.low:g} to {parameter.high:g}"
    return f"| {parameter.name} | {moves} | {neutral} | {span} | {parameter.unit} |"


def _words(name: str) -> str:
    return name.replace("_", " ")
