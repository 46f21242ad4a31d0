"""Interim checks between verifications: control charts and the history of an arm."""
