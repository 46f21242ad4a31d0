"""`live`: readings of a connected arm, with a page that shows it: its events, and its pose 20 times a second."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Unpack

import jinja2
import numpy as np
from markupsafe import Markup

from truearm.arm import Arm
from truearm.errors import InputError, TruearmError
from truearm.models import Compensator
from truearm.models.identified_model import to_identified
from truearm.pages.drawings.arm_scene import arm_mechanism
from truearm.pages.palette import style_rules
from truearm.pages.scene import data_block, scene_script, script_hash
from truearm.printable_text import printable
from truearm.readings import Session
from truearm.readings.readings import DIRECTION
from truearm.typing import FloatArray
from truearm.verbs.record import to_plain
from truearm.wings.bench.live_server.http_operations import HttpOperations
from truearm.wings.bench.live_server.messages import Pose, ReadingPoint, Said, State
from truearm.wings.bench.live_server.request_checks import RequestChecks
from truearm.wings.bench.live_server.server import LiveServer
from truearm.wings.bench.recording.record_readings import follow
from truearm.wings.bench.recording.recording import Recording, RecordingOptions
from truearm.wings.bench.recording.reference_point import TYPED
from truearm.wings.bench.recording.session_log import Event
from truearm.wings.bench.sources import Source


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """The arm that the page draws.

    Attributes
    ----------
    arm : Arm
    is_identified : bool
        Whether it stands in the frame of the reference, not in its base.
    """

    arm: Arm
    is_identified: bool

    def pivots(self, angles_rad: FloatArray) -> list[float]:
        """The values of its pivots at joint angles (n_joints,) [deg, or mm of sliding joints]."""
        scale = np.where(self.arm.chain.is_prismatic, 1.0, np.degrees(1.0))
        values: list[float] = (self.arm.chain.joint_angles(angles_rad) * scale).tolist()
        return values

    def tips_mm(self, angles_rad: FloatArray) -> list[list[float]]:
        """Its tips at joint angles (n, n_joints) [mm]."""
        tips: list[list[float]] = self.arm.chain.tip_in_base(angles_rad).tolist()
        return tips


def drawn_arm(arm: Arm | None, model: Compensator | None) -> DrawnArm:
    """The arm that the page draws.

    Raises
    ------
    InputError
        If there is none, or nothing is known of its kinematics.
    """
    found = None if model is None else to_identified(model)
    if found is not None:
        return DrawnArm(replace(found.arm, chain=found.fit_.chain), is_identified=True)
    if arm is None:
        raise InputError("the page needs the arm", hint="--arm ARM, or --model-file MODEL")
    if not arm.has_kinematics:
        raise InputError(f"of arm {arm.name!r} only the joints are known", hint="truearm record takes its readings")
    return DrawnArm(arm, is_identified=False)


FULL_TURN_DEG = 180.0  # what the strip of a joint without limit spans, to each side


def live_page(recording: Recording, drawn: DrawnArm) -> str:
    """The page as one HTML document.

    Parameters
    ----------
    recording : Recording
    drawn : DrawnArm
    """
    arm, script = drawn.arm, scene_script(_text("live.mjs"))
    label = f"The arm {arm.name} in space as it moves, and the readings taken"
    scene = {"label": label, "unit": "mm", "points": None, **drawn_scene(drawn)}
    sheets = [style_rules(), *(files("truearm.pages").joinpath(name).read_text("utf-8") for name in _SHEETS)]
    page = _template().render(
        arm=arm,
        out=str(recording.out),
        source=recording.source.name,
        has_model_file=recording.out_model is not None,
        has_next=recording.plan is not None or recording.rank,
        can_steer=recording.source.steer is not None,
        is_typed=recording.reference == TYPED,
        joints=list(zip(arm.joint_labels, arm.joint_units, strict=True)),
        scene=Markup(data_block(scene)),  # noqa: S704, every sign of markup in it is an escape
        settings=Markup(data_block(_settings(recording, drawn))),  # noqa: S704
        style=Markup("".join([*sheets, _text("live.css")])),  # noqa: S704, our own files
        script=Markup(script),  # noqa: S704, our own files
        script_hash=Markup(script_hash(script)),  # noqa: S704
    )
    return printable(page)


_SHEETS = ("page.css", "scene.css")


def drawn_scene(drawn: DrawnArm) -> dict[str, object]:
    """The arm as data of a scene."""
    mechanism = arm_mechanism(drawn.arm, from_origin=not drawn.is_identified)
    return {"mechanism": mechanism.to_json("mm"), "lines": [], "is_identified": drawn.is_identified}


def _settings(recording: Recording, drawn: DrawnArm) -> dict[str, object]:
    """What the script of the page must know of the recording."""
    return {
        "spans": _spans(drawn),
        "takes_by_itself": recording.on == "still",
        "n_poses": None if recording.plan is None else len(recording.plan),
        "arm": recording.arm_given or "ARM",
    }


def _spans(drawn: DrawnArm) -> list[list[float]]:
    """The ends of each joint's strip [deg, or mm of sliding joints]."""
    arm = drawn.arm
    slides = arm.chain.is_prismatic
    ends = arm.limits * np.where(slides, 1.0, np.degrees(1.0))[:, None]
    widest = np.where(slides, arm.chain.reach, FULL_TURN_DEG)[:, None] * [-1.0, 1.0]
    spans: list[list[float]] = np.where(np.isfinite(ends), ends, widest).tolist()
    return spans


