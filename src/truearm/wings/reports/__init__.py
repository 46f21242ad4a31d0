"""What people read of arms and models: reports, comparisons, the list of arms, the guide."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {"compare": ("ModelChange", "compare"), "report": ("ReportResult", "report")}
COMMANDS = {
    "arms": "commands:arms",
    "compare": "commands:compare",
    "report": "commands:report",
    "docs": "docs_command:docs",
}
