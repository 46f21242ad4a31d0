"""Where coordinates come from: stated by every row alike, or refused; a model is named with its hash."""

import datetime

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.wings.laboratory.standards.artefacts import example_artefacts
from truearm.wings.laboratory.standards.coordinate_origin import ARM_SOFTWARE, CoordinateOrigin
from truearm.wings.laboratory.standards.layout import lay_out_tests
from truearm.wings.laboratory.standards.measured_points import read_points
from truearm.wings.laboratory.standards.points_form import fill_points_form, write_points_form
from truearm.wings.laboratory.standards.verification_plan import load_verification_plan

DAY = datetime.date(2026, 10, 20)
DIGEST = "0123456789abcdef" * 4
HEAD = "test,artefact,date,position,x_mm,y_mm,z_mm,coordinates_from,model,model_sha256,outside_training"
OF_MODEL = f"truearm 0.1.0,arm.truearm (physical),{DIGEST}"


def points(tmp_path, *tails, head=HEAD):
    rows = [f"single_point,cone,2026-01-20,1,0,0,{i / 1000},{tail}" for i, tail in enumerate(tails)]
    path = tmp_path / "points.csv"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return path


def test_a_model_is_named_with_its_hash_and_the_readings_outside_its_range(tmp_path):
    origin = read_points(points(tmp_path, *[f"{OF_MODEL},{one}" for one in (0, 1, 1, 0, 1)])).origin
    assert origin == CoordinateOrigin("truearm 0.1.0", "arm.truearm (physical)", DIGEST, 3, 5)
    assert origin.describe() == (
        f"Coordinates: computed from joint angles by truearm 0.1.0 with the model arm.truearm (physical), SHA-256 "
        f"{DIGEST}; 3 of 5 readings are outside the range that the model was trained on."
    )
    assert origin.to_json()["n_outside_training"] == 3


@pytest.mark.parametrize(
    ("tail", "said"),
    [
        (",,,", "do not state"),
        ("arm software,,,", "from the software of the arm, without a model"),
        ("virtual arm,,,", "no arm was measured"),
    ],
)
def test_an_origin_without_a_model_names_none(tmp_path, tail, said):
    origin = read_points(points(tmp_path, *[tail] * 5)).origin
    assert said in origin.describe()
    assert (origin.is_model, origin.computed_with) == (False, "")


def test_without_the_columns_the_origin_is_not_stated(tmp_path):
    assert read_points(points(tmp_path, "", head=HEAD.partition("coord")[0] + "note")).origin == CoordinateOrigin()


@pytest.mark.parametrize(
    ("tails", "said"),
    [
        ([f"{OF_MODEL},0"] * 2 + ["arm software,,,"] * 3, r"line 4, .*2 origins: .*lines 2 to 3; arm software in line"),
        ([f"{OF_MODEL},0", ",,,", f"{OF_MODEL},1"], r"line 3, .*lines 2, 4; not stated in line 3"),
        ([f"{OF_MODEL},0", f"{OF_MODEL.replace('012', '456', 1)},0"], r"line 3, .*\(0123456789ab\) in line 2; .*\(456"),
        (["my program,,,"], "unknown origin of coordinates 'my program'.*arm software"),
        ([f"truearm 0.1.0,,{DIGEST},0"], "model that computed the coordinates is not named"),
        (["truearm 0.1.0,m,abc,0"], "expected the SHA-256 of the model file, got 'abc'"),
        ([f"{OF_MODEL},0", f"{OF_MODEL},"], "line 3, column 'outside_training': expected 0 or 1"),
        ([",m,,"], "line 2, column 'model': a model is stated, but coordinates_from does not name truearm"),
        (["arm software,,,", "arm software,,,1"], "line 3, column 'outside_training': a model is stated"),
        ([f"truearm \x1b[2J,m,{DIGEST},0"], "control character"),
    ],
)  # fmt: skip
def test_mixed_unknown_and_incomplete_origins_are_refused_with_their_lines(tmp_path, tails, said):
    refuses(said, read_points, points(tmp_path, *tails))


@pytest.fixture
def form(tmp_path):
    plan = load_verification_plan("asme-b89.4.22").model_copy(update={"single_point": None, "volumetric": None})
    layout = lay_out_tests(plan, example_artefacts(2500.0), 2500.0)
    write_points_form(layout, tmp_path / "points.csv", tip_diameter_mm=6.0)
    return tmp_path / "points.csv", np.concatenate([one.points for one in layout])


def test_a_form_is_filled_in_with_the_origin_and_the_rows_outside(form):
    path, at = form
    origin, outside = CoordinateOrigin("truearm 0.1.0", "physical", DIGEST), np.arange(len(at)) < 4
    fill_points_form(path, at, day=DAY, artefact_degC=20, origin=origin, outside=outside)
    read = read_points(path).origin
    assert (read.model, read.model_sha256, read.n_outside, read.n_points) == ("physical", DIGEST, 4, len(at))


def test_points_of_another_origin_are_not_added_to_a_form(form):
    path, at = form
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:10]) + "\n")
    origin = CoordinateOrigin("truearm 0.1.0", "physical", DIGEST)
    fill_points_form(path, at[:9], day=DAY, artefact_degC=20, origin=origin, outside=np.zeros(9, bool))
    tail = [line + ",,," for line in lines[10:]]  # of the columns that the model filled in
    path.write_text(path.read_text() + "\n".join(tail) + "\n")
    before = path.read_bytes()
    with pytest.raises(
        InputError, match=r"line 2, column 'coordinates_from'.*\(truearm 0.1.0, physical, 0123.*\(arm s"
    ):
        fill_points_form(path, at[9:], day=DAY, artefact_degC=20, origin=CoordinateOrigin(ARM_SOFTWARE))
    assert path.read_bytes() == before
