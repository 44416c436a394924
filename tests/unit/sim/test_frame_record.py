"""`frame.json`: known keys are checked, other keys are preserved, damage is named."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.captures import frame_record
from starling.sim.geometry import frames

PATH = Path("set/scene/0/frame.json")
EYE = np.eye(4).tolist()
SHOWN = {"mesh": "can/textured.obj", "body": "can 0", "left_from_mesh": EYE}

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(), inner, max_size=5),
    max_leaves=20,
)
known_keys = st.sampled_from(
    ["timestamp", "exposure_s", "gain", "laser_power", "left_from_world", "objects", "bodies"]
)


def parse(record: Any) -> dict[str, Any]:
    """Parse a record from its JSON text."""
    return frame_record.parse(json.dumps(record).encode(), PATH)


def test_a_record_of_a_device_is_returned_unchanged() -> None:
    record = {
        "timestamp": 1722328243.768,
        "exposure_s": 0.0085,
        "gain": 16,
        "laser_power": 150,
        "left_from_world": frames.pose((1, 2, 3), (10, 20, 30)).tolist(),
        "counts": "repeats",
        "bodies": ["can 0"],
        "objects": [SHOWN],
        "operator": {"name": "any"},
    }
    assert parse(record) == record


def test_null_is_no_value() -> None:
    assert parse({"timestamp": None, "objects": None, "note": None, "gain": 1.0}) == {"gain": 1.0}


def test_a_byte_order_mark_is_skipped() -> None:
    assert frame_record.parse(b'\xef\xbb\xbf{"gain": 2}', PATH) == {"gain": 2}


def test_a_pose_that_is_not_finite_costs_the_pose_and_not_the_frame() -> None:
    pose = np.eye(4)
    pose[0, 3] = np.nan
    with pytest.warns(UserWarning, match=r"frame\.json: left_from_world is not finite"):
        assert parse({"left_from_world": pose.tolist(), "gain": 2}) == {"gain": 2}


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ([], "must be one object"),
        ({"timestamp": "now"}, "timestamp must be in"),
        ({"timestamp": float("nan")}, "timestamp must be in"),
        ({"timestamp": 1722328243768045898}, "divide nanoseconds"),
        ({"timestamp": 1e300}, "timestamp must be in"),
        ({"timestamp": True}, "timestamp must be in"),
        ({"exposure_s": -1}, "exposure_s must be in"),
        ({"exposure_s": 11}, r"exposure_s must be in \[0, 10\]; got 11"),
        ({"counts": 1}, "counts must be a text"),
        ({"left_from_world": "abc"}, "left_from_world must be four rows"),
        ({"left_from_world": np.eye(3).tolist()}, "left_from_world must be four rows"),
        ({"left_from_world": list(range(16))}, "left_from_world must be four rows"),
        ({"left_from_world": np.zeros((4, 4)).tolist()}, "left_from_world must be rigid"),
        ({"left_from_world": (1000 * np.eye(4)).tolist()}, "left_from_world must be rigid"),
        ({"left_from_world": [[-1, 0, 0, 0], *EYE[1:]]}, "left_from_world must turn, not mirror"),
        ({"left_from_world": [[1e200, 0, 0, 0], *EYE[1:]]}, "left_from_world must be rigid"),
        ({"left_from_world": [[10**400, 0, 0, 0], *EYE[1:]]}, "must be four rows of four numbers"),
        ({"bodies": "x"}, "bodies must be a list of texts"),
        ({"objects": [1]}, "objects must be a list of objects"),
        ({"objects": [{}]}, r"objects\[0\]\.mesh must be a text"),
        ({"objects": [{**SHOWN, "mesh": "/etc/passwd"}]}, "must be a relative path"),
        ({"objects": [{**SHOWN, "mesh": "../a.obj"}]}, "must be a relative path"),
        ({"objects": [SHOWN], "bodies": ["y"]}, r"objects\[0\]\.body must be in bodies"),
        (
            {"objects": [{**SHOWN, "left_from_mesh": []}], "bodies": ["can 0"]},
            r"objects\[0\]\.left_from_mesh must be four rows",
        ),
    ],
)
def test_an_impossible_value_is_refused_with_file_and_key(record: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        parse(record)
    assert str(PATH) in str(refused.value)


@pytest.mark.parametrize("data", [b"", b"{", b"[" * 100_000, b'{"gain": nul}'])
def test_content_that_is_no_json_is_refused(data: bytes) -> None:
    with pytest.raises(InputError, match=r"frame\.json must be JSON"):
        frame_record.parse(data, PATH)


def test_other_encodings_are_refused() -> None:
    with pytest.raises(InputError, match=r"frame\.json must be UTF-8 text"):
        frame_record.parse(b"\xff\xfe", PATH)


@pytest.mark.filterwarnings("ignore:.*left_from_world is not finite")
@given(st.dictionaries(known_keys | st.text(), json_values, max_size=6))
def test_any_object_is_parsed_or_refused(record: dict[str, Any]) -> None:
    try:
        parsed = parse(record)
    except InputError:
        return
    assert set(parsed) <= set(record)
