"""Self-contained HTML pages: rows, tables and figures of arrays."""
