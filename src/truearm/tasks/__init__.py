"""Tasks measured by virtual arms: a standard's test, a feature of a part, and what the arm's errors do to the result."""
