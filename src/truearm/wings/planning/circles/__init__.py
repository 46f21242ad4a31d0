"""Axes of an arm without a drawing, from the circles that its joints describe one by one."""
