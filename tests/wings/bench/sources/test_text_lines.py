"""Text lines: patterns, scales, and what a hostile or broken line does to the samples after it (nothing)."""

import os
import socket
from itertools import islice
from math import pi, radians

import numpy as np
import pytest
from devices import samples_of, tcp_device
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.command_line import run
from truearm.errors import InputError
from truearm.wings.bench.sources import Notice, Sample, connections
from truearm.wings.bench.sources.connections import connected, connector
from truearm.wings.bench.sources.line_pattern import MOST_CHARACTERS, LinesDocument, line_parser, lines_of, text_lines

TWO = "pattern = '{J1},{J2}'\n"


def parsed(line: str, **keys):
    parse, _ = line_parser(LinesDocument(**keys))
    return parse(line, 7.0)


def degrees_of(sample: Sample):
    return np.degrees(sample.joint_angles_rad).tolist()


def test_numbers_are_found_by_their_names():
    sample = parsed(
        "*** E2: -4.5 deg, E1: +.5 deg, T 21.5 b 1 stop",
        pattern="*** E2:{J2} deg, E1:{J1} deg, T {temperature_degC} b {button} {rest}",
    )
    assert degrees_of(sample) == pytest.approx([0.5, -4.5], abs=1e-15)
    assert (sample.temperature_degC, sample.is_button_pressed, sample.time_s) == (21.5, True, 7.0)


@pytest.mark.parametrize("pattern", ["{skip}:{J1} {skip}:{J2}", "{skip}:{J1};{J2}{rest}", "E{skip} {J1}-{J2} {skip}"])
def test_fields_that_a_sign_separates_are_read(pattern):
    line = pattern.replace("{skip}", "a:").replace("{J1}", "1").replace("{J2}", "2").replace("{rest}", "...")
    assert degrees_of(parsed(line, pattern=pattern)) == pytest.approx([1, 2])


def test_the_time_of_the_device_and_further_columns():
    sample = parsed("12.5 1 2 0.75", pattern="{time_s} {J1} {J2} {load_1_Nm}")
    assert sample.time_s == 12.5
    assert dict(sample.columns) == {"load_1_Nm": 0.75}


def test_a_tracker_gives_points_without_joints():
    sample = parsed("P17; 1.5; -2; 3e2", pattern="P{skip}; {x_mm}; {y_mm}; {z_mm}")
    assert sample.joint_angles_rad.shape == (0,)
    assert sample.tip_in_reference_mm.tolist() == [1.5, -2.0, 300.0]


def test_counts_have_zero_sign_and_wrap_at_half_a_turn():
    keys = {
        "pattern": "{J1},{J2}",
        "unit": "counts",
        "counts_per_turn": 4096.0,
        "zero": (100.0, 4000.0),
        "sign": (1, -1),
    }
    sample = parsed("1124,928", **keys)
    assert sample.joint_angles_rad == pytest.approx([pi / 2, -pi / 2], abs=1e-12)


def test_joints_are_coupled_after_zero_and_sign():
    sample = parsed("10,20,30", pattern="{J1},{J2},{J3}", coupling="J3 += J2", sign=(1, -1, 1))
    assert degrees_of(sample) == pytest.approx([10, -20, 10], abs=1e-12)


@pytest.mark.parametrize("line", ["", "1", "1,2,3", "1,x", "nan,1", "1e300,2", "1,2 deg", "1_0,2", "\u0661,2", "1,,2"])
def test_a_line_that_does_not_fit_is_no_sample(line):
    assert parsed(line, pattern="{J1},{J2}") is None


