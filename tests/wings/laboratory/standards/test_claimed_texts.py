"""Names and titles claim no verdict and no other standard; those of arms and procedures are taken."""

import pytest

from refusals import refuses
from truearm.wings.laboratory.standards.specification import check_no_verdict, named_standards


@pytest.mark.parametrize("text", ["Arm A: conform", "PASSED", "certified arm", "complies with its data", "meets all"])
def test_a_verdict_in_a_name_is_refused(text):
    refuses("leave the verdict out", check_no_verdict, text)


@pytest.mark.parametrize("text", ["Compass 75", "Conformat 2", "bypass valve arm", "Meeting room arm", "UR10e"])
def test_words_that_only_begin_like_a_verdict_are_names(text):
    assert check_no_verdict(text) == text


def test_standards_are_named_without_their_year():
    assert named_standards("after ISO 10360-2:2009 and VDI/VDE 2617-9") == ["ISO 10360-2", "VDI/VDE 2617-9"]
    assert named_standards("procedure PA-12, ISOMETRIC 3, arm A 2500") == []
