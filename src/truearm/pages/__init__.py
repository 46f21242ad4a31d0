"""One self-contained page to show: rows, tables and figures of arrays; it asks for no model and for no arm."""