def test_a_checksum_is_checked():
    keys = {"pattern": "$ARM,{J1},{J2}", "checksum": "nmea"}
    value = 0
    for character in "ARM,1,2":
        value ^= ord(character)
    assert degrees_of(parsed(f"$ARM,1,2*{value:02X}", **keys)) == pytest.approx([1, 2])
    assert parsed(f"$ARM,1,3*{value:02X}", **keys) is None
    assert parsed("$ARM,1,2", **keys) is None


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"pattern": "{J1},{J3}"}, "expected the joints J1, J2"),
        ({"pattern": "{J1},{J1}"}, "twice"),
        ({"pattern": "{J1},{x_mm}"}, "x_mm, y_mm and z_mm"),
        ({"pattern": "{elbow}"}, "unknown name in the pattern: {elbow}"),
        ({"pattern": "{skip}"}, "neither joints nor a point"),
        ({"pattern": "{J1}{J2}"}, "what separates {J1} from {J2} may belong to either"),
        ({"pattern": "{J1} . {J2}"}, "what separates {J1} from {J2}"),
        ({"pattern": "{skip}{J1}"}, "what separates {skip} from {J1}"),
        ({"pattern": "{skip}-{J1}"}, "what separates {skip} from {J1}"),
        ({"pattern": "{skip}:{skip}:{J1}"}, "two {skip} with neither a blank"),
        ({"pattern": "{skip} : {J1} : {skip}"}, "two {skip} with neither a blank"),
        ({"pattern": "{rest} {J1}"}, "{rest} is all that follows"),
        ({"pattern": "{J1} {rest};"}, "{rest} is all that follows"),
        ({"pattern": "{J1}", "unit": "counts"}, "counts_per_turn is missing"),
        ({"pattern": "{J1},{J2}", "zero": (1.0, 2.0, 3.0)}, "expected 2 entries of zero"),
        ({"pattern": "{J1},{J2}", "coupling": "J3 += J2"}, "the arm has the joints"),
    ],
)
def test_a_wrong_file_is_refused(keys, said):
    refuses(said.replace("{", r"\{"), line_parser, LinesDocument(**keys))


def test_a_wrong_unit_is_one_fault(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(TWO + "unit = 'grad'\nconnection = 'tcp:h:1'\n")
    refuses(r"unit\[1\]: expected 'deg', 'rad', 'counts' or 'mm', got 'grad'", text_lines, file)


def test_a_file_without_a_connection_is_refused(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(TWO)
    refuses(r"arm.toml: the key connection is missing", text_lines, file)
    for connection in ("tcp:9000", "tcp:host:x", "udp:70000", "http:host:80", "serial:"):
        refuses("expected a connection", text_lines, file, connection)


class Link:
    """A connection that gives what a test says, in the pieces that it says."""

    def __init__(self, pieces: list[bytes]) -> None:
        self.pieces = iter(pieces)

    def receive(self, timeout_s: float) -> bytes:
        try:
            return next(self.pieces)
        except StopIteration:
            raise EOFError from None


def read_all(pieces: list[bytes]) -> list[str | None]:
    found = []
    try:
        for line in lines_of(Link(pieces)):
            found.append(line)
    except EOFError:
        return found
    raise AssertionError


def test_a_line_of_digits_is_refused_at_once():
    """A number that could be split in two ways would take hours here."""
    joints = ",".join(f"{{J{joint}}}" for joint in range(1, 7))
    assert parsed(",".join(["1" * 160] * 6) + "x", pattern=joints) is None


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(1, 7), min_size=1, max_size=30), st.binary(max_size=40))
def test_however_the_bytes_are_torn_the_lines_are_the_same(cuts, garbage):
    content = garbage.replace(b"\n", b"").replace(b"\r", b"") + b"\n1,2\r\n3,4\n" * 3
    pieces, at = [], 0
    for cut in cuts:
        pieces.append(content[at : at + cut])
        at += cut
    lines = read_all([piece for piece in [*pieces, content[at:]] if piece])
    assert [line for line in lines if line in ("1,2", "3,4")][-6:] == ["1,2", "3,4"] * 3


def test_a_line_without_end_is_bounded_and_the_next_is_read():
    lines = read_all([b"x" * 5000, b"y" * 5000, b"z\n", b"1,2\n"])
    assert [len(line) for line in lines] == [MOST_CHARACTERS, 3]
    assert lines[-1] == "1,2"


def test_tcp_with_noise_a_torn_line_and_a_lost_connection(tmp_path, monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.01)
    file = tmp_path / "arm.toml"
    file.write_text(TWO)

    def first(client: socket.socket) -> None:
        client.sendall(b"2,3\n10,20\n\xff\x00\x1b[31m garbage\n11,2")

    def second(client: socket.socket) -> None:
        client.sendall(b"1\n12,22\n")

    with tcp_device(first, second) as port:
        samples, notices = samples_of(text_lines(file, f"tcp:127.0.0.1:{port}"), 3)
    assert [degrees_of(one) for one in samples] == [pytest.approx(want) for want in ([2, 3], [10, 20], [12, 22])]
    assert sum(text.startswith("connected to tcp:") for text in notices) == 2
    assert sum("the device closed the connection" in text for text in notices) == 1
    assert any(r"'\xff\x00\x1b[31m garbage'" in text for text in notices)


