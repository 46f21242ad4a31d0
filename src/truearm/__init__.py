"""True coordinates from the joint angles of an articulated arm."""

__version__ = "0.1.0"
