"""scikit-learn's own estimator checks over all models.

The checks feed tables of any width and targets of one column. A model of a six-axis arm must refuse those, so each
model is worn inside an estimator that builds a chain with as many joints as the table has columns, and pads or cuts
the targets to three coordinates. All else (checking, cloning, repeating, not changing what it is given) is the
model's own.
"""

import warnings
from functools import cache, partial
from unittest import mock

import numpy as np
import pytest
import sklearn.utils.estimator_checks
from sklearn import config_context
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.estimator_checks import estimator_checks_generator

from refusals import refuses
from truearm.acceptance import accepting
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.judgement.nominal_check import UNCHECKED
from truearm.models import MODELS, HybridModel, KinematicModel, NetworkModel, NominalModel, PhysicalModel
from truearm.models.compensator import Compensator
from truearm.readings import Session


def zigzag(n_joints: int) -> Arm:
    """An arm whose axes turn by 90 degrees from joint to joint, 100 mm apart."""
    fixed = np.tile(np.eye(4), (n_joints + 1, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [20, 0, 100]
    return Arm(f"zigzag{n_joints}", Chain(fixed, np.array([0, 0, 50.0])))


class _AnyShape:
    """Wears a model for tables of any width."""

    def fit(self, X, y, sample_weight=None):
        from sklearn.utils.validation import validate_data

        angles, points = validate_data(
            self, X, y, multi_output=True, y_numeric=True, dtype=np.float64, ensure_min_samples=4
        )
        self.target_shape_ = points.shape[1:]
        wide = np.zeros((len(points), 3))
        given = points.reshape(len(points), -1)[:, :3]
        wide[:, : given.shape[1]] = given
        wide += 1e-3 * np.sin(np.arange(wide.size)).reshape(wide.shape)  # a network refuses a constant coordinate
        asked, self.arm = self.arm, zigzag(angles.shape[1])
        # Random tables are of no arm: the unit of their numbers is not judged, and the size that they show accepted.
        unjudged = mock.patch("truearm.models.compensator.judge_description", return_value=UNCHECKED)
        try:
            with unjudged, accepting("a random table"):
                super().fit(angles, wide, sample_weight)
        finally:
            self.arm = asked
        return self

    def predict(self, X):
        return super().predict(X)[:, : int(np.prod(self.target_shape_))].reshape(-1, *self.target_shape_)


class NominalOfAnyShape(_AnyShape, NominalModel):
    pass


class KinematicOfAnyShape(_AnyShape, KinematicModel):
    pass


class PhysicalOfAnyShape(_AnyShape, PhysicalModel):
    pass


class NetworkOfAnyShape(_AnyShape, NetworkModel):
    pass


class HybridOfAnyShape(_AnyShape, HybridModel):
    def _new_arm_model(self):
        return NominalOfAnyShape(self.arm, free=self.free)


# As quick as they can be, for what is checked is the protocol; the kinematic model as it is by default.
MEMBERS = [
    NominalOfAnyShape(zigzag(2), free=("base",)),
    KinematicOfAnyShape(zigzag(2), free=("base",)),
    PhysicalOfAnyShape(zigzag(2), free=("base",), highest=2, residual=False, robust=False),
    NetworkOfAnyShape(zigzag(2), free=("base",), hidden=(2,), epochs=3),
    HybridOfAnyShape(zigzag(2), free=("base",), arm_model="nominal", hidden=(2,), epochs=2, n_members=2),
]


WEEKLY = (KinematicModel, PhysicalModel, NetworkModel)


def check_name(value):
    return value.func.__name__ if isinstance(value, partial) else type(value).__name__


def is_meant(estimator, check):
    """Whether a check asks what these models promise."""
    return check_name(check) not in (
        "check_regressor_multioutput",  # asks for five targets; a tip has three coordinates
        # A reading of weight 2 is one better reading, not two: evidence and noise count readings.
        "check_sample_weight_equivalence_on_dense_data",
        # Networks refuse weights: test_networks_refuse_weights_with_the_reason.
        *(["check_sample_weights_not_overwritten"] if isinstance(estimator, NetworkModel | HybridModel) else []),
    )


def estimator_checks():
    with warnings.catch_warnings():  # models have scikit-learn's protocol without its base class, which it remarks
        warnings.filterwarnings("ignore", message=".* does not inherit from", category=UserWarning)
        # The kinematic and the physical model have the protocol of the nominal one from the same class, and fit
        # random tables slowly; networks are trained in the hybrid model too.
        return [
            pytest.param(*pair, marks=pytest.mark.weekly if isinstance(one, WEEKLY) else ())
            for one in MEMBERS
            for pair in estimator_checks_generator(one)
            if is_meant(*pair)
        ]


@pytest.fixture(scope="module", autouse=True)
def narrow_table():
    """The table of the checks has 200 rows of ten joints; what they ask for is the same of any width."""
    X = np.random.default_rng(42).standard_normal((60, 3))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sklearn.utils.estimator_checks, "REGRESSION_DATASET", (X, X @ [5.0, 0.0, 0.0] + 5.0))
        yield


@pytest.mark.filterwarnings("ignore:.* does not inherit from:UserWarning")
@pytest.mark.parametrize(("estimator", "check"), estimator_checks(), ids=check_name)
def test_estimator_checks(estimator, check):
    check(estimator)


SMALL = {"physical": {"highest": 4}, "network": {"hidden": (5,), "epochs": 5}}
SMALL["hybrid"] = SMALL["network"] | {"n_members": 2}


@pytest.fixture(scope="module")
def readings():
    """Angles of the three-joint arm and its own tips in another frame, with 0.01 mm of noise."""
    arm, rng = zigzag(3), np.random.default_rng(20170101)
    angles = rng.uniform(-1, 1, (60, 3))
    points = arm.chain.tip_in_base(angles)[:, [1, 2, 0]] + [300.0, -200.0, 50.0] + rng.normal(0, 0.01, (60, 3))
    return arm, angles, points


@pytest.fixture(scope="module")
def fitted(readings):
    """The model of a name, fitted once to all of them."""
    arm, angles, points = readings
    return cache(lambda name: MODELS[name](arm, **SMALL.get(name, {})).fit(angles, points))


def test_pipeline_with_group_splits_scores_every_fold(readings):
    arm, angles, points = readings
    pipeline = make_pipeline(FunctionTransformer(np.radians), KinematicModel(arm))
    groups = np.repeat(np.arange(12), 5)
    scores = cross_val_score(pipeline, np.degrees(angles), points, groups=groups, cv=GroupKFold(2))
    assert scores.shape == (2,)
    assert (scores > 0.999).all()  # 0.01 mm of noise in 100 mm


def test_grid_search_clones_and_chooses(readings):
    arm, angles, _ = readings
    points = arm.chain.tip_in_base(angles) + [2.0, -1.0, 0.5]
    search = GridSearchCV(NominalModel(arm), {"free": [("tip",), ("base", "tip")]}, cv=3).fit(angles, points)
    assert search.best_estimator_.arm is not None
    assert search.best_params_ == {"free": ("base", "tip")}


def test_parameters_come_back_as_they_were_set():
    model = KinematicModel(zigzag(2), free=("tip",))
    assert model.set_params(**model.get_params()).get_params() == model.get_params()
    assert model.set_params(free=("base",)).free == ("base",)
    assert "free=('base',)" in repr(model)
    assert "robust" not in repr(model)  # it is as by default
    refuses("KinematicModel has no parameter 'fre'", model.set_params, fre=())


def test_pipelines_reach_the_parameters_of_a_model(readings):
    arm = readings[0]
    pipeline = make_pipeline(FunctionTransformer(np.radians), NominalModel(arm))
    pipeline.set_params(nominalmodel__free=("tip",))
    assert pipeline.get_params()["nominalmodel__free"] == ("tip",)
    assert "NominalModel" in pipeline._repr_html_()


def test_metadata_routing_passes_requested_weights(readings):
    arm, angles, points = readings
    weight = np.ones(len(angles))
    with config_context(enable_metadata_routing=True):
        model = NominalModel(arm).set_fit_request(sample_weight=True).set_score_request(sample_weight=False)
        assert clone(model).get_metadata_routing().fit.requests == {"sample_weight": True}
        scores = cross_val_score(model, angles, points, cv=3, params={"sample_weight": weight})
    assert (scores > 0.999).all()  # 0.01 mm of noise in 100 mm


def test_metadata_requests_need_metadata_routing(readings):
    with pytest.raises(RuntimeError, match="enable_metadata_routing=True"):
        NominalModel(readings[0]).set_fit_request(sample_weight=True)


@pytest.mark.parametrize("name", MODELS)
def test_fitting_twice_equals_fitting_once(name, readings, fitted):
    _, angles, points = readings
    twice = clone(fitted(name)).fit(angles[:30], points[:30]).fit(angles, points).predict(angles)
    np.testing.assert_array_equal(fitted(name).predict(angles), twice)


@pytest.mark.parametrize("name", MODELS)
def test_covariance_is_symmetric_positive_and_as_long_as_the_points(name, readings, fitted):
    predicted, covariance = fitted(name).predict(readings[1][:7], return_cov=True)
    assert predicted.shape == (7, 3)
    assert covariance.shape == (7, 3, 3)
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_what_does_not_fit_the_arm_is_refused(readings):
    arm, angles, points = readings
    model = NominalModel(arm)
    refuses("expected readings of 3 joints", model.fit, angles[:, :2], points)
    refuses(r"\(n, 3\)", model.fit, angles, points[:, :2])
    with pytest.raises(ValueError, match="minimum of 4"):
        model.fit(angles[:3], points[:3])
    with pytest.raises(ValueError, match="NaN"):
        model.fit(np.where(np.arange(60)[:, None] == 5, np.nan, angles), points)
    refuses("free parts", NominalModel(arm, free=("elbow",)).fit, angles, points)
    refuses("expected an Arm", NominalModel("gao2017").fit, angles, points)
    refuses("trainer", NetworkModel(arm, trainer="adam").fit, angles, points)
    for options in ({"epochs": 0}, {"hidden": 5}, {"hidden": (5.0,)}, {"validation": 1.0}, {"goal": np.nan}):
        refuses("expected", NetworkModel(arm, **options).fit, angles, points)
    for highest in (0, -1, 1001, 2.0, "8", None):
        refuses("expected a highest order from 1 to 1000", PhysicalModel(arm, highest=highest).fit, angles, points)
    with pytest.raises(InputError, match="180 coordinates for 1143 weights.*Try: use validation data"):
        NetworkModel(arm, validation=0).fit(angles, points)


def test_rows_beyond_the_training_angles_are_flagged(readings):
    arm, angles, points = readings
    model = NominalModel(arm).fit(angles, points)
    beyond = angles[:3].copy()
    beyond[1, 2] = angles[:, 2].max() + 2 * Session.limit_tolerance
    assert model.outside_training(beyond).tolist() == [False, True, False]


def test_members_share_one_contract():
    assert all(issubclass(model, Compensator) for model in MODELS.values())


def test_what_one_pose_cannot_tell_comes_with_a_large_uncertainty(readings, rng):
    arm, angles, _ = readings
    nearby = angles[:1] + 1e-3 * rng.normal(size=(10, angles.shape[1]))  # farther than repeats, which count once
    model = NominalModel(arm).fit(nearby, arm.chain.tip_in_base(nearby) + rng.normal(0, 1e-4, (10, 3)))
    _, there = model.predict(angles[:1], return_cov=True)
    _, elsewhere = model.predict(angles[:1] + 1.0, return_cov=True)
    assert np.trace(elsewhere[0]) > 1e4 * np.trace(there[0])


@pytest.mark.parametrize("trainer", ["varpro", "trainlm", "trainbr"])
@pytest.mark.parametrize("validation", [0.0, 0.15])
def test_a_networks_stated_uncertainty_is_that_of_new_readings(validation, trainer, rng):
    """Within a factor of two, with and without validation data: 60 weights on 450 coordinates, noise 1 mm."""
    arm = zigzag(3)
    angles, others = rng.uniform(-0.5, 0.5, (150, 3)), rng.uniform(-0.45, 0.45, (300, 3))
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 1, (150, 3))
    model = NetworkModel(arm, free=(), hidden=(8,), validation=validation, trainer=trainer, epochs=60).fit(
        angles, points
    )
    predicted, covariance = model.predict(others, return_cov=True)
    errors = predicted - arm.chain.tip_in_base(others) - rng.normal(0, 1, (300, 3))
    whitened = errors**2 / np.diagonal(covariance, axis1=1, axis2=2)
    assert 0.5 < np.sqrt(whitened.mean()) < 2


