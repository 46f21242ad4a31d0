"""Published work, reproduced."""
