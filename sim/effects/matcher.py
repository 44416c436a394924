"""Rows of the effect table: what acts on the matcher stage."""

from __future__ import annotations

from sim.effects.effect import Effect

ROWS: tuple[Effect, ...] = ()
