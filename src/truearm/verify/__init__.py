"""The standards' tests: shapes from points, uncertainty of the test value, the decision. It never sees a model."""
