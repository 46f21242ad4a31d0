"""Verify: tests of an arm against its specification, and what its errors do to a measured feature."""
