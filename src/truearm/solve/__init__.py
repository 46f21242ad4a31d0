"""Nonlinear least squares and evidence, assembled from parts; independent of arms and networks."""
