"""Names in data as file names: one component, inside its folder, injective."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.sim.console.names import file_name

any_text = st.text(max_size=300)


@given(any_text)
def test_a_file_name_is_one_component_inside_its_folder(name: str) -> None:
    written = file_name(name)
    assert Path(written).name == written
    assert written not in ("", ".", "..")
    assert not written.startswith(".")
    assert len(written.encode()) <= 120
    assert not set(written) & set('/\\\0\n:*?"<>|')


@given(any_text, any_text)
def test_different_names_give_different_file_names(first: str, second: str) -> None:
    assert (file_name(first) == file_name(second)) == (first == second)


@pytest.mark.parametrize(("shared", "count"), [("a" * 500, 3), ("é" * 200, 3), ("/" * 200, 3)])
def test_long_names_that_differ_at_the_end_stay_different(shared: str, count: int) -> None:
    assert len({file_name(f"{shared}{number}") for number in range(count)}) == count


@pytest.mark.parametrize("name", ["kitchen", "room 2", "lab_3.b", "Küche", "a@b", "wall-0.8"])
def test_usual_names_stay(name: str) -> None:
    assert file_name(name) == name


@pytest.mark.parametrize(
    ("name", "written"),
    [("../x", "%2E.%2Fx"), ("/etc", "%2Fetc"), ("a\0", "a%00"), ("100%", "100%25"), ("", "%")],
)
def test_other_characters_are_escaped(name: str, written: str) -> None:
    assert file_name(name) == written
