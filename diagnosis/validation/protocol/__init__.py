"""The validation protocol: cases, seals, tiers, verdicts and scores."""