def _text(name: str) -> str:
    return files("truearm.wings.bench.live_server").joinpath(name).read_text("utf-8")


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_text("live.html.j2"))


FRAMES_HZ = 20.0
SILENT_S = 1.0
MOST_EVENTS = 50  # that a page shows that has just come


class LiveRecording:
    """What the page is sent of a recording.

    Parameters
    ----------
    recording : Recording
        With an arm, and with `FRAMES_HZ` samples a second.
    drawn : DrawnArm
    """

    def __init__(self, recording: Recording, drawn: DrawnArm) -> None:
        self.recording, self._drawn, self._scene = recording, drawn, drawn_scene(drawn)
        self._readings: list[ReadingPoint] = []
        self._last: dict[str, Said] = {}  # of the kinds of which the page shows the newest
        self._uncertainties_mm: list[tuple[int, float]] = []
        self._events: deque[Said] = deque(maxlen=MOST_EVENTS)
        self._files = {"session": str(recording.out)}
        if recording.plan_file is not None:
            self._files["plan"] = str(recording.plan_file)
        self._ended, self._sent_s = "", -np.inf
        self._newest: Pose | None = None

    def follow(self, server: LiveServer) -> Iterator[Event]:
        """Send the events of the recording, and do what the page asks for; the events but the samples."""
        try:
            for event in follow(self.recording, server.commands()):
                if event.kind != "sample":
                    self._send(server, event)
                    yield event
                elif time.monotonic() - self._sent_s > 0.5 / FRAMES_HZ:  # a replay may run faster than its clock
                    self._newest = self._pose(event)
                    self._sent_s = time.monotonic()  # after the pose: another thread judges by it how old that is
                    server.send_newest(self._newest)
        finally:
            if not self._ended:  # by Ctrl-C, or a fault
                self._send(server, self.recording.end())

    def _send(self, server: LiveServer, event: Event) -> None:
        said = self._said(event)
        state = State(
            self._scene,
            tuple(self._readings),
            self._last.get("learned"),
            self._last.get("next"),
            self._last.get("model"),
            tuple(self._uncertainties_mm),
            tuple(self._events),
            dict(self._files),
            self._ended,
        )
        server.send(said, state)
        if event.kind == "model":
            server.send(state, state)

    def newest_pose(self) -> Pose:
        """The arm now.

        Raises
        ------
        TruearmError
            If it sends no samples.
        """
        if self._newest is None or time.monotonic() - self._sent_s > SILENT_S:
            raise TruearmError("the arm sends no samples")
        return self._newest

    def _said(self, event: Event) -> Said:
        said = Said(event.to_dict())
        if event.kind == "ready":
            self._readings = self._points(self.recording.rows)
        elif event.kind == "reading":
            (reading,) = self._points(self.recording.rows[-1:])
            said = Said(said.event, reading)
            self._readings.append(reading)
        elif event.kind == "undone":
            self._readings.pop()
        elif event.kind == "model":
            self._drawn = drawn_arm(self.recording.arm, self.recording.model)
            self._scene = drawn_scene(self._drawn)
            self._readings = self._points(self.recording.rows)
        elif event.kind == "learned":
            n = len(self._readings)
            before = [one for one in self._uncertainties_mm if one[0] < n]
            self._uncertainties_mm = [*before, (n, event.values["after_mm"])]
        elif event.kind == "next":
            aim_rad = self.recording.aim_rad
            said = Said(said.event, aim_pivots=None if aim_rad is None else self._drawn.pivots(aim_rad))
        elif event.kind == "end":
            self._ended = event.text
        elif event.values.get("file") == str(self.recording.out_model):
            self._files["model"] = event.values["file"]
        self._last[event.kind] = said
        if event.kind not in ("learned", "next"):
            self._events.append(Said(said.event))
        return said

    def _pose(self, event: Event) -> Pose:
        recording, sample, values = self.recording, self.recording.sample, event.values
        arm = recording.arm
        assert sample is not None  # the event is of one
        assert arm is not None
        return Pose(
            joints=recording.displayed(sample.joint_angles_rad),
            pivots=self._drawn.pivots(sample.joint_angles_rad),
            tip_in_base_mm=arm.chain.tip_in_base(sample.joint_angles_rad[None])[0].tolist(),
            corrected_mm=to_plain(values.get("corrected_mm")),
            U_mm=to_plain(values.get("U_mm")),
            not_corrected=values.get("not_corrected", ""),
            outside_training=not values.get("is_trained", True),
            is_still=recording.is_still,
            is_fitting=recording.is_fitting,
            to_go=recording.to_go(),
            temperature_degC=sample.temperature_degC,
        )

    def _points(self, rows: Sequence[Mapping[str, str]]) -> list[ReadingPoint]:
        """Rows of the session file as the page draws them."""
        joints = _numbers(rows, self.recording.joint_columns)
        angles = joints * self.recording.factors
        return [*map(ReadingPoint, self._drawn.tips_mm(angles), joints.tolist(), self._residuals_mm(rows, angles))]

    def _residuals_mm(self, rows: Sequence[Mapping[str, str]], angles: FloatArray) -> list[float | None]:
        """Distance of each measured point from the model's; None without a model or a point."""
        model, found = self.recording.model, list[float | None]([None] * len(rows))
        seen = [number for number, row in enumerate(rows) if row.get("x_mm")]
        if model is None or not seen:
            return found
        rows = [rows[number] for number in seen]
        stated = {
            name: _numbers(rows, [name])[:, 0]
            for name in (*model.training_.columns, "temperature_degC")
            if all(row.get(name) for row in rows)
        }
        temperature = stated.pop("temperature_degC", None)
        directions = _numbers(rows, [f"{DIRECTION}{joint}" for joint in range(1, angles.shape[1] + 1)])
        with suppress(InputError):
            readings = Session(angles[seen], temperature_degC=temperature, directions=directions, columns=stated)
            away = model.predict_readings(model.checked(readings)) - _numbers(rows, ["x_mm", "y_mm", "z_mm"])
            for number, distance_mm in zip(seen, np.linalg.norm(away, axis=1).tolist(), strict=True):
                found[number] = distance_mm
        return found


