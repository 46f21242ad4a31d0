"""A model for other programs: files of constants, source code, corrected targets."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {
    "correct": ("CorrectedTargets", "correct"),
    "programs.correct_program": ("CorrectedProgram", "correct_program"),
    "export": ("ExportCheck", "ExportResult", "check_export", "export"),
}
COMMANDS = {"correct": "commands:correct", "export": "commands:export"}
