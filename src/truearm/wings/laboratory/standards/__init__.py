"""Tests of the standards: artefacts, test plans, test values with their uncertainty, the decision. Knows no model."""
