"""Literals of four languages: the same joints read back, refused targets are comments, names stay inside of them."""

import re

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.arm.chain import Chain
from truearm.wings.exports.targets.program_literals import LANGUAGES, fanuc_joints, program_text

NUMBER = r"-?\d+\.\d+"
# Printed to 1e-9 rad or 1e-6 deg.
PRINTED_RAD = 2e-8
JOINTS = np.random.default_rng(1).uniform(-3, 3, (4, 6))
LABELS = ["home", "above\nmovej([0,0,0,0,0,0])", "päck", "target 4"]
REASONS = ["", "", "at a limit: J2", ""]


def text_of(language, **changed):
    options = {"labels": LABELS, "reasons": REASONS, "prismatic": np.zeros(6, bool), "header": ["truearm-export: {}"]}
    return program_text(language, JOINTS, **{**options, **changed})


def joints_in(language, text):
    """Read the targets back by the language's own form."""
    if language == "urscript":
        rows = re.findall(r"^  movej\(\[(.*?)\]", text, re.MULTILINE)
    elif language == "rapid":
        rows = re.findall(r":= \[\[(.*?)\],\[9E9,9E9,9E9,9E9,9E9,9E9\]\];", text)
    elif language == "krl":
        rows = re.findall(r"^DECL AXIS XC\d+=\{(A1 .*)\}", text, re.MULTILINE)
    else:
        rows = re.findall(r"^P\[\d+\]\{(.*?)^\};", text, re.MULTILINE | re.DOTALL)
    found = np.array([[float(n) for n in re.findall(NUMBER, row)] for row in rows])
    return found if language == "urscript" else np.radians(found)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_joints_read_back(language):
    np.testing.assert_allclose(joints_in(language, text_of(language)), JOINTS[[0, 1, 3]], atol=PRINTED_RAD)


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_refused_target_is_a_comment_that_names_it(language):
    (line,) = [line for line in text_of(language).splitlines() if "REFUSED" in line]
    assert line == f"{LANGUAGES[language].comment} 3 p?ck: REFUSED, at a limit: J2"


def test_a_program_of_motions_stops_in_place_of_a_refused_target():
    """Otherwise the arm would go straight from the target before to the one after."""
    lines = text_of("urscript", labels=["a", "b", 'c" + "\\', "d"]).splitlines()
    at = next(i for i, line in enumerate(lines) if "REFUSED" in line)
    assert (
        lines[at + 1] == """  popup("3 c' + '/: at a limit: J2", title="Refused target", error=True, blocking=True)"""
    )
    assert lines[at + 2] == "  halt"
    assert lines[at + 3] == "# 4 d"
    assert "halt" not in text_of("urscript", reasons=[""] * 4)


@pytest.mark.parametrize("language", ["rapid", "krl", "fanuc"])
def test_a_refused_target_is_not_declared(language):
    lines = text_of(language).splitlines()
    at = next(i for i, line in enumerate(lines) if "REFUSED" in line)
    assert lines[at + 1].startswith(f"{LANGUAGES[language].comment} 4 ")


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_name_with_a_line_break_stays_in_its_comment(language):
    lines = text_of(language).splitlines()
    assert any(line.startswith(f"{LANGUAGES[language].comment} 2 above?movej") for line in lines)
    assert not any(line.startswith("movej") for line in lines)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_first_line_is_the_header(language):
    assert text_of(language).splitlines()[0] == f"{LANGUAGES[language].comment} truearm-export: {{}}"


def test_arms_that_a_language_cannot_state_are_refused():
    refuses("6 joints, 1 of them sliding", text_of, "krl", prismatic=np.array([True] + [False] * 5))
    refuses("7 joints", text_of, "rapid", prismatic=np.zeros(7, bool))
    refuses("expected a language among", text_of, "karel")


@pytest.mark.parametrize("sense", [1, -1])
def test_fanucs_j3_is_the_direction_of_the_forearm_whatever_j2_does(sense):
    """Of an arm whose J2 and J3 turn the same way, and of one like Fanuc's (J2 forward, J3 up)."""
    fixed = load_arm("ur10").chain.fixed.copy()
    if sense < 0:  # the axis of J3 the other way about; the links after it are the same bodies in another frame
        fixed[2] = fixed[2] @ np.diag([1.0, -1, -1, 1])
    held = np.linspace(-2, 2, 9)
    joints = np.tile(np.array([0.3, 0, 0.5, 0.1, 0.2, 0]), (9, 1))
    joints[:, 1], joints[:, 2] = held, 0.5 - sense * held  # the pendant's J3 stays, J2 turns
    R_base_forearm = Chain(fixed[:4], np.zeros(3)).pose(joints[:, :3]).R_base_tip
    np.testing.assert_allclose(R_base_forearm - R_base_forearm[:1], 0, atol=1e-12)
    np.testing.assert_allclose(fanuc_joints(joints, fixed)[:, 2], 0.5, atol=1e-12)
    np.testing.assert_array_equal(np.delete(fanuc_joints(joints, fixed), 2, axis=1), np.delete(joints, 2, axis=1))


def test_an_arm_whose_j2_and_j3_are_not_parallel_has_no_fanuc_j3():
    refuses("are not parallel", fanuc_joints, np.zeros((1, 6)), load_arm("gao2017").chain.fixed)
