"""Kinematics yaml of UR robots: read as ROS reads it, written without loss, and what its angles are."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.arm import chain_from_dh
from truearm.arm.kinematics_yaml import JOINTS, LINKS, read_ur_kinematics, ur_hash
from truearm.arm.rigid_motions import screw_x, screw_z
from truearm.files.foreign_documents import MAX_DEPTH, parse_yaml
from truearm.wings.exports.formats.joint_offsets import yaml_number
from truearm.wings.exports.formats.ur_kinematics import ur_kinematics_text

# A UR5e, as its driver wrote it (published numbers, brenhertel/pearl_ur5e).
UR5E = """kinematics:
  shoulder: {x: 0, y: 0, z: 0.1625928926388782, roll: -0, pitch: 0, yaw: 1.407490463761762e-08}
  upper_arm: {x: 0.0001633290396847193, y: 0, z: 0, roll: 1.569833151515029, pitch: 0, yaw: 4.203263495390265e-07}
  forearm: {x: -0.4252705043763538, y: 0, z: 0, roll: 3.141497389144542, pitch: 3.139582033751201,
            yaw: 1.641719776884571e-06}
  wrist_1: {x: -0.3922414056765892, y: -0.0001705522549675483, z: 0.1337413269734199, roll: 0.001275239048202155,
            pitch: 0.0003483795394872059, yaw: 3.141586848241971}
  wrist_2: {x: 0.0001101580205668968, y: -0.09972935098219038, z: 3.838706238979488e-05, roll: 1.570411414428417,
            pitch: 0, yaw: -2.991625835183087e-07}
  wrist_3: {x: 4.849124201112296e-05, y: 0.09971341949426617, z: 8.102912491381861e-05, roll: 1.57160894667584,
            pitch: 3.141592653589793, yaw: 3.141592598887769}
  hash: calib_1282784419969490140
