"""Shapes fitted to points by orthogonal distances: line, plane, circle, sphere, cylinder."""
