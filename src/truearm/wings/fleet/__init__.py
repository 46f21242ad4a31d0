"""Many arms: their registry, their fits one by one or on many machines, and the state of each."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {"fleet": ("Fleet", "FleetRun"), "fleet_status": ("FleetStatus",), "type_prior": ("LearnedTypePrior",)}
COMMANDS = {"fleet": "fleet_command:fleet"}
