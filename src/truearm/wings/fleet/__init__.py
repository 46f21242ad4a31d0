"""Many arms: their registry, their fits one by one or on many machines, and the state of each."""
