"""Tables of other programs as readings: what their columns mean, and two of them joined."""
