"""The description of the HTTP operations by the OpenAPI Specification 3.1, from the types of their messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import cleandoc
from typing import Any

from pydantic import BaseModel, TypeAdapter

from truearm import __version__
from truearm.live_server import messages


@dataclass(frozen=True)
class Operation:
    """What a client may ask for.

    Attributes
    ----------
    path, summary : str
    takes : type, optional
        Of the body of a POST; None: a GET.
    gives : type
    run : callable
        Answers what is asked; InputError where it cannot be.
    """

    path: str
    summary: str
    takes: type[BaseModel] | None
    gives: type
    run: Callable[..., Any]

    @property
    def method(self) -> str:
        """The method of HTTP."""
        return "GET" if self.takes is None else "POST"


def openapi(operations: Sequence[Operation]) -> dict[str, Any]:
    """The document, ready for JSON."""
    takes = {one.takes: TypeAdapter(one.takes) for one in operations if one.takes is not None}
    gives: dict[type, TypeAdapter[Any]] = {
        kind: TypeAdapter(kind) for kind in [*(one.gives for one in operations), messages.Refused]
    }
    inputs = [(kind, "validation", adapter) for kind, adapter in takes.items()]
    outputs = [(kind, "serialization", adapter) for kind, adapter in gives.items()]
    schemas, document = TypeAdapter.json_schemas(
        [*inputs, *outputs],  # type: ignore[list-item]
        ref_template="#/components/schemas/{model}",
    )
    named = {key[0]: schema for key, schema in schemas.items()}
    for name, schema in document["$defs"].items():  # units are in the descriptions of the classes
        described = [one for one in getattr(messages, name).__mro__ if one.__module__ == messages.__name__]
        schema["description"] = "\n\n".join(cleandoc(one.__doc__ or "") for one in described)

    def content(kind: type) -> dict[str, Any]:
        return {"description": cleandoc(kind.__doc__ or "").partition("\n")[0], "content": _json(named[kind])}

    paths = {
        one.path: {
            one.method.lower(): {
                "summary": one.summary,
                "operationId": one.path.strip("/"),
                **({"requestBody": {"required": True, **content(one.takes)}} if one.takes is not None else {}),
                "responses": {"200": content(one.gives), "default": content(messages.Refused)},
            }
        }
        for one in operations
    }
    return {
        "openapi": "3.1.0",
        "info": {"title": "truearm live", "version": __version__},
        "paths": paths,
        "components": {
            "schemas": document["$defs"],
            "securitySchemes": {"token": {"type": "apiKey", "in": "query", "name": "token"}},
        },
        "security": [{}, {"token": []}],
    }


def _json(schema: dict[str, Any]) -> dict[str, Any]:
    return {"application/json": {"schema": schema}}
