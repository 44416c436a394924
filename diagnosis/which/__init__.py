"""Which effects made a gap: simulated, fitted and judged on scenes that had no say."""
