"""The controls of a RealSense D400: names, admitted values, presets, and the viewer's JSON files.

Names: librealsense src/ds/advanced_mode/json_loader.hpp. Meaning of the thresholds: DSAPI, the
library of the family's first chips (DSAPITypes.h). The ranges are assumed; they admit all known
files.

The viewer exports two forms: a flat table of controls, and in newer viewers
`{"schema version": 1, "device": {...}, "parameters": {...}, "viewer": {...}}`. Values are text
or numbers.
"""

from __future__ import annotations

import math
import re
import tomllib
import warnings
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from starling.patterns import errors, regular_file
from starling.sim import files

Control = float | str  # Value of a control: a number, or one of its words.
Controls = Mapping[str, Control]  # Values by the controls' canonical names (see `canonical`).

WORDS = {
    "controls-laserstate": ("off", "on", "auto"),
    "controls-autoexposure-auto": ("false", "true"),
    "controls-depth-white-balance-auto": ("false", "true"),
    "controls-color-autoexposure-auto": ("false", "true"),
    "controls-color-white-balance-auto": ("false", "true"),
}
ALIASES = {  # Alternative names of controls.
    "param-zunits": "param-depthunits",
    "aux-param-depthclampmin": "param-depthclampmin",
    "aux-param-depthclampmax": "param-depthclampmax",
    "aux-param-disparityshift": "param-disparityshift",
    "aux-param-autoexposure-setpoint": "param-autoexposure-setpoint",
    "param-censusenablereg-udiameter": "param-censususize",
    "param-censusenablereg-vdiameter": "param-censusvsize",
    **{f"aux-param-colorcorrection{i}": f"param-colorcorrection{i}" for i in range(1, 13)},
}
RANGES = {  # Controls that are mapped onto a sensor, with their ranges.
    "param-secondpeakdelta": (0, 1023),
    "param-neighborthresh": (0, 1023),
    "param-leftrightthreshold": (0, 2047),  # [1/32 px]
    "param-usersm": (0, 1),
    "param-rsmdiffthreshold": (0, 16),  # [px]
    "param-rsmremovethreshold": (0, 1),  # Share of 168 neighbours.
    "param-texturecountthresh": (0, 49),  # Pixels of the 7x7 window.
    "param-texturedifferencethresh": (0, 4095),
    "param-scanlinep1": (0, 1023),
    "param-scanlinep2": (0, 1023),
    "param-lambdaad": (1, 4095),
    "param-lambdacensus": (1, 4095),
    "ignoreSAD": (0, 1),
    "param-censususize": (3, 11),  # [px]
    "param-censusvsize": (3, 11),
    "param-depthunits": (1, 100_000),  # [um]
    "param-depthclampmin": (0, 65_536),  # [depth units]
    "param-depthclampmax": (1, 65_536),
    "param-disparityshift": (0, 512),  # [px]
    "param-autoexposure-setpoint": (0, 3686),  # Share of 4096.
    "controls-laserpower": (0, 360),  # [mW]
    "controls-autoexposure-manual": (1, 1_000_000),  # [us]
    "controls-depth-gain": (16, 248),  # 16 is unity.
}
_SCORES = "our matcher's cost has no such score"
_ARMS = "our support's arms have no least length or shrinking"
_COLOUR = "it acts on colour channels; ours is one infrared image"
_MODS = "our penalties do not change at steps of brightness (it gained nothing: decision 0003)"
_STREAM = "it chooses a stream; the sensor says its size itself"
_RGB = "it sets the colour camera"
WITHOUT_COUNTERPART = {  # Controls without effect on the sensor, with the reason.
    "param-medianthreshold": f"{_SCORES}: a median over all disparities",
    "param-robbinsmonrodecrement": f"{_SCORES}: a running median",
    "param-robbinsmonroincrement": f"{_SCORES}: a running median",
    "param-minscorethresha": f"{_SCORES}: an absolute one",
    "param-maxscorethreshb": f"{_SCORES}: an absolute one",
    "param-rsmrauslodiffthreshold": "our matcher has no second search without penalties",
    **dict.fromkeys(
        ("param-raumine", "param-rauminn", "param-rauminnssum", "param-raumins", "param-rauminw",
         "param-rauminwesum", "param-regionshrinku", "param-regionshrinkv",
         "param-regionspatialthresholdu", "param-regionspatialthresholdv"), _ARMS,
    ),
    **dict.fromkeys(
        ("param-disableraucolor", "param-disablesadcolor", "param-disablesadnormalize",
         "param-disablesloleftcolor", "param-disableslorightcolor", "param-regioncolorthresholdb",
         "param-regioncolorthresholdg", "param-regioncolorthresholdr", "param-scanlineedgetaub",
         "param-scanlineedgetaug", "param-scanlineedgetaur",
         *(f"param-colorcorrection{i}" for i in range(1, 13))), _COLOUR,
    ),
    **dict.fromkeys(
        ("param-scanlinep1onediscon", "param-scanlinep1twodiscon", "param-scanlinep2onediscon",
         "param-scanlinep2twodiscon"), _MODS,
    ),
    "param-amplitude-factor": "it corrects a pull to whole pixels; what remains of yours goes into "
    "the effect pixel_locking",
    "param-disparitymode": "our output is depth",
    "aux-param-disparitymultiplier": "librealsense ignores it too",
    "result": "librealsense ignores it too",
    "result:": "librealsense ignores it too",
    **dict.fromkeys(
        ("stream-depth-format", "stream-ir-format", "stream-width", "stream-height", "stream-fps"),
        _STREAM,
    ),
    "controls-depth-white-balance-auto": _RGB,
    **dict.fromkeys(
        (f"controls-color-{name}" for name in (
            "autoexposure-auto", "autoexposure-manual", "backlight-compensation", "brightness",
            "contrast", "gain", "gamma", "hue", "power-line-frequency", "saturation", "sharpness",
            "white-balance-auto", "white-balance-manual")), _RGB,
    ),
}  # fmt: skip
_FREE = ("result", "result:", "stream-depth-format", "stream-ir-format")  # Accept any text.
_WIDEST = 1e6  # Range of other controls; all registers are smaller.
KNOWN = frozenset({*WORDS, *RANGES, *WITHOUT_COUNTERPART})

