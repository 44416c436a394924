"""The validation protocol: tiers, sealed cases, captures, verdicts and scores."""
