"""The laboratory's verbs, each with its command."""
