"""Figures and scenes of an arm, its readings and its errors, and records with a page."""
