"""The projector's pattern and emitters, recovered from captures."""