DEFAULT_PRESET = "default"  # Preset that an unchanged sensor represents.
_MODEL = re.compile(r"d4\d\d")  # Model number in the name of a device or sensor.
_SCHEMA = 1  # Only known version of files with sections.
_SECTIONS = ("schema version", "device", "parameters", "viewer")
PRODUCT_LINE = "D400"
_EXAMPLE = 'Write {"param-leftrightthreshold": 24, ...}.'


def canonical(values: Iterable[tuple[str, Any]]) -> dict[str, Control]:
    """Return the values by the controls' canonical names, as numbers or words.

    Args:
        values: Pairs (name, value) as in a JSON file; a value is a number or its text.

    Raises:
        InputError: for an unknown control, a value that is not a number or is out of range, or
            aliases of one control that disagree.
    """
    controls: dict[str, Control] = {}
    sources: dict[str, str] = {}
    for alias, value in values:
        errors.one_of("control", alias, KNOWN | ALIASES.keys())
        name = ALIASES.get(alias, alias)
        read = _read(alias, name, value)
        if controls.setdefault(name, read) != read:
            raise errors.refuse(
                f"{sources[name]} and {alias}",
                "must agree: they are one control",
                f"{controls[name]:g} and {read:g}",
                "Drop one.",
            )
        sources.setdefault(name, alias)
    return controls


