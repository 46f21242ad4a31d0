"""Which readings to take next: observability, selection of poses and of places for seats and bars."""