def test_a_device_that_is_not_there_is_said_and_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.01)
    file = tmp_path / "arm.toml"
    file.write_text(TWO)
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    said = list(islice(text_lines(file, f"tcp:127.0.0.1:{port}").samples(), 3))
    assert all("no connection to tcp:127.0.0.1" in one.text and "trying again" in one.text for one in said)


def test_a_first_look_without_a_sample_shows_the_line_beside_the_pattern_and_ends_with_one(tmp_path, capsys):
    file = tmp_path / "arm.toml"
    file.write_text(TWO)
    with tcp_device(lambda client: client.sendall(b"1;2\n")) as port, pytest.raises(SystemExit) as ended:
        run(["sources", "--try", f"lines:{file}@tcp:127.0.0.1:{port}", "--seconds", "1"])
    said = capsys.readouterr().out
    assert ended.value.code == 1
    assert "no sample arrived" in said
    assert "1 lines do not fit the pattern '{J1},{J2}', the last '1;2'" in said


def test_datagrams(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    file = tmp_path / "arm.toml"
    file.write_text(TWO + f"connection = 'udp:{port}'\n")
    samples = text_lines(file).samples()
    assert next(samples) == Notice(f"connected to udp:{port}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for line in (b"1,2", b"3,4\n"):
            sender.sendto(line, ("127.0.0.1", port))
    assert [degrees_of(next(samples)) for _ in range(2)] == [pytest.approx([1, 2]), pytest.approx([3, 4])]
    samples.close()


def test_standard_input_ends(tmp_path, monkeypatch):
    reading, writing = os.pipe()
    file = tmp_path / "arm.toml"
    file.write_text(TWO)
    os.write(writing, b"1,2\n3,4\n")
    os.close(writing)
    with os.fdopen(reading) as stream:
        monkeypatch.setattr("sys.stdin", stream)
        found = list(text_lines(file, "stdin").samples())
    assert [type(one) for one in found] == [Notice, Sample, Sample, Notice]
    assert found[-1].text == "the input has ended"


def test_a_serial_port_that_is_pulled_and_comes_back(tmp_path, monkeypatch):
    pytest.importorskip("serial", reason="pyserial is an extra: pip install 'truearm[live]'")
    if not hasattr(os, "openpty"):
        pytest.skip("this system has no pseudo terminals")
    monkeypatch.setattr(connections, "RETRY_S", 0.01)
    file, name = tmp_path / "arm.toml", tmp_path / "port"
    file.write_text(TWO)

    def plug_in() -> tuple[int, int]:
        ends = os.openpty()
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(ends[1]))
        return ends

    plugged, found = plug_in(), []
    lines = iter([b"\x00\x00,2\n1,2\n3,", b"5,6\n"])
    # What is written before the port is open, or not read before it is closed, is lost: each step waits for the last.
    for one in islice(text_lines(file, f"serial:{name}:19200").samples(), 100):
        if isinstance(one, Sample):
            found.append(one)
            for end in plugged:
                os.close(end)
            plugged = ()
            if len(found) == 2:
                break
        elif one.text.startswith("connected"):
            os.write(plugged[0], next(lines))
        elif "no connection" in one.text and not plugged:
            plugged = plug_in()
    assert [degrees_of(one) for one in found] == [pytest.approx([1, 2]), pytest.approx([5, 6])]


def test_pyserial_missing_says_what_to_install(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "serial", None)
    file = tmp_path / "arm.toml"
    file.write_text(TWO)
    refuses(r"truearm\[live\]", text_lines, file, "serial:COM3:9600")


def test_degrees_become_radians():
    assert parsed("90,-45", pattern="{J1},{J2}").joint_angles_rad == pytest.approx([pi / 2, radians(-45)])


def test_a_clock_of_seconds_since_1970_is_one():
    parse, _ = line_parser(LinesDocument(pattern="{time_s} {J1}"))
    assert parse("1795756800.25 10", 0.0).time_s == 1795756800.25


def test_a_name_that_no_host_can_have_is_refused():
    with pytest.raises(InputError, match="tcp:a..b:80 has no name that a host can have"):
        next(connected(connector("tcp:a..b:80"), "tcp:a..b:80", iter))
