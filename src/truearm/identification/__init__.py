"""Identify: the small motions that make a real arm differ from its drawing, their sizes, and what to measure next."""
