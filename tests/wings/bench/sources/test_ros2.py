"""ROS 2: joint states by DDS from a writer in the same process, on the loopback interface alone."""

import os
import threading
from contextlib import contextmanager
from itertools import count, islice

import numpy as np
import pytest
from devices import samples_of

from refusals import refuses
from truearm.wings.bench.sources import Sample, open_source
from truearm.wings.bench.sources.ros2 import joint_state

DOMAIN = 100 + os.getpid() % 100  # of each run of the tests one of its own
FILE = f"""joints = ["pan", "lift", "elbow"]
domain = {DOMAIN}
"""


@pytest.fixture(scope="module", autouse=True)
def loopback():
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
    interfaces = "<Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("CYCLONEDDS_URI", f"<CycloneDDS><Domain><General>{interfaces}</General></Domain></CycloneDDS>")
        yield


@contextmanager
def node(*messages, is_frozen=False):
    """A node that publishes these names and positions, again and again."""
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic

    kind = joint_state()
    header = kind.__annotations__["header"]
    stamp = header.__annotations__["stamp"]
    participant = DomainParticipant(DOMAIN)
    writer = DataWriter(participant, Topic(participant, "rt/joint_states", kind))
    ends = threading.Event()

    def write():
        for number in count():
            if ends.wait(0.01):
                return
            for names, positions in messages:
                at = stamp(1, 2 if is_frozen else 1000 * number)
                writer.write(kind(header(at, ""), names, positions, [], []))

    thread = threading.Thread(target=write)
    thread.start()
    try:
        yield
    finally:
        ends.set()
        thread.join()


def source(tmp_path, more=""):
    file = tmp_path / "ros2.toml"
    file.write_text(FILE + more)
    return open_source(f"ros2:{file}")


def test_joints_are_found_by_name_in_any_order(tmp_path):
    with node((["elbow", "gripper", "lift", "pan"], [0.3, 9.0, 0.2, 0.1])):
        samples, notices = samples_of(source(tmp_path), 3)
    assert [sample.joint_angles_rad.tolist() for sample in samples] == [[0.1, 0.2, 0.3]] * 3
    assert notices[0] == "connected to topic /joint_states of ROS 2"


def test_metres_of_a_sliding_joint_are_millimetres(tmp_path):
    opened = source(tmp_path, 'unit = ["rad", "mm", "rad"]\n')
    with node((["pan", "lift", "elbow"], [0.1, 0.25, 0.3])):
        (sample,), _ = samples_of(opened, 1)
    assert sample.joint_angles_rad == pytest.approx([0.1, 250.0, 0.3])
    assert opened.prismatic == (2,)


def test_messages_of_others_are_said_and_are_no_sample(tmp_path):
    names = ["pan", "lift", "elbow"]
    others = (["gripper"], [1.0]), (names, [0.1, 0.2]), (names, [np.nan, 0, 0]), (names, [1e300, 0, 0])
    with node(*others, (names, [0.1, 0.2, 0.3])):
        samples, notices = samples_of(source(tmp_path), 4)
    assert all(sample.joint_angles_rad.tolist() == [0.1, 0.2, 0.3] for sample in samples)
    assert any("messages lack a joint of pan, lift, elbow" in text for text in notices), notices


def test_a_node_whose_clock_stands_still_is_said_and_gives_no_samples(tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.wings.bench.sources.sample.SILENT_S", 0.05)
    with node((["pan", "lift", "elbow"], [0.1, 0.2, 0.3]), is_frozen=True):
        heard = list(islice(source(tmp_path).samples(), 5))
    assert [isinstance(one, Sample) for one in heard].count(True) == 1
    assert "the device repeats a message" in str(heard[-1])


def test_a_topic_without_messages_is_said(tmp_path):
    stream = source(tmp_path).samples()
    assert "connected to" in next(stream).text
    assert next(stream).text == "nothing was received for a second"


def test_a_name_twice_is_refused(tmp_path):
    file = tmp_path / "ros2.toml"
    file.write_text('joints = ["pan", "pan"]\n')
    refuses("a name is twice in joints", open_source, f"ros2:{file}")
