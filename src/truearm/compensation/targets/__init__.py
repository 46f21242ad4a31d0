"""Corrected joint targets: what to send to a controller so that the arm goes where it should."""
