"""The verbs of the core, one module each: a function, the record it returns, and beside it its command."""