# Weights, DataFrames, units ------------------------------------------------------------------------------------------


def test_weights_are_one_over_the_variance(rng):
    """Half of the points have ten times the noise; weights make them count as little as they should."""
    arm = zigzag(3)
    angles, others = rng.uniform(-1, 1, (200, 3)), rng.uniform(-1, 1, (200, 3))
    std = np.repeat([0.01, 0.1], 100)
    points = arm.chain.tip_in_base(angles) + std[:, None] * rng.normal(size=(200, 3))
    model = KinematicModel(arm, robust=False)

    def error(fitted):
        return np.abs(fitted.predict(others) - arm.chain.tip_in_base(others)).mean()

    weighted, plain = clone(model).fit(angles, points, sample_weight=std**-2), clone(model).fit(angles, points)
    assert error(weighted) < 0.5 * error(plain)
    assert weighted.fit_.references[0].noise_std == pytest.approx(0.01, rel=0.2)
    alike = clone(model).fit(angles, points, sample_weight=np.full(200, 7.0))
    np.testing.assert_array_equal(alike.predict(others), plain.predict(others))


@pytest.mark.parametrize("kind", [NominalModel, pytest.param(KinematicModel, marks=pytest.mark.weekly)])
def test_weights_of_any_size_are_no_stated_uncertainty(kind, rng):
    """Where four readings in a hundred count, the others scatter by far less than their weights say."""
    arm = zigzag(3)
    angles = rng.uniform(-1, 1, (100, 3))
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 0.01, (100, 3))
    weight = np.r_[np.ones(4), np.full(96, 1e-7)]
    model = kind(arm).fit(angles, points, sample_weight=weight)
    assert np.isfinite(model.predict(angles)).all()


