"""The HTTP operations beside the WebSocket: the tip now, tips at joint angles, corrected targets.

The OpenAPI Specification 3.1 describes them, from the types of their messages.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from http import HTTPStatus
from inspect import cleandoc
from typing import Any

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from truearm import __version__
from truearm.errors import InputError, TruearmError
from truearm.models import Compensator
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.bench.live_server import messages
from truearm.wings.bench.live_server.messages import (
    AtJoints,
    Correct,
    Corrected,
    CorrectedTarget,
    Pose,
    Predict,
    Predicted,
    Refused,
    Tip,
)
from truearm.wings.bench.live_server.request_checks import LARGEST_BODY, RequestRate
from truearm.wings.bench.recording.model_in_force import COVERAGE_FACTOR, CorrectedTip, corrected_tips
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.exports.correct import correct
from truearm.wings.exports.targets.targets import Targets


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


MOST_A_SECOND = 100  # requests of all clients
WAIT_S = 1.0  # for the one that is computed before
NO_MODEL = "no model is in force"
WHAT_TO_SEND = {
    HTTPStatus.FORBIDDEN: "expected the token of the address that truearm printed, and no Origin of another site",
    HTTPStatus.MISDIRECTED_REQUEST: "expected the host of the address that truearm printed",
    HTTPStatus.UNSUPPORTED_MEDIA_TYPE: "expected the header Content-Type: application/json",
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE: f"expected at most {LARGEST_BODY} bytes",
}


class HttpOperations:
    """The operations on a recording.

    Parameters
    ----------
    recording : Recording
    newest_pose : callable
        Returns the arm now; TruearmError where it sends no samples.
    """

    def __init__(self, recording: Recording, newest_pose: Callable[[], Pose]) -> None:
        self.operations: Sequence[Operation] = (
            Operation("/tip", "The arm now, with its corrected tip", None, Pose, newest_pose),
            Operation(
                "/predict", "The tip at joint angles", Predict, Predicted, lambda asked: predicted(recording, asked)
            ),
            Operation(
                "/correct", "Corrected joint targets", Correct, Corrected, lambda asked: corrected(recording, asked)
            ),
        )
        self._description = json.dumps(openapi(self.operations))
        self._rate, self._one = RequestRate(MOST_A_SECOND), threading.Lock()

    def answer(self, method: str, path: str, body: bytes = b"") -> tuple[HTTPStatus, str]:
        """The status and the JSON of the answer; whatever the body is, it is answered or refused."""
        if (method, path) == ("GET", "/openapi.json"):
            return HTTPStatus.OK, self._description
        found = [one for one in self.operations if one.path == path]
        operation = next((one for one in found if one.method == method), None)
        if operation is None:
            return refused(HTTPStatus.METHOD_NOT_ALLOWED if found else HTTPStatus.NOT_FOUND)
        if self._rate.is_exceeded():
            return refused(HTTPStatus.TOO_MANY_REQUESTS)
        is_computed = operation.takes is not None
        if is_computed and not self._one.acquire(timeout=WAIT_S):
            return refused(HTTPStatus.SERVICE_UNAVAILABLE)
        try:
            asked = () if operation.takes is None else (operation.takes.model_validate_json(body),)
            return HTTPStatus.OK, json.dumps(asdict(operation.run(*asked)), allow_nan=False)
        except ValidationError as error:
            fault = error.errors(include_url=False, include_input=False, include_context=False)[0]
            where = ".".join(map(str, fault["loc"]))
            return refused(HTTPStatus.BAD_REQUEST, f"{where}: {fault['msg']}" if where else fault["msg"])
        except InputError as error:
            return refused(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))
        except TruearmError as error:
            return refused(HTTPStatus.SERVICE_UNAVAILABLE, str(error))
        finally:
            if is_computed:
                self._one.release()


def refused(status: HTTPStatus, text: str = "") -> tuple[HTTPStatus, str]:
    """The status and the JSON of an answer that says what is wrong."""
    return status, json.dumps(asdict(Refused(text or WHAT_TO_SEND.get(status, status.phrase))))


def predicted(recording: Recording, asked: Predict) -> Predicted:
    """The tips at joint angles, by the nominal arm and by the model in force.

    Raises
    ------
    InputError
        If the arm has another number of joints.
    """
    angles, model = _angles(recording, asked), recording.model
    assert recording.arm is not None  # the page needs it, too
    tips: Sequence[CorrectedTip | None] = [None] * len(angles)
    not_corrected = NO_MODEL
    if model is not None:
        not_corrected, known = "", _loads(model, asked)
        temperature = None if asked.temperature_degC is None else np.full(len(angles), asked.temperature_degC)
        try:
            tips = corrected_tips(model, Session(angles, temperature_degC=temperature, columns=known))
        except InputError as error:
            not_corrected = error.problem
    nominal = recording.arm.forward(angles).tip_in_base.tolist()
    return Predicted(
        [
            Tip(
                tip_in_base_mm=at,
                corrected_mm=None if tip is None else tip.tip_in_reference_mm.tolist(),
                U_mm=None if tip is None else tip.U_mm.tolist(),
                not_corrected=not_corrected,
                outside_training=tip is not None and not tip.is_trained,
            )
            for at, tip in zip(nominal, tips, strict=True)
        ]
    )


def corrected(recording: Recording, asked: Correct) -> Corrected:
    """The corrected joint targets, as `truearm correct` computes them.

    Raises
    ------
    InputError
        If there is no model, or the targets are not those of its arm.
    """
    angles, model = _angles(recording, asked), recording.model
    if model is None:
        raise InputError(NO_MODEL, hint="truearm live --model-file MODEL, or refit")
    points = None if asked.points_mm is None else np.array(asked.points_mm)
    if points is not None and len(points) != len(angles):
        raise InputError(f"expected {len(angles)} points, one for each list of joints, got {len(points)}")
    targets = Targets(
        angles,
        points,
        temperature_degC=None if asked.temperature_degC is None else np.full(len(angles), asked.temperature_degC),
        loads=_loads(model, asked),
    )
    result = correct(model, targets, direction=asked.direction, frame=asked.frame, untrained=asked.untrained)
    done = result.correction
    U_mm = COVERAGE_FACTOR * np.sqrt(np.diagonal(done.covariances, axis1=1, axis2=2))
    joints = done.joints / _factors(recording)
    return Corrected(
        [
            CorrectedTarget(
                joints=None if reason else joints[row].tolist(),
                refused=reason,
                U_mm=None if reason else U_mm[row].tolist(),
                outside_training=bool(done.outside[row]),
            )
            for row, reason in enumerate(done.reasons)
        ]
    )


def _angles(recording: Recording, asked: AtJoints) -> FloatArray:
    """(n, n_joints) joint angles of a request [rad, or mm]."""
    factors = _factors(recording)
    for number, joints in enumerate(asked.joints, start=1):
        if len(joints) != len(factors):
            raise InputError(f"expected {len(factors)} joints, got {len(joints)} in list {number}")
    return np.array(asked.joints) * factors


def _factors(recording: Recording) -> FloatArray:
    """(n_joints,) What takes the numbers of a request to rad, or mm."""
    assert recording.arm is not None  # the page needs it, too
    return np.where(recording.arm.chain.is_prismatic, 1.0, np.radians(1.0))


def _loads(model: Compensator, asked: AtJoints) -> dict[str, Any]:
    """The loads of a request at each of its poses."""
    known = model.training_.columns
    if unknown := sorted(set(asked.loads) - set(known)):
        raise InputError(f"the model knows no load {unknown[0]:.40}; it knows {', '.join(known) or 'none'}")
    return {name: np.full(len(asked.joints), value) for name, value in asked.loads.items()}
