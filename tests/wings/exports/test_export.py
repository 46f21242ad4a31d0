"""Laws of `export` and `check_export` at both doors, whatever the format."""

import json
import re
from dataclasses import replace

import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import write_arm
from truearm.errors import MissingTool
from truearm.wings.exports.formats import reduced_covariance
from truearm.wings.exports.targets.manifest import read_manifest


@pytest.fixture(scope="module")
def session():
    return ta.simulate("ur10", poses=60, preset="shop", seed=5).session


@pytest.fixture(scope="module")
def model(session):
    return ta.fit("ur10", session, model="kinematic").model


@pytest.fixture(scope="module")
def urdf(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("exported") / "arm.urdf"
    ta.export(model, path)
    return path.read_bytes()


@pytest.fixture
def exported(urdf, tmp_path):
    (tmp_path / "arm.urdf").write_bytes(urdf)
    return tmp_path / "arm.urdf"


def outcome(check: ta.ExportCheck, what: str) -> str:
    return next(finding.outcome for finding in check.findings if finding.what == what)


def test_an_export_states_origin_frame_loss_and_five_check_poses(model, exported):
    manifest = read_manifest(exported)
    assert (manifest.format, manifest.direction, manifest.frame) == ("urdf", "predict", "base")
    assert manifest.provenance.arm == "ur10"
    assert manifest.provenance.trained_ranges == tuple(map(tuple, model.angle_ranges_.tolist()))
    assert manifest.loss is not None
    assert manifest.loss.exported_mm < 1e-6 < manifest.loss.nominal_mm  # constants hold a kinematic model whole
    assert len(manifest.check_poses) == 5


def test_an_export_of_this_model_agrees(model, exported):
    check = ta.check_export(model, exported)
    assert check.agrees
    assert {finding.outcome for finding in check.findings} == {"agrees"}


def test_another_unit_of_the_same_type_is_not_taken_for_this_one(exported):
    other = ta.simulate("ur10", poses=60, preset="shop", seed=6).session
    check = ta.check_export(ta.fit("ur10", other, model="kinematic").model, exported)
    assert not check.agrees
    assert outcome(check, "model") == "differs"
    assert outcome(check, "check poses") == "differs"


def test_a_robot_with_another_number_of_joints_is_named(exported):
    session = ta.simulate("panda", poses=60, seed=1).session
    check = ta.check_export(ta.fit("panda", session, model="nominal").model, exported)
    assert outcome(check, "arm") == "differs"
    assert "panda" in str(check)


def test_a_wrong_unit_of_length_is_named(model, exported):
    text = exported.read_text()
    millimetres = re.sub(
        r'xyz="([^"]+)"(?= rpy)',
        lambda found: 'xyz="' + " ".join(str(1000 * float(x)) for x in found[1].split()) + '"',
        text,
    )
    exported.write_text(millimetres)
    check = ta.check_export(model, exported)
    assert outcome(check, "content") == "differs"
    assert "millimetres for metres" in str(check)


def test_a_changed_constant_is_found(model, exported):
    text = exported.read_text()
    length = re.search(r'<joint name="J3".*?xyz="(\S+)', text, re.DOTALL)[1]
    exported.write_text(text.replace(f'xyz="{length}', f'xyz="{float(length) + 1e-5!r}'))  # metres
    assert outcome(ta.check_export(model, exported), "content") == "differs"


def test_a_changed_check_pose_is_found(model, exported):
    tip = read_manifest(exported).check_poses[2].tip_mm[0]
    exported.write_text(exported.read_text().replace(repr(tip), repr(tip + 0.01)))
    assert outcome(ta.check_export(model, exported), "content") == "differs"


def test_an_arm_with_another_serial_number_is_named(session, tmp_path):
    arm = ta.load_arm("ur10")
    models, readings = [], replace(session, serial_number=None)  # of an arm without a number
    for serial in ("10017", "10018"):
        own = ta.Arm(arm.name, arm.chain, lower=arm.lower, upper=arm.upper, serial_number=serial)
        models.append(ta.fit(own, readings, model="nominal").model)
    ta.export(models[0], tmp_path / "a.urdf")
    assert read_manifest(tmp_path / "a.urdf").provenance.serial_number == "10017"
    assert "serial number 10018" in str(ta.check_export(models[1], tmp_path / "a.urdf"))


def test_an_arm_file_keeps_its_serial_number(tmp_path):
    arm = ta.load_arm("ur10")
    own = ta.Arm(arm.name, arm.chain, serial_number='10"17')
    for name in ("a.toml", "a.urdf"):
        write_arm(own, tmp_path / name)
        assert ta.load_arm(tmp_path / name).serial_number == '10"17'


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("arm.xyz", {}, "no format ends in '.xyz'"),
        ("arm", {}, "no format ends in ''"),
        ("arm.yaml", {}, "several formats end in .yaml"),
        ("arm.urdf", {"format": "sdf"}, "expected a format among urdf"),
        ("arm.txt", {"format": "c"}, "ends in .c"),
        ("no/such/arm.urdf", {}, "no/such"),
    ],
)
def test_what_cannot_be_written_is_refused_and_nothing_is_written(model, tmp_path, name, options, words):
    refuses(re.escape(words), ta.export, model, tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


def test_options_of_constants_do_not_apply_to_a_whole_model(model, session, tmp_path):
    refuses("region does not apply to the format json", ta.export, model, tmp_path / "arm.json", region=session)
    with pytest.raises(ta.InputError, match=r"source does not apply to the format constants.*convention"):
        ta.export(model, tmp_path / "arm.csv", format="constants", source="robot.urdf")


@pytest.mark.parametrize("name", ["arm.c", "arm.mjs"])
def test_foreign_code_is_not_run(model, tmp_path, name, monkeypatch):
    """A file of code is checked by its text first: only what truearm writes for this model is compiled or run."""
    for poses in ("N_POSES", "N_BEYOND", "N_JUDGES"):
        monkeypatch.setattr(reduced_covariance, poses, 500)
    ta.export(model, tmp_path / name)
    text = (tmp_path / name).read_text()
    number = next(found[0] for found in re.finditer(r"-?\d\.\d{15,17}", text.partition("*/")[2]))
    monkeypatch.setattr("subprocess.run", lambda *_, **__: pytest.fail("the code was run"))
    for changed in (text.replace(number, "0.5", 1), text + "\n/* more */\n", text[:-2]):
        (tmp_path / name).write_text(changed)
        assert outcome(ta.check_export(model, tmp_path / name), "content") == "differs"
    (tmp_path / name).write_text(text.replace(read_manifest(tmp_path / name).provenance.model_sha256, 64 * "1"))
    assert outcome(ta.check_export(model, tmp_path / name), "content") == "not run"


def test_joints_of_check_poses_in_degrees_are_found(model, exported):
    manifest = read_manifest(exported)
    degrees = [
        pose.model_copy(update={"joints": tuple(57.3 * q for q in pose.joints)}) for pose in manifest.check_poses
    ]
    edited = manifest.model_copy(update={"check_poses": tuple(degrees)})
    exported.write_text(exported.read_text().replace(manifest.line(), edited.line()))
    assert outcome(ta.check_export(model, exported), "check poses") == "differs"


def test_a_region_is_named_in_the_file(model, session, tmp_path):
    result = ta.export(model, tmp_path / "arm.urdf", region=session)
    assert result.manifest.loss.n_poses == len(session)
    assert f"by cross-validation over {len(session)} poses (the poses given)." in str(result)


def test_the_command_writes_checks_and_says_so_by_its_exit_code(truearm, model, tmp_path):
    model.save(tmp_path / "m.truearm")
    ran = truearm("export", tmp_path / "m.truearm", "--out", tmp_path / "a.urdf")
    assert (ran.code, "urdf written to" in ran.out) == (0, True)
    ran = truearm("export", tmp_path / "m.truearm", "--check", tmp_path / "a.urdf", "--json")
    assert (ran.code, json.loads(ran.out)["agrees"]) == (0, True)
    text = (tmp_path / "a.urdf").read_text()
    (tmp_path / "a.urdf").write_text(text.replace(read_manifest(tmp_path / "a.urdf").provenance.model_sha256, 64 * "0"))
    assert truearm("export", tmp_path / "m.truearm", "--check", tmp_path / "a.urdf").code == 1
    for wrong in ([], ["--out", "a.urdf", "--check", "a.urdf"]):
        assert "expected one of --out and --check" in truearm("export", tmp_path / "m.truearm", *wrong).err
    assert truearm("export", tmp_path / "a.urdf", "--out", tmp_path / "b.urdf").code == 2
    assert truearm("export", tmp_path / "m.truearm", "--out", tmp_path / "m.truearm").code == 2
    (tmp_path / "plain.urdf").write_text("<robot/>")
    assert "no check poses" in truearm("export", tmp_path / "m.truearm", "--check", tmp_path / "plain.urdf").err


# The file under check does not say how well it must be checked


def restated(path, **changes):
    """Change what a file states of itself."""
    manifest = read_manifest(path)
    edited = manifest.model_copy(update=changes)
    path.write_text(path.read_text().replace(manifest.line(), edited.line()))


def test_a_file_does_not_set_its_own_limits(model, exported):
    """A tolerance or a loss of a million kilometres, stated in the file, hides no change of it."""
    manifest = read_manifest(exported)
    restated(exported, tolerance_mm=1e9)
    length = re.search(r'<joint name="J3".*?xyz="(\S+)', exported.read_text(), re.DOTALL)[1]
    exported.write_text(exported.read_text().replace(f'xyz="{length}', f'xyz="{float(length) + 1e-3!r}'))  # metres
    assert outcome(ta.check_export(model, exported), "content") == "differs"
    moved = tuple(
        pose.model_copy(update={"tip_mm": (pose.tip_mm[0] + 9.0 * i, *pose.tip_mm[1:])})
        for i, pose in enumerate(manifest.check_poses)
    )
    restated(exported, check_poses=moved, loss=manifest.loss.model_copy(update={"exported_max_mm": 1e9}))
    assert outcome(ta.check_export(model, exported), "check poses") == "differs"


@pytest.mark.parametrize("change", ["none", "one", "ragged", "short"])
def test_other_than_five_check_poses_of_all_joints_are_damage(model, exported, change):
    poses = read_manifest(exported).check_poses
    ragged = poses[1].model_copy(update={"joints": (1.0,)})
    changed = {
        "none": (),
        "one": poses[:1],
        "ragged": (poses[0], ragged, *poses[2:]),
        "short": tuple(pose.model_copy(update={"joints": pose.joints[:5]}) for pose in poses),
    }
    restated(exported, check_poses=changed[change])
    refuses("truearm-export is damaged", ta.check_export, model, exported)


def test_a_file_whose_content_was_not_run_is_not_verified(truearm, model, tmp_path, monkeypatch):
    """Without the program that runs a file nothing is known of its content: exit code 3, and no agreement."""
    model.save(tmp_path / "m.truearm")
    ta.export(model, tmp_path / "a.json")

    def missing(*_: object) -> None:
        raise MissingTool("this needs a program", hint="install it")

    monkeypatch.setattr("truearm.wings.exports.formats.json_model.tips", missing)
    check = ta.check_export(model, tmp_path / "a.json")
    assert (check.verdict, check.agrees, outcome(check, "content")) == ("not verified", False, "not run")
    assert "a.json is not verified: content not run" in str(check)
    ran = truearm("export", tmp_path / "m.truearm", "--check", tmp_path / "a.json", "--json")
    assert (ran.code, json.loads(ran.out)["verdict"]) == (3, "not verified")
