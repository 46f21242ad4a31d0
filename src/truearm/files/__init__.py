"""Files: written whole or not at all; read with a bound on their size; CSV, TOML and XML with the place of a fault."""
