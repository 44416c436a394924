"""The bench prints its documented keys. Its figures are measured manually on a quiet machine."""

import json
import subprocess
import sys

import numpy as np
import pytest

# It runs in a separate process, because peak memory is measured per process.
BENCH = (
    "import json; from starling.sim.commands.bench import bench; "
    "print(json.dumps(bench(repeats=1, samples=1)))"
)

PEAK = "from starling.sim.commands.bench import peak_gib; print(peak_gib())"


def test_peak_memory_is_not_inherited():
    held = np.ones(2**29, np.uint8)  # What starts it counts for nothing.
    ran = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True)
    assert 0.05 < float(ran.stdout) < held.size / 2**30


@pytest.mark.long
def test_bench_prints_its_keys():
    ran = subprocess.run([sys.executable, "-c", BENCH], capture_output=True, text=True, check=True)
    figures = json.loads(ran.stdout)
    assert {
        "pipeline_s",
        "floor_s",
        "ratio",
        "ratio_d4xx",
        "second_frame_ratio",
        "indirect_s",
        "effects_ms",
        "peak_gib",
        "variant",
        "size",
    } <= figures.keys()
    assert {"preset's own", "all on"} <= figures["effects_ms"].keys()
    assert figures["peak_gib"] <= 2.0
    assert figures["ratio"] == pytest.approx(figures["pipeline_s"] / figures["floor_s"])
