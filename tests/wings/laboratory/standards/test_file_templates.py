"""Empty files to fill in: every key, refused as they are, valid once they are filled in."""

import re

import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.wings.laboratory.standards.artefacts import (
    Artefacts,
    CalibratedBar,
    CalibratedLength,
    CalibratedSphere,
    Seat,
    template,
)
from truearm.wings.laboratory.standards.measured_points import CONDITIONS
from truearm.wings.laboratory.standards.specification import SYMBOLS, Specification, read_specification


def filled_in(text: str) -> str:
    """The text with all options in use and values in place of empty ones."""
    text = re.sub(r'(?m)^# (?=(\w+|"[\w.]+") = |\[)', "", text)
    text = text.replace("expansion_per_K = nan", "expansion_per_K = 1e-6").replace("expires = 1900", "expires = 2028")
    for key, value in (("nominal_mm = 25", ""), ("measuring_range_mm = nan", "measuring_range_mm = 2500")):
        text = text.replace(key, value or "nominal_mm = 20")
    text = re.sub(r"(\b(?:diameter|length)_mm) = nan", r"\1 = 20", text)
    text = text.replace("= nan", "= 0.001")
    for number in range(text.count('""')):
        text = text.replace('""', f'"text {number}"', 1)
    return text


def test_the_template_of_artefacts_is_refused_until_every_value_is_filled_in():
    text = template("artefacts")
    refused = refuses(None, parse_toml, text.encode(), Artefacts)
    texts, numbers = refused.faults
    to_fill_in = re.findall(r'(?m)^[^#\n]*""', text)
    assert texts.problem.partition(": expected text")[0].count(",") + 1 == len(to_fill_in)
    assert numbers.problem.partition(": expected a finite number")[0].count(",") + 1 == text.count("= nan")
    made = parse_toml(filled_in(text).encode(), Artefacts)
    assert (len(made.spheres), len(made.bars), len(made.seats)) == (1, 1, 1)


def test_the_template_of_artefacts_has_every_key():
    spheres, bars, seats = template("artefacts").split("\n[[")[1:]
    for model, part in ((CalibratedSphere, spheres), (CalibratedBar, bars), (Seat, seats)):
        keys = set(re.findall(r"(?m)^(?:# )?(\w+) = ", part))
        # What is said of one kind of artefact is not repeated for the others.
        said_once = set() if model is CalibratedSphere else {"calibration_dof", "u_form_mm"}
        assert set(model.model_fields) - keys <= said_once
        assert keys <= set(model.model_fields)
    assert all(f"{key} = " in bars for key in set(CalibratedLength.model_fields) - {"nominal_mm"})


def test_the_template_of_a_specification_is_refused_until_it_is_filled_in():
    text = template("mpe")
    refused = refuses(None, parse_toml, text.encode(), Specification)
    assert [fault.problem.partition(":")[0] for fault in refused.faults] == ["name, source", "measuring_range_mm"]
    made = parse_toml(filled_in(text).encode(), Specification)
    assert set(made.rated_conditions) == set(CONDITIONS)
    assert set(made.limits) == set(SYMBOLS) - {"Volumetric.2s"}
    assert made.measuring_range_mm == 2500


@pytest.mark.parametrize("line", ["", "measuring_range_mm = 2.5"])
def test_the_measuring_range_is_explained_where_it_is_asked_for(tmp_path, line):
    (tmp_path / "mpe.toml").write_text(f'name = "arm"\nsource = "sheet"\n{line}\n[limits]\nE_Uni = {{ B_um = 50 }}\n')
    with pytest.raises(InputError, match="the sphere in which the arm measures, twice its reach: 2500 for 2.5 m"):
        read_specification(tmp_path / "mpe.toml")
