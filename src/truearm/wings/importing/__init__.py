"""Tables and logs of other programs as readings, and published data sets."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {"foreign": ("import_table",), "fetch": ("PublishedReadings", "fetch")}
MODULES = ("datasets",)  # public as it stands
COMMANDS = {"import": "commands:import_table", "fetch": "commands:fetch"}
