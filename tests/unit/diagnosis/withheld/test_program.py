"""What the check's program refuses, and how the verb runs it."""

from __future__ import annotations

import starling
from diagnosis import captured_camera
from diagnosis.withheld import __main__ as program


def test_real_pairs_are_for_their_own_tier(tmp_path, capsys):
    base = [str(tmp_path / "run"), "--tier", "4"]
    assert program.main(base) == 1
    assert "captures and sensor must be given for tier 4" in capsys.readouterr().err
    asked = ["--captures", str(tmp_path / "none"), "--sensor", "d415"]
    assert program.main([*base[:1], *asked]) == 1
    assert "and for no other" in capsys.readouterr().err
    assert program.main([*base, *asked, "--no-infrared"]) == 1
    assert "must have infrared" in capsys.readouterr().err
    assert program.main([*base, *asked, "--power"]) == 1
    assert "power must be asked of tier 1; got tier 4." in capsys.readouterr().err
    assert program.main([str(tmp_path / "run"), "--power", "--cases", "0"]) == 1
    assert "cases must be >= 1; got 0" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    assert program.main([*base, *asked, "--jobs", "0"]) == 1
    assert "jobs must be >= 1; got 0" in capsys.readouterr().err
    for sets in ("0", "7"):
        assert program.main([*base, *asked, "--sets", sets]) == 1
        assert f"sets must be 1 to 6; got {sets}." in capsys.readouterr().err
    assert captured_camera.main([str(tmp_path / "camera"), *asked]) == 1
    assert "captures must be a folder" in capsys.readouterr().err


def test_the_verb_runs_the_program_elsewhere(monkeypatch):
    ran = []

    class Done:
        returncode = 3

    monkeypatch.setattr("subprocess.run", lambda command, **_: ran.append(command) or Done())
    assert starling.main(["withheld", "--out", "x", "--cases", "2", "--no-infrared", "--json"]) == 3
    assert ran[0][1:4] == ["-m", "diagnosis.withheld", "x"]
    assert {"--cases", "2", "--no-infrared", "--json"} <= {*ran[0]}
    given = ["--tier", "4", "--captures", "real", "--sensor", "d415", "--sets", "2"]
    assert starling.main(["withheld", "--out", "x", *given]) == 3
    assert {*given} <= {*ran[1]}
