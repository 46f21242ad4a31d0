"""The prior of a type: where it enters, and a file that is safe to read."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.identification.terms import constants
from truearm.identification.terms.type_prior import (
    FORMAT,
    ConstantPrior,
    HeldOutGain,
    HeldOutPart,
    TypePrior,
    kinematics_sha256,
    read_type_prior,
    type_constants,
)


@pytest.fixture(scope="module")
def arm():
    return ta.load_arm("ur10")


@pytest.fixture(scope="module")
def prior(arm):
    names = [term.name for term in type_constants(arm.chain)]
    return TypePrior(
        format=FORMAT,
        truearm="0.1.0",
        arm="ur10",
        arm_sha256=kinematics_sha256(arm),
        arms=("A-1", 'A "2"', "Å3"),
        gains=(HeldOutGain(n_readings=10, n_arms=3, error_ratio=0.5, error_ratio_u=0.1),),
        constants=tuple(
            ConstantPrior(name=name, mean=1e-3 * i, mean_u=1e-5, std=1e-4 * (i + 1)) for i, name in enumerate(names)
        ),
        held_out=tuple(
            HeldOutPart(
                arms=arms,
                mean=tuple(2e-3 * i for i in range(len(names))),
                mean_u=(2e-5,) * len(names),
                std=(3e-4,) * len(names),
            )
            for arms in (("A-1", "Å3"), ('A "2"',))
        ),
    )


def test_a_file_gives_back_what_was_written(prior, tmp_path):
    prior.save(tmp_path / "p.toml")
    assert read_type_prior(tmp_path / "p.toml") == prior


def test_means_enter_by_the_chain_and_scatters_by_the_terms(arm, prior):
    offered = constants(arm.chain)
    chain, terms = prior.applied(arm.chain, offered)
    motions = np.zeros((arm.chain.n_places, 6))
    known = {one.name: one for one in prior.constants}
    for term in offered:
        if term.learn:
            motions[term.place] += known[term.name].mean * np.array(term.direction)
    np.testing.assert_array_equal(chain.fixed, arm.chain.with_motions(motions).fixed)
    for before, after in zip(offered, terms, strict=True):
        std = known[before.name].std if before.learn else before.prior_std
        assert after == replace(before, prior_std=std)


def test_a_placed_nominal_arm_is_as_before(arm, prior):
    placing = constants(arm.chain, angle_std=0.0, length_std=0.0)
    chain, terms = prior.applied(arm.chain, placing)
    assert chain is arm.chain
    assert terms == placing


def test_a_prior_is_of_the_drawing_and_not_of_tip_limits_or_serial_number(arm, prior):
    prior.check_arm(replace(arm, chain=arm.chain.with_tip([0, 0, 93.0]), serial_number="7", name="ours"))
    longer = arm.chain.fixed.copy()
    longer[3, 0, 3] += 1e-3
    with pytest.raises(InputError, match=r"expected a type prior of arm 'ur10'.*of other dimensions"):
        prior.check_arm(replace(arm, chain=replace(arm.chain, fixed=longer)))
    refuses(r"of arm 'panda', got one of 'ur10'", prior.check_arm, ta.load_arm("panda"))
    fewer = prior.model_copy(update={"constants": prior.constants[1:]})
    refuses("J1 rotation about x", fewer.check_arm, arm)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("format = 2", "format = 1"),
        ("format = 2", "format = 3"),
        ("format = 2", "format = 2\nmore = 1"),
        ("std = [0.0003", "std = [0.0"),
        ("std = [0.0003, ", "std = ["),
        ("mean = [0.0", "mean = [nan"),
        ('arm_sha256 = "', 'arm_sha256 = "x'),
        ("std = 0.0001\n", "std = 0.0\n"),
        ("std = 0.0001\n", "std = nan\n"),
        ("mean = 0.0\n", "mean = inf\n"),
        ("mean = 0.0\n", 'mean = "0"\n'),
        ("mean = 0.0\n", ""),
        ("error_ratio = 0.5", "error_ratio = -1.0"),
        ('"A-1"', '"\\u0007"'),
        ("[[constants]]", "[[constant]]"),
        ("arms = [", "arms = ["),
    ],
)
def test_a_file_that_is_none_is_refused(prior, tmp_path, old, new):
    prior.save(tmp_path / "p.toml")
    text = (tmp_path / "p.toml").read_text(encoding="utf-8")
    text = text.replace(old, new, 1) if old != new else text[: len(text) // 2]
    (tmp_path / "p.toml").write_text(text, encoding="utf-8")
    refuses(r"p\.toml", read_type_prior, tmp_path / "p.toml")


def test_an_arm_of_the_prior_gets_that_of_the_others(arm, prior):
    assert prior.without("B-1") is prior
    others = prior.without("A-1")
    assert others.arms == ('A "2"',)
    assert others.constants[1] == ConstantPrior(name=prior.constants[1].name, mean=2e-3, mean_u=2e-5, std=3e-4)
    others.check_arm(arm)
    refuses("whose readings would count twice", others.without, 'A "2"')


def test_a_model_without_constants_takes_no_prior(arm, prior):
    session = ta.simulate(arm, poses=12, seed=1).session
    for model in ("nominal", "network"):
        refuses("identifies no constants", ta.fit, arm, session, model=model, prior=prior)
    refuses("got one of 'ur10'", ta.fit, "ur5", session, model="kinematic", prior=prior)
