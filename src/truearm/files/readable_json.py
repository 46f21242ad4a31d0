"""JSON that a person reads: what fits a line stands on it."""

from __future__ import annotations

import json

# A term of a model with its basis fits.
LINE_WIDTH = 320


def readable_json(value: object, indent: int = 1) -> str:
    """JSON of plain data: a list of numbers, and what is not longer than `LINE_WIDTH`, is one line.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    text = json.dumps(value, allow_nan=False)
    space = " " * indent
    if isinstance(value, dict) and len(text) > LINE_WIDTH:
        entries = [f"{space}{json.dumps(key)}: {readable_json(one, indent + 1)}" for key, one in value.items()]
    elif isinstance(value, list) and len(text) > LINE_WIDTH and any(isinstance(one, dict | list) for one in value):
        entries = [f"{space}{readable_json(one, indent + 1)}" for one in value]
    else:
        return text
    opening, closing = text[0], text[-1]
    return f"{opening}\n" + ",\n".join(entries) + f"\n{space[:-1]}{closing}"
