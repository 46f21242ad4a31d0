"""Connected arms: recording, and the live page in a browser."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {
    "live_server.live": ("live",),
    "sources": ("Notice", "Sample", "Source", "StandstillRule", "open_source"),
    "recording.record_readings": ("record",),
    "recording.sources": ("SourceList", "SourceTrial", "list_sources", "try_source"),
}
COMMANDS = {"sources": "commands:sources", "record": "commands:record", "live": "commands:live"}