"""

# D-H constants that the controller of a UR5 reported, and the first links of the file made from them
# (Universal_Robots_ROS_Driver, issue 457).
UR5_THETA = [-9.62699668632896e-06, -1.43707039992005, 2.02543119975016]
UR5_THETA += [-0.588254688694989, 4.13647390228702e-05, 8.1737464953645e-06]
UR5_A = [0.000279332356195598, -0.0566854832098269, -0.32646702272051, 1.49388687216263e-05, 2.23692592990586e-07, 0]
UR5_D = [0.0888794492754001, 574.241384579456, -507.363402098168]
UR5_D += [-66.7676839353205, 0.0949734691141216, 0.0825625014554953]
UR5_ALPHA = [1.57033858830411, -0.000733893428160216, 0.00325607356326439, 1.57040005185553, -1.57101000328584, 0]
UR5_UPPER_ARM_YAW = 2.1588e-05  # as far as it is printed there


def written(tmp_path, text, name="robot.yaml"):
    path = tmp_path / name
    path.write_text(text) if isinstance(text, str) else path.write_bytes(text)
    return path


def poses(seed=0, n=200):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (n, 6))


def assert_same_poses(one, other):
    """1e-9 m and rad: a millionth of what the robot repeats to."""
    first, second = one.chain.pose(poses()), other.chain.pose(poses())
    np.testing.assert_allclose(first.tip_in_base, second.tip_in_base, atol=1e-6, rtol=0)  # mm
    np.testing.assert_allclose(first.R_base_tip, second.R_base_tip, atol=1e-9, rtol=0)


def test_the_file_is_an_arm_by_its_name(tmp_path):
    arm = ta.load_arm(written(tmp_path, UR5E, "lab.yaml"))
    assert arm.name == "lab"
    assert arm.joint_names == JOINTS
    np.testing.assert_array_equal(arm.limits, np.tile([-2 * np.pi, 2 * np.pi], (6, 1)))
    assert ur_hash(arm) == "calib_1282784419969490140"
    assert ta.load_arm(str(written(tmp_path, UR5E, "lab.yml"))).n_joints == 6
    # This file has the half turn of older tools: at zero its forearm lies back along the upper arm, 425 less 392 mm.
    assert arm.title.endswith("folded at the elbow where a UR's zero is stretched")
    np.testing.assert_allclose(arm.chain.tip_in_base(np.zeros((1, 6)))[0], [-33, -234, 63], atol=1)


def test_constants_that_the_controller_reports_are_an_arm_by_their_table():
    # The controller's own table has axes 574 m from the arm; the file made from it has none, and is the same arm.
    a, d = 1000 * np.array(UR5_A), 1000 * np.array(UR5_D)
    table = chain_from_dh(a=a, d=d, alpha=UR5_ALPHA, theta=UR5_THETA)
    np.testing.assert_allclose(table.tip_in_base(np.zeros((1, 6)))[0], [-817, -193, -7], atol=1)


def test_a_file_of_reported_constants_is_stretched_at_zero(tmp_path):
    links, last = links_of_dh(UR5_THETA, UR5_D, UR5_A, UR5_ALPHA)
    for link in links:
        link[:3, 3] *= 1000
    path = written(tmp_path, ur_kinematics_text(links, "calib_11914550710326326731"))
    arm = ta.load_arm(path)
    assert "folded" not in arm.title
    a, d = 1000 * np.array(UR5_A), 1000 * np.array(UR5_D)
    table = chain_from_dh(a=a, d=d, alpha=UR5_ALPHA, theta=UR5_THETA)
    np.testing.assert_allclose(arm.chain.tip_in_base(poses()), table.tip_in_base(poses()), atol=1e-6, rtol=0)  # mm
    np.testing.assert_allclose(last, np.eye(4), atol=1e-15)


def test_links_are_read_as_a_urdf_reads_them(tmp_path):
    arm = read_ur_kinematics(written(tmp_path, UR5E))
    roll, pitch, yaw = 0.001275239048202155, 0.0003483795394872059, 3.141586848241971
    expected = Rotation.from_euler("z", yaw) * Rotation.from_euler("y", pitch) * Rotation.from_euler("x", roll)
    np.testing.assert_allclose(arm.chain.fixed[3, :3, :3], expected.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(arm.chain.fixed[3, :3, 3], [-392.2414056765892, -0.1705522549675483, 133.7413269734199])
    np.testing.assert_array_equal(arm.chain.fixed[6], np.eye(4))


@pytest.mark.parametrize("angles", ["urdf", "controller"])
def test_what_is_written_reads_back(tmp_path, angles):
    arm = read_ur_kinematics(written(tmp_path, UR5E), angles=angles)
    text = ur_kinematics_text(arm.chain.fixed[:6], "calib_1282784419969490140")
    again = ta.load_arm(written(tmp_path, text, "again.yaml"))
    assert_same_poses(arm, again)
    assert ur_hash(again) == ur_hash(arm)


@pytest.mark.parametrize("name", ["ur3e", "ur5e", "ur10e"])
def test_real_files_come_back_as_they_went_in(tmp_path, name):
    source = Path(os.environ.get("TRUEARM_DATA", "")) / "ur_factory" / f"{name}.yaml"
    if not source.is_file():
        pytest.skip("needs the published UR files")
    arm = ta.load_arm(source)
    again = ta.load_arm(written(tmp_path, ur_kinematics_text(arm.chain.fixed[:6], ur_hash(arm))))
    assert_same_poses(arm, again)


def test_a_zero_with_a_sign_and_half_turns_in_any_branch_are_the_same_arm(tmp_path):
    arm = read_ur_kinematics(written(tmp_path, UR5E))
    # (pi, pi, -pi) is nearly the identity; a turn more is none.
    other = UR5E.replace("roll: -0,", "roll: 0.0,").replace(
        "roll: 3.141497389144542, pitch: 3.139582033751201,\n            yaw: 1.641719776884571e-06",
        f"roll: {3.141497389144542 - np.pi!r}, pitch: {np.pi - 3.139582033751201!r},\n"
        f"            yaw: {1.641719776884571e-06 - np.pi!r}",
    )
    assert other != UR5E
    assert_same_poses(arm, read_ur_kinematics(written(tmp_path, other, "other.yaml")))


# What the angles are: the constants from which the files were made are D-H, and a D-H chain has laws.


def dh_pose(theta, d, a, alpha, q):
    T = np.eye(4)
    for row in zip(q + theta, d, a, alpha, strict=True):
        T = T @ screw_z(row[0], row[1]) @ screw_x(row[3], row[2])
    return T


def links_of_dh(theta, d, a, alpha):
    """(links, last) of a D-H table as the driver's tool lays them out: poses of the six links and what follows [m].

    D-H offsets of hundreds of metres between axes 2, 3 and 4 cancel. The frames of links 2 and 3 slide back along their
    axes, to where the next axis crosses their own xy plane, and their x points away from the next link.
    """
    own = [screw_z(t, one) for t, one in zip(theta, d, strict=True)]
    across = [screw_x(t, one) for t, one in zip(alpha, a, strict=True)]
    for i in (1, 2):
        across[i] = own[i] @ across[i]
        along = across[i][:3, 2]
        slide = across[i][2, 3] / along[2]
        x, y, _ = across[i][:3, 3] - slide * along
        turn = np.arctan(y / x)
        own[i], across[i] = screw_z(turn, 0.0), screw_z(-turn, 0.0) @ across[i] @ screw_z(0.0, -slide)
        own[i + 1] = screw_z(0.0, slide) @ own[i + 1]
    return [own[0], *(across[i] @ own[i + 1] for i in range(5))], across[5]


def tool(links, last, q):
    T = np.eye(4)
    for link, angle in zip(links, q, strict=True):
        T = T @ link @ screw_z(angle, 0.0)
    return T @ last


def test_a_file_made_from_reported_constants_is_the_published_one_in_the_controllers_reading():
    links, last = links_of_dh(UR5_THETA, UR5_D, UR5_A, UR5_ALPHA)
    split = [Rotation.from_matrix(link[:3, :3]).as_euler("XYZ") for link in links]  # Rx(roll) Ry(pitch) Rz(yaw)
    # The published beginning of the file: z and yaw of the shoulder; x, roll, pitch and yaw of the upper arm.
    assert links[0][2, 3] == pytest.approx(0.08887944927540013, abs=1e-16)
    assert split[0][2] == pytest.approx(-9.626996686328957e-06, abs=1e-20)
    assert links[1][0, 3] == pytest.approx(0.0002793323561955981, abs=1e-18)
    np.testing.assert_allclose(split[1], [1.570338588304109, 0.0, UR5_UPPER_ARM_YAW], atol=5e-10, rtol=0)
    # The other split has a pitch there, which the file has not.
    assert abs(Rotation.from_matrix(links[1][:3, :3]).as_euler("xyz")[1]) > 2e-5
    far = {"XYZ": [], "xyz": []}
    for q in poses(n=50):
        controller = dh_pose(UR5_THETA, UR5_D, UR5_A, UR5_ALPHA, q)
        for order, found in far.items():
            read = [link.copy() for link in links]
            for link, angles in zip(read, split, strict=True):
                link[:3, :3] = Rotation.from_euler(order, angles).as_matrix()
            found.append(np.linalg.norm((tool(read, last, q) - controller)[:3, 3]))
    assert max(far["XYZ"]) < 1e-11  # m: rounding of 574 m
    assert 1e-5 < max(far["xyz"]) < 5e-5  # m: 0.03 mm of this robot, whose wrist has no half turns


@pytest.mark.parametrize("link", ["upper_arm", "wrist_1", "wrist_2", "wrist_3"])
def test_in_the_controllers_reading_offsets_are_along_the_axes_of_their_joints(tmp_path, link):
    # A D-H link moves along its parent's x by a, then along its own joint's axis by d: nothing is left over.
    left = {}
    for angles in ("urdf", "controller"):
        frame = read_ur_kinematics(written(tmp_path, UR5E), angles=angles).chain.fixed[LINKS.index(link)]
        left[angles] = abs(frame[1, 3] * frame[2, 2] - frame[2, 3] * frame[1, 2])
    assert left["controller"] < 1e-12  # mm, rounding of 100 mm
    if link == "wrist_1":
        assert left["urdf"] == pytest.approx(0.341, abs=1e-3)  # mm: the axis would be inclined to its own offset


@pytest.mark.parametrize("link", ["upper_arm", "wrist_2", "wrist_3"])
def test_in_the_controllers_reading_common_normals_are_at_right_angles_to_the_axes(tmp_path, link):
    tilt = {}
    for angles in ("urdf", "controller"):
        frame = read_ur_kinematics(written(tmp_path, UR5E), angles=angles).chain.fixed[LINKS.index(link)]
        tilt[angles] = abs(frame[0, 2])
    assert tilt["controller"] < 2e-16
    assert 3e-8 < tilt["urdf"] < 1e-6


def test_the_two_readings_of_a_ur5e_differ_by_millimetres(tmp_path):
    path = written(tmp_path, UR5E)
    urdf, controller = (read_ur_kinematics(path, angles=angles).chain for angles in ("urdf", "controller"))
    one, other = (chain.tip_in_base(poses(n=2000)) for chain in (urdf, controller))
    apart = np.linalg.norm(one - other, axis=1)
    assert apart.mean() == pytest.approx(1.26, abs=0.1)
    assert apart.max() == pytest.approx(2.42, abs=0.05)


# Bad files


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: "", "the file is empty"),
        (lambda text: "# nothing\n", "the file is empty"),
        (lambda text: "kinematics", "expected a UR's kinematics yaml as a mapping of kinematics, got 'kinematics'"),
        (lambda text: "- 1\n- 2\n", "as a mapping of kinematics, got a list"),
        (lambda text: "kinematics: [1, 2]\n", "expected kinematics as a mapping of shoulder, .*, got a list"),
        (lambda text: text.replace("kinematics:", "dynamics:"), "kinematics missing, dynamics unknown"),
        (lambda text: text + "extra: 1\n", "extra unknown"),
        (lambda text: text.replace("  wrist_3:", "  wrist_4:"), "wrist_3 missing, wrist_4 unknown"),
        (lambda text: text[: text.index("  wrist_3")], "wrist_3 missing"),
        (lambda text: text + "  tool: {x: 0}\n", "tool unknown"),
        (
            lambda text: text.replace("pitch: 0, yaw: 1.4", "yaw: 1.4"),
            r"line 2: expected the link shoulder .* pitch missing",
        ),
        (lambda text: text.replace("pitch: 0,", "pitch: 0, pitch: 1,", 1), "the key 'pitch' is stated twice"),
        (
            lambda text: text.replace("z: 0.1625928926388782", "z: about 0.16"),
            "line 2: expected z of shoulder as a finite",
        ),
        (lambda text: text.replace("z: 0.1625928926388782", "z: .nan"), "z of shoulder as a finite number, got '.nan'"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: nan"), "finite number, got 'nan'"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: .inf"), "finite number, got '.inf'"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: 1e999"), "finite number, got '1e999'"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: 1:30:00"), "finite number, got '1:30:00'"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: yes"), "finite number, got 'yes'"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: '٣'"), "finite number"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: " + "9" * 400), "finite number, got '9999"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: [1]"), "finite number, got a list"),
        (lambda text: text.replace("z: 0.1625928926388782", "z:"), "finite number, got ''"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: {x: 1}"), "finite number, got a mapping"),
        (lambda text: text.replace("z: 0.1625928926388782", "z: 162.59"), "length of shoulder within 5 m, got 162.59"),
        (lambda text: text.replace("roll: 1.569833151515029", "roll: 89.945"), "angle of upper_arm within 6.28 rad"),
        (lambda text: text.replace("calib_1282784419969490140", "1282784419969490140"), "expected the hash as calib_"),
        (lambda text: text.replace("calib_1282784419969490140", "[1]"), "expected the hash as calib_"),
        (lambda text: text.replace("{x: 0, y", "&a {x: 0, y", 1), "line 2: anchors and aliases are not read"),
        (lambda text: text + "  alias: *a\n", "anchors and aliases are not read"),
        (lambda text: text.replace("x: 0,", "x: !!float 0,", 1), "tags are not read"),
        (lambda text: "!!python/object/apply:os.system [ls]\n", "tags are not read, got 'tag:yaml.org,2002:python"),
        (lambda text: text + "---\n" + text, "expected one document, got a second one"),
        (lambda text: "[" * 50_000, "expected at most 10 levels"),
        (lambda text: "kinematics: {x: 0, y", "line 1: the file is not YAML"),
        (lambda text: "kinematics:\n\tshoulder: 1\n", "line 2: the file is not YAML"),
        (lambda text: "? [1, 2]\n: 3\n", "expected keys as text"),
        (lambda text: b"\xff\xfe\x00k", "expected UTF-8 text"),
        (lambda text: "kinematics: \x00", "the file is not YAML"),
        (lambda text: text + "# " + "x" * 300_000, "larger than 0.2 MB"),
    ],
)
def test_a_bad_file_is_refused_with_its_place(tmp_path, change, message):
    path = written(tmp_path, change(UR5E))
    assert refuses(message, ta.load_arm, path).file == path


def test_a_file_that_is_not_there_or_of_another_kind(tmp_path):
    refuses("does not exist", ta.load_arm, tmp_path / "none.yaml")
    refuses(
        r"an arm file ends in .toml, .urdf, .xml or .yaml, got '.json'",
        ta.load_arm,
        written(tmp_path, "{}", "arm.json"),
    )


def test_a_file_without_a_hash_is_an_arm_without_one(tmp_path):
    arm = ta.load_arm(written(tmp_path, UR5E[: UR5E.index("  hash")]))
    assert ur_hash(arm) is None
    refuses("expected a hash as calib_", ur_kinematics_text, arm.chain.fixed[:6], "calib_\n  x: 1")


@pytest.mark.parametrize("value", [0.0, -0.0, 1e-5, -1e-5, 1e-300, 0.1, 2 / 3, 1e22, 12345678901234567.0])
def test_numbers_are_numbers_in_every_yaml(value):
    import yaml

    text = yaml_number(value)
    assert isinstance(yaml.safe_load(text), float)
    assert yaml.safe_load(text) == value
    assert parse_yaml(text.encode()).number("a value") == value


def test_depth_is_bounded():
    parse_yaml(b"[" * MAX_DEPTH + b"]" * MAX_DEPTH)
    refuses("levels", parse_yaml, b"[" * (MAX_DEPTH + 1) + b"]" * (MAX_DEPTH + 1))
