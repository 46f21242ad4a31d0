"""Terms of the user's own: offered, identified, kept in the model's file, refused by name where they are unknown."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from sklearn.base import clone

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.identification.terms import Basis, Expression, Formula, InSession, Term, basis, register_basis

PULLED = 3e-4  # rad per rad, three standard deviations of its prior


@register_basis
@dataclass(frozen=True)
class CableWinding(Basis):
    """How far a joint has turned from zero [rad]."""

    joint: int

    def labels(self):
        return (f"winding of J{self.joint}",)

    def values(self, state):
        return np.ascontiguousarray(state.angles[:, [self.joint - 1]].T)


LONG = Formula((Expression("sum", (Expression.angle(2),) * 999),) * 60)  # 60,000 parts
CABLE = Term("J2 by its cable", 2, (0, 0, 1, 0, 0, 0), CableWinding(2), group="cable", prior_std=1e-4)


@pytest.fixture(scope="module")
def session():
    """Readings of an arm whose second joint a cable pulls back as it winds."""
    arm = ta.load_arm("ur10")
    random = np.random.default_rng(4)
    angles = random.uniform(-2, 2, (120, 6)) + arm.working
    true = angles.copy()
    true[:, 1] += PULLED * angles[:, 1]
    return ta.Session(angles, arm.chain.tip_in_base(true) + random.normal(0, 0.01, (120, 3)))


@pytest.fixture(scope="module")
def model(session):
    return ta.KinematicModel(ta.load_arm("ur10"), terms=(CABLE,)).fit_readings(session)


def test_the_planted_effect_is_found_within_its_uncertainty(model):
    terms = model.fit_.perturbed_chain.terms
    column = sum(term.n_coefficients for term in terms[: [term.name for term in terms].index(CABLE.name)])
    std = float(np.sqrt(model.fit_.covariance[column, column]))
    assert std < 0.1 * PULLED
    # Three standard deviations; the seed is fixed.
    assert abs(model.fit_.coefficients[column] - PULLED) < 3 * std


def test_it_is_offered_to_the_physical_model_and_by_both_doors(session):
    physical = ta.fit("ur10", session, model="physical", terms=[CABLE], highest=1, residual=False).model
    assert CABLE.name in {term.name for term in physical.fit_.perturbed_chain.terms}
    plain = ta.KinematicModel(ta.load_arm("ur10")).fit_readings(session)
    error = [np.abs(one.predict_readings(session) - session.points).mean() for one in (physical, plain)]
    assert error[0] < 0.5 * error[1]


def test_its_file_has_it_and_is_refused_by_name_where_it_is_not_registered(model, session, tmp_path, monkeypatch):
    model.save(tmp_path / "m.truearm")
    read = ta.load_model(tmp_path / "m.truearm")
    assert read.terms == (CABLE,)
    np.testing.assert_array_equal(read.predict_readings(session), model.predict_readings(session))
    monkeypatch.delitem(basis._KINDS, "CableWinding")
    refuses("got 'CableWinding'.*import the module that registers it", ta.load_model, tmp_path / "m.truearm")


def test_a_file_without_is_as_it_was_before_there_were_any(session, tmp_path):
    plain = ta.KinematicModel(ta.load_arm("ur10")).fit_readings(session)
    plain.save(tmp_path / "m.truearm")
    assert b'"terms": []' not in (tmp_path / "m.truearm").read_bytes()
    assert ta.load_model(tmp_path / "m.truearm").terms == ()


def test_a_model_with_terms_is_cloned(model):
    assert clone(model).terms == model.terms


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (CABLE, "expected a sequence of terms"),
        (("cable",), "expected a sequence of terms"),
        ((replace(CABLE, basis=LONG), replace(CABLE, basis=LONG)), "at most 100000 parts together, got 120000"),
        ((replace(CABLE, place=9),), r"expected a place from 0 \(base\) to 7"),
    ],
)
def test_what_is_no_term_of_this_arm_is_refused(terms, message, session):
    refuses(message, ta.fit, "ur10", session, model="kinematic", terms=terms)


@pytest.mark.parametrize("of", [Expression.session("fryday"), Expression.tip("ball")])
def test_a_session_or_tip_that_no_reading_has_is_refused(of, session):
    with pytest.raises(InputError, match=rf"expected a {of.operation} of the readings .*, got '{of.arguments[0]}'"):
        ta.fit("ur10", session, model="kinematic", terms=[replace(CABLE, basis=of)])


@pytest.mark.parametrize("model", ["nominal", "network", "hybrid"])
def test_a_model_without_terms_refuses_them(model, session):
    refuses("expected a model that identifies terms", ta.fit, "ur10", session, model=model, terms=[CABLE])


def test_a_fit_says_what_became_of_own_terms(session):
    """The planted coefficient within its stated uncertainty; what the readings show nothing of is pruned, by name."""
    none = Term("J1 by nothing", 1, (0, 0, 1, 0, 0, 0), Expression.tip("A") * 0.0 + 0.0, "nothing", 1e-4)
    result = ta.fit("ur10", session, model="kinematic", terms=[CABLE, none])
    cable, pruned = result.to_dict()["own_terms"]
    assert cable["name"] == "J2 by its cable"
    assert abs(cable["coefficient"] - PULLED) < 4 * cable["u"] < PULLED
    assert pruned == {"name": "J1 by nothing", "coefficient": 0.0, "u": 0.0}
    assert "J1 by nothing: pruned, these readings show nothing of it" in str(result)
    assert f"J2 by its cable: {cable['coefficient']:.3g}, standard uncertainty" in str(result)
    namesake = replace(CABLE, name=result.model.fit_.perturbed_chain.terms[0].labels[0])  # that of a constant
    (one,) = ta.fit("ur10", session, model="kinematic", terms=[namesake]).to_dict()["own_terms"]
    assert (one["coefficient"], one["u"]) == pytest.approx((cable["coefficient"], cable["u"]), rel=1e-3)
    assert "own_terms" not in ta.fit("ur10", session, model="kinematic").to_dict()


def test_a_term_of_the_first_or_only_session_is_refused(session):
    """The model predicts in the frame of that session, where the function would be zero and no longer one."""
    half = len(session) // 2
    several = replace(session, session=np.repeat(["a", "b"], [half, len(session) - half]))
    one, q = replace(session, session=np.repeat("a", len(session))), Expression.angle(3)
    arm = ta.load_arm("ur10")
    for readings, free in ((several, ("base", "tip")), (one, ("base", "tip")), (several, ("tip",))):
        for of in (Expression.session("a") * q, 1 - Expression.session("a"), InSession("a")):
            term = replace(CABLE, basis=of)
            with pytest.raises(InputError, match="expected a further session, got 'session a'.*use a column"):
                ta.KinematicModel(arm, free=free, terms=(term,)).fit_readings(readings)
    term = replace(CABLE, basis=Expression.session("b") * q)
    fitted = ta.KinematicModel(arm, terms=(term,)).fit_readings(several)
    first = several.rows(slice(0, half))
    np.testing.assert_array_equal(fitted.predict_readings(first), fitted.predict(first.angles))
