"""The command line of the validation: invalid options, error messages and the verb."""

from __future__ import annotations

import subprocess
import sys
from typing import get_args

import pytest

from starling import command_line
from starling.diagnosis import verbs
from starling.diagnosis.validation import __main__ as program
from starling.diagnosis.validation.adapters import __main__ as adapters
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol import plan, programs
from starling.diagnosis.validation.protocol.check import Check
from starling.diagnosis.validation.protocol.tier import TIERS


def test_invalid_options_are_refused(tmp_path, capsys):
    base = [str(tmp_path / "run"), "--tier", "4"]
    assert program.main(base) == 1
    assert "captures and sensor must be given for tier 4" in capsys.readouterr().err
    options = ["--captures", str(tmp_path / "none"), "--sensor", "d415"]
    assert program.main([*base[:1], *options]) == 1
    assert "and for no other" in capsys.readouterr().err
    assert program.main([*base, *options, "--no-infrared"]) == 1
    assert "must have infrared" in capsys.readouterr().err
    assert program.main([*base, *options, "--power"]) == 1
    assert "power must be used with tier 1; got tier 4." in capsys.readouterr().err
    assert program.main([str(tmp_path / "run"), "--mode", "640x480"]) == 1
    assert "mode must be given for tier 4 only; got 640x480 for tier 1." in capsys.readouterr().err
    assert program.main([str(tmp_path / "run"), "--power", "--cases", "0"]) == 1
    assert "cases must be >= 1; got 0" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    assert program.main([*base, *options, "--jobs", "0"]) == 1
    assert "jobs must be >= 1; got 0" in capsys.readouterr().err
    for sets in ("0", "7"):
        assert program.main([*base, *options, "--sets", sets]) == 1
        assert f"sets must be 1 to 6; got {sets}." in capsys.readouterr().err
    assert program.main([*base, *options]) == 1
    assert "captures must be a capture set; got " in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    assert adapters.main(["captured_camera", str(tmp_path / "camera"), *options]) == 1
    assert "captures must be a folder" in capsys.readouterr().err


def test_workers_end_with_a_killed_program(tmp_path):
    code = f"""
import functools, pathlib, time
from starling.diagnosis.validation.protocol import check, tier
run = check.Check(
    out=pathlib.Path({str(tmp_path / "run")!r}), tier=tier.TIERS[1], blender=pathlib.Path(), jobs=2
)
run._call([functools.partial(print, "begun", flush=True), functools.partial(time.sleep, 600)])
"""
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None and running.stdout.readline() == "begun\n"
        running.kill()
        running.communicate(timeout=60)  # Returns when no worker holds the pipe any more.


def test_an_interrupt_is_no_error(tmp_path, capsys, monkeypatch):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Check, "prepare", interrupted)
    assert program.main([str(tmp_path / "run")]) == program.INTERRUPTED
    assert capsys.readouterr().err == ""


def test_unexpected_errors_are_one_line(tmp_path, capsys, monkeypatch):
    (tmp_path / "file").touch()
    options = [str(tmp_path / "file" / "run"), "--jobs", "1"]
    assert program.main(options) == 1
    message = capsys.readouterr().err
    assert message.startswith("files must be readable and writable; got ")
    assert message.count("\n") == 1
    with pytest.raises(NotADirectoryError):
        program.main([*options, "--debug"])

    def broken(*_: object) -> None:
        raise ZeroDivisionError("once\nagain")

    monkeypatch.setattr(Check, "prepare", broken)
    assert program.main(options) == 1
    message = capsys.readouterr().err
    advice = "Run again with --debug and report the output."
    assert message == f"ZeroDivisionError: once again. {advice}\n"


def test_a_program_reports_progress_and_errors(tmp_path, capsys, monkeypatch):
    fake = tmp_path / "python"
    monkeypatch.setattr("sys.executable", str(fake))
    script = "#!/bin/sh\nprintf 'scenes 1/2\\na word\\nscenes 2/2\\n' >&2\n"
    fake.write_text(script)
    fake.chmod(0o755)
    programs.run("families", tmp_path / "set-3" / "families.json")
    assert capsys.readouterr().err == "set-3: scenes 1/2\nset-3: scenes 2/2\n"
    fake.write_text(f"{script}exit 4\n")
    with pytest.raises(WithheldError, match=r"families must succeed; got exit 4\. a word"):
        programs.run("families", tmp_path / "set-3" / "families.json")


def test_the_verb_runs_the_program_in_a_process(monkeypatch):
    commands = []

    class Completed:
        returncode = 3

    monkeypatch.setattr(
        "subprocess.run", lambda command, **_: commands.append(command) or Completed()
    )
    flags = ["--cases", "2", "--no-infrared", "--json", "--debug"]
    assert command_line.main(["withheld", "--out", "x", *flags]) == 3
    assert commands[0][1:4] == ["-m", "starling.diagnosis.validation", "x"]
    assert {*flags} <= {*commands[0]}
    values = ["--tier", "4", "--captures", "real", "--sensor", "d415", "--sets", "2"]
    assert command_line.main(["withheld", "--out", "x", *values]) == 3
    assert {*values} <= {*commands[1]}
    imperfect = ["--tier", "5", "--imperfect", "each", "--estimated", "--effects", "flicker"]
    assert command_line.main(["withheld", "--out", "x", *imperfect]) == 3
    assert {*imperfect} <= {*commands[2]}
    assert "--estimated" not in commands[1] and "--imperfect" not in commands[1]


def test_the_verb_has_all_plans():
    assert get_args(verbs.Imperfect) == plan.PLANS


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--imperfect", "each"], "imperfect must be given for tier 5 only; got each for tier 1."),
        (["--effects", "fog"], "effects must be rows of the catalogue; got fog."),
        (["--effects", "flicker", "--power"], "effects must be used without power; got both."),
        (["--effects", "flicker", "--tier", "3"], "effects must be used with a tier of known"),
        (["--estimated"], "estimated must be given for tier 5 only; got True for tier 1."),
        (
            ["--tier", "5", "--estimated", "--no-infrared"],
            "estimated scenes must have infrared; got none. Omit --no-infrared.",
        ),
    ],
)
def test_options_of_tier_five(tmp_path, capsys, options, message):
    assert program.main([str(tmp_path / "run"), *options]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_an_unknown_plan_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        program.main([str(tmp_path / "run"), "--tier", "5", "--imperfect", "fog"])
    assert "invalid choice: 'fog'" in capsys.readouterr().err
    with pytest.raises(WithheldError, match="imperfect must be one of"):
        Check(out=tmp_path, tier=TIERS[5], blender=tmp_path, imperfect="fog")
