"""The verb `sensors`: list the presets, show a sensor, write a sensor file on a base."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from starling.patterns.errors import naming, refuse
from starling.sim.console import shell
from starling.sim.console.flags import Common, Edits, ModeName, Shared

if TYPE_CHECKING:
    from starling.sim.sensor.sensor_file import SensorFile

_BaseName = Annotated[
    str,
    arg(name="from", metavar="NAME|FILE", help="Base of a new sensor: preset or sensor file."),
]
_File = Annotated[
    Path | None,
    arg(
        metavar="FILE",
        help="Calibration of a device for a new sensor: output of rs-enumerate-devices -c, a ROS "
        "camera_info, or a board or calibration file of depthai.",
    ),
]


def sensors(
    action: Positional[Literal["list", "show", "new"]] = "list",
    name: Positional[str] = "",
    *,
    base: _BaseName = "",
    mode: ModeName = "",
    camera_matrix: _File = None,
    edits: Edits = (),
    common: Shared = Common(),
) -> None:
    """List the sensor presets, show one with the source of every number, or write a new one.

    Example: starling sensors show d435

    Example: starling sensors new wide --from d435 --set baseline_m=0.095 > wide.toml

    Args:
        action: `list` all presets, `show` one sensor, or print the file of a `new` one.
        name: Preset or sensor file (.toml) to show, or name of the new sensor.
    """
    from starling.sim.sensor import presets

    if action != "new" and (base or camera_matrix is not None or edits):
        rule = "must come with new"
        got = base or camera_matrix or edits[0]
        advice = "Run: starling sensors new NAME --from d435."
        raise refuse("from, camera-matrix, set", rule, got, advice)
    if action == "new":
        text = _new(name, base, mode=mode, camera_matrix=camera_matrix, edits=edits)
        shell.say(_parsed(text), json=common.json, as_text=lambda _: text)
        return
    if action == "list":
        if name or mode:
            rule, got = "must come with show", name or mode
            advice = f"Run: starling sensors show {name or 'd435'}."
            raise refuse("name" if name else "mode", rule, got, advice)
        shell.say(presets.summary(), json=common.json, as_text=_listed)
        return
    if not name:
        known = f"Give a sensor file, or one of {', '.join(presets.names())}."
        raise refuse("name", "must be given", "nothing", known)
    file = presets.load_file(name, mode=mode)
    shown = presets.text(name) if not mode else presets.dumps(file.sensor)
    shell.say(_table(file), json=common.json, as_text=lambda _: _page(file, shown))


def _new(
    name: str, base_name: str, *, mode: str, camera_matrix: Path | None, edits: tuple[str, ...]
) -> str:
    from starling.sim.sensor import differences, modes, presets, sensor_file
    from starling.sim.sensor.edits import apply

    for key, value in (("name", name), ("from", base_name)):
        if not value:
            advice = "Example: starling sensors new wide --from d435 --set baseline_m=0.095."
            raise refuse(key, "must be given", "nothing", advice)
    file = presets.load_file(base_name, mode=mode, camera_matrix=camera_matrix)
    base = presets.load_file(base_name)
    if file.mode != base.mode:
        assert file.mode is not None  # A mode was chosen.
        mode = mode or file.mode.mode
        base = presets.load_file(base_name, mode=mode)
    sensor = presets.with_absolute_patterns(apply(file.sensor, edits), Path.cwd())
    if mode and mode.partition("@")[0] != modes.name_of(sensor):  # Of no mode any more.
        mode, base = "", presets.load_file(base_name)
    text = differences.new_file(name, base_name, base, sensor, mode)
    with naming("the new file"):
        sensor_file.refuse_unreadable(text, Path.cwd())
    return text


def _parsed(text: str) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(text)


def _table(file: SensorFile) -> dict[str, Any]:
    """Return the fields of a sensor, and the modes of its camera if it has any."""
    from starling.sim.sensor import modes, structure

    table = structure.to_table(file.sensor)
    return {**table, "modes": modes.rows(file.modes, file.mode)} if file.modes else table


def _page(file: SensorFile, text: str) -> str:
    """Return the text of a file, followed by its base and its modes."""
    from starling.sim.sensor import modes

    parts = [text.rstrip("\n")]
    if file.base:
        parts.append(f"# All other keys are those of {file.base}.")
    if file.modes:
        listed = shell.render(modes.lines(file.modes, file.mode)).splitlines()
        parts.append("\n".join(["# Modes (--mode):", *(f"#   {line}".rstrip() for line in listed)]))
    return "\n\n".join(parts)


def _listed(summary: dict[str, dict[str, Any]]) -> str:
    """Return the presets as a table, then what describes them or differs from their bases."""
    extra = ("base", "differs", "description")
    main = {
        name: {key: value for key, value in row.items() if key not in extra}
        for name, row in summary.items()
    }
    notes = []
    for name, row in summary.items():
        parts = [row["description"]] if "description" in row else []
        if "base" in row:
            differs = ", ".join(row["differs"]) or "name only"
            parts.insert(0, f"{row['base']} with other {differs}.")
        if parts:
            notes.append(f"{name}: {' '.join(parts)}")
    return "\n".join([shell.render(main), *(["", *notes] if notes else [])])
