"""The founding paper (Gao et al., Complexity 2017, 5156264) reproduced: its experiment, tables, figures and claims."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {"reproduce": ("ProcedureResult", "ReproductionResult", "reproduce")}
COMMANDS = {"demo": "commands:demo", "reproduce": "commands:reproduce"}
