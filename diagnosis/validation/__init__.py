"""Validation of the diagnosis with effects that a second, independent camera model applies.

`camera` implements the documented effects again, with its own formulas. `protocol` draws cases,
seals the truth and scores the verdicts. Both import nothing of the simulator but the capture reader
(`starling.sim.captures.capture`); a test enforces this. `adapters` connects them to the simulator.
"""
