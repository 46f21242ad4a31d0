"""Shapes fitted to points by orthogonal distances: plane, circle, sphere."""
