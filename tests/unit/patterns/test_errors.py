"""The checks that raise InputError."""

import sys
from functools import partial

import pytest

from starling.patterns import InputError, errors


@pytest.mark.parametrize("bad", [10**400, -(10**400), float("nan"), float("inf"), "1", True, None])
def test_in_interval_refuses_non_numbers(bad):
    with pytest.raises(InputError, match=r"^size must be in \[0, 5\]; got"):
        errors.in_interval("size", bad, 0.0, 5.0)


@pytest.mark.parametrize("bad", [10**400, 0, -1.0, float("nan"), float("inf"), "1", False])
def test_positive_refuses_values_up_to_zero(bad):
    with pytest.raises(InputError, match=r"^size must be > 0; got"):
        errors.positive("size", bad)


def test_values_inside_the_interval_pass():
    errors.in_interval("size", 5, 0.0, 5.0)
    errors.positive("size", 1e-300)
    errors.one_of("name", "b", ("a", "b"))


def test_the_nearest_known_name_comes_first():
    with pytest.raises(InputError, match=r"got 'd434'\. Known: d435, d415, xtion\."):
        errors.one_of("sensor", "d434", ("xtion", "d415", "d435"))


def test_refusals_are_one_line():
    assert "\n" not in str(errors.refuse("a", "must be b", "c\nd", "Do\ne."))


def test_long_values_are_cut():
    text = str(errors.refuse("a", "must be b", "1" * 5000, "Shorten it."))
    assert text.endswith("1 ... (5000 characters). Shorten it.") and len(text) < 600


def test_errors_name_what_they_concern():
    message = r"^scene a: size must be > 0; got 0\."
    with pytest.raises(InputError, match=message), errors.naming("scene a"):
        errors.positive("size", 0)


def test_integers_that_python_does_not_print_are_refused():
    huge = 10 ** (sys.get_int_max_str_digits() + 1)
    rule = r"got a value of type int that cannot be printed\."
    for check in (
        lambda: errors.in_interval("size", huge, 0.0, 5.0),
        lambda: errors.positive("size", huge),
        lambda: errors.whole_number("size", huge, 0, 5),
        lambda: errors.instance("size", huge, str, "Give text."),
        lambda: errors.one_of("size", huge, ("a", "b")),
    ):
        with pytest.raises(InputError, match=rule):
            check()


@pytest.mark.parametrize("bad", [None, b"a", "\ud800"])
def test_unicode_text_refuses(bad):
    with pytest.raises(InputError, match=r"^name must be (of type str|Unicode text); got"):
        errors.unicode_text("name", bad)
    errors.unicode_text("name", "Stube ä 室")


@pytest.mark.parametrize("bad", [None, [0, 1, 0], (0, 1), "xyz", (0, 1, 0, 0)])
def test_vectors_are_tuples_of_three(bad):
    for check in (errors.vector, partial(errors.direction, remedy="Turn it.")):
        with pytest.raises(InputError, match=r"^up must be a tuple of three numbers; got"):
            check("up", bad, 0.5, 2.0)


def test_vectors_name_the_axis_outside():
    with pytest.raises(InputError, match=r"^place\.y must be in \[0, 1\]; got 2"):
        errors.vector("place", (0, 2, 0), 0.0, 1.0)
    with pytest.raises(InputError, match=r"^length of up must be in \[0\.5, 2\]; got 0\.0"):
        errors.direction("up", (0, 0, 0), 0.5, 2.0, "Turn it.")
    errors.direction("up", (1, 1, 1), 0.5, 2.0, "Turn it.")