def _read(alias: str, name: str, value: Any) -> Control:
    """Parse one value; `alias` is the name in error messages."""
    if name in _FREE:
        return str(value)
    if name in WORDS:
        word = str(value).lower()
        if word not in WORDS[name]:
            raise errors.refuse(
                alias, f"must be one of {', '.join(WORDS[name])}", repr(value), "Mind the word."
            )
        return word
    low, high = RANGES.get(name, (-_WIDEST, _WIDEST))
    try:
        number = float(value) if isinstance(value, str) else value
    except ValueError:
        number = math.nan
    # The comparison finds NaN, also beside integers that overflow a float.
    if not isinstance(number, (int, float)) or isinstance(number, bool) or number != number:
        raise errors.refuse(alias, "must be a number", repr(value), "Export the file again.")
    errors.in_interval(alias, number, low, high, "It is outside what the device takes.")
    return float(number)


def preset_names() -> list[str]:
    """List the presets, the device's default first."""
    return list(_tables())


def named_preset(name: str = DEFAULT_PRESET) -> dict[str, Control]:
    """Return a preset's values by control.

    Raises:
        InputError: for an unknown preset; the message lists the known ones, nearest first.
    """
    errors.one_of("device preset", name, _tables())
    return dict(_tables()[name])


@cache
def _tables() -> dict[str, dict[str, Control]]:
    text = Path(__file__).with_name("presets.toml").read_text(encoding="utf-8")
    return {name: canonical(t.items()) for name, t in tomllib.loads(text).items()}


def read_file(path: str | Path, sensor: str = "") -> dict[str, Control]:
    """Read an exported file.

    Args:
        path: JSON file.
        sensor: name of the sensor that it is applied to; a file of another device gives a warning.

    Returns:
        Values by the controls' canonical names.

    Raises:
        InputError: for an unreadable file, a file without a JSON table, another product line, or a
            control that `starling.sim.sensor.realsense.controls.canonical` refuses.
    """
    path = Path(path)
    try:
        data = regular_file.read(path)
    except OSError as error:
        advice = f"{error.strerror}."
        raise errors.refuse("device preset", "must be a readable file", path, advice) from None
    try:
        table = files.parse_json(data, path)
    except errors.InputError as error:
        advice = "Export it from the RealSense viewer."
        raise errors.refuse("device preset", "must be a JSON file", error, advice) from None
    if not isinstance(table, Mapping):
        raise errors.refuse(
            "device preset", "must hold a table", f"{type(table).__name__} in {path}", _EXAMPLE
        )
    _warn_other_device(table, sensor, path)
    return canonical(_entries(table, path))


def _warn_other_device(table: Mapping[str, Any], sensor: str, path: Path) -> None:
    """Warn if the file names a model, such as D405, and the sensor's name is of another one."""
    device = table.get("device")
    name = str(device.get("name", "")) if isinstance(device, Mapping) else ""
    model, own = _MODEL.search(name.lower()), _MODEL.search(sensor.lower())
    if model and own and model[0] != own[0]:
        message = f"{path} was exported from a {model[0].upper()}; it is applied to {sensor}."
        warnings.warn(message, stacklevel=2)


def _entries(table: Mapping[str, Any], path: Path) -> list[tuple[str, Any]]:
    """List all controls of either form."""
    if "hdr-preset" in table:
        rule, advice = "must hold controls", "HDR sequences are not modelled."
        raise errors.refuse("device preset", rule, "an hdr-preset", advice)
    if "parameters" not in table:
        return list(table.items())
    for name in table:
        errors.one_of("section", name, _SECTIONS)
    version = table.get("schema version", _SCHEMA)
    if version != _SCHEMA:
        message = f"{path}: schema version {version!r:.80} is read as {_SCHEMA}."
        warnings.warn(message, stacklevel=2)
    device = _section(table, "device")
    line = device.get("product line", PRODUCT_LINE)
    if line != PRODUCT_LINE:
        raise errors.refuse(
            "device.product line", f"must be {PRODUCT_LINE}", repr(line), "Others are not modelled."
        )
    return [*_section(table, "parameters").items(), *_section(table, "viewer").items()]


def _section(table: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    section = table.get(name, {})
    if not isinstance(section, Mapping):
        raise errors.refuse(name, "must be a table", repr(section), _EXAMPLE)
    return section
