"""Readings of a connected arm: taken, learned as they come, fitted meanwhile."""