def _numbers(rows: Sequence[Mapping[str, str]], columns: Sequence[str]) -> FloatArray:
    """(n, n_columns) cells of rows."""
    return np.array([[float(row[name]) for name in columns] for row in rows]).reshape(-1, len(columns))


def live(
    source: str | Source,
    out: str | Path,
    *,
    host: str = "127.0.0.1",
    port: int = 8640,
    token: str = "",
    **options: Unpack[RecordingOptions],
) -> Iterator[Event]:
    """Take readings of a connected arm as `record` does, and show it on a page that a browser opens.

    Other programs read the WebSocket and the HTTP operations of the same address (docs/live.md). Readings are taken,
    and the page is served, while the events are iterated over.

    Parameters
    ----------
    source, out
        As of `record`.
    host : str
        Address to listen on; one that other computers reach needs a token.
    port : int
        Port to listen on; 0: a free one.
    token : str
        Whoever opens the page must know it; at least 16 characters.
    arm, plan, reference, rule, on, seat, model, rank, out_model : optional
        As of `record`; the page needs `arm` or `model`.

    Yields
    ------
    Event
        Those of `record`. The first has the address of the page, ``event.values["url"]``.

    Raises
    ------
    InputError
        If the source, the plan or the file cannot be used, there is no arm, an address that other computers reach has
        no token, or the package websockets is missing.
    TruearmError
        If the port cannot be opened, or a reading cannot be written.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.simulate("ur10", poses=3, seed=1).session.save("simulated.csv")
    >>> events = ta.live("replay:simulated.csv@max", "session.csv", arm="ur10", port=0)
    >>> next(events).values["url"]
    'http://127.0.0.1:.../'
    >>> [event.kind for event in events]
    ['ready', 'reading', 'reading', 'learned', 'reading', 'learned', 'notice', 'end']
    """
    return serve(Recording(source, out, samples_hz=FRAMES_HZ, **options), RequestChecks(host, token), port)


def serve(recording: Recording, checks: RequestChecks, port: int) -> Iterator[Event]:
    """The events of a recording with `FRAMES_HZ` samples a second, while its page is served; see `live`."""
    drawn = drawn_arm(recording.arm, recording.model)
    shown = LiveRecording(recording, drawn)
    operations = HttpOperations(recording, shown.newest_pose)
    with LiveServer(live_page(recording, drawn), checks, port, operations) as server:
        yield Event("notice", f"Open {server.url} in a browser; Ctrl-C ends.", {"url": server.url})
        yield from shown.follow(server)