def test_weight_zero_is_no_reading(readings):
    arm, angles, points = readings
    weight = np.r_[np.zeros(20), np.ones(40)]
    np.testing.assert_array_equal(
        KinematicModel(arm).fit(angles, points, sample_weight=weight).predict(angles),
        KinematicModel(arm).fit(angles[20:], points[20:]).predict(angles),
    )


@pytest.mark.parametrize("name", ["network", "hybrid"])
def test_networks_refuse_weights_with_the_reason(name, readings):
    arm, angles, points = readings
    model = MODELS[name](arm, **SMALL[name])
    with pytest.raises(InputError, match=f"a {name} model does not use sample_weight: its trainers .*Try: repeat"):
        model.fit(angles, points, sample_weight=np.arange(60.0) + 1)
    assert not hasattr(model, "nominal_")


@pytest.mark.parametrize("name", MODELS)
def test_data_frames_are_predicted_by_the_names_of_their_columns(name, readings, fitted):
    pd = pytest.importorskip("pandas")
    arm, angles, points = readings
    frame = pd.DataFrame(angles, columns=["q1", "q2", "q3"])
    model = MODELS[name](arm, **SMALL.get(name, {})).fit(frame, pd.DataFrame(points))
    assert model.feature_names_in_.tolist() == ["q1", "q2", "q3"]
    expected = fitted(name).predict(angles, return_cov=True)
    for one, other in zip(model.predict(frame, return_cov=True), expected, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(model.predict(frame), expected[0])  # which covariances beside them do not change
    with pytest.raises(ValueError, match="feature names"):
        model.predict(frame[["q3", "q2", "q1"]])


def test_wrong_units_and_arms_are_refused_at_fit(real, rng):
    session = real.points(60, rng)
    for angles, points in (
        (np.degrees(session.angles), session.points),
        (session.angles, session.points / 1000),
        (-session.angles, session.points),
    ):
        with pytest.raises(
            InputError,
            match="outside its limits|misses its references by .* Try: (check|put this right)|may be in m: convert",
        ):
            KinematicModel(real.arm).fit(angles, points)


def test_degrees_are_refused_at_prediction(real, rng):
    session = real.points(60, rng)
    model = KinematicModel(real.arm).fit_readings(session)
    refuses("outside.*check the unit", model.predict, np.degrees(session.angles))


@pytest.mark.parametrize("kind", ["nominal", "kinematic", "physical"])
def test_a_session_is_predicted_with_all_that_it_states(kind, rng):
    """`predict` takes a session as `predict_readings` does; its angles alone are another thing where it states more."""
    arm, angles = zigzag(4), rng.uniform(-1, 1, (40, 4))
    warm = Session(angles, arm.chain.tip_in_base(angles), temperature_degC=rng.uniform(15, 25, 40))
    model = MODELS[kind](arm, **SMALL.get(kind, {})).fit_readings(warm)
    points, covariance = model.predict(warm, return_cov=True)
    np.testing.assert_array_equal(points, model.predict_readings(warm))
    np.testing.assert_array_equal(covariance, model.predict_readings(warm, return_cov=True)[1])
    np.testing.assert_array_equal(model.predict(warm), points)
    np.testing.assert_array_equal(model.predict_nominal(warm), model.predict_nominal_readings(warm))
    np.testing.assert_array_equal(model.predict(Session(angles)), model.predict(angles))
