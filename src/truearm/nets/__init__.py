"""Small networks and their training."""
