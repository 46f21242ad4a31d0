"""Measurements simulated on virtual arms: what an arm's errors do to a standard's test or to a feature of a part."""
