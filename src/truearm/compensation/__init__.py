"""Compensate: models that turn joint angles into true coordinates."""
