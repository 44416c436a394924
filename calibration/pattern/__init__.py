"""Recover the projector's pattern and emitters from captures."""
