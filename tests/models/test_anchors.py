"""Distances to anchors at unknown places: they identify the arm with its size, alone and beside points and seats."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.identification.references.alignment import align
from truearm.identification.references.reading_references import references_of
from truearm.models import KinematicModel, NominalModel
from truearm.models.model_file import load_model
from truearm.models.refit import refit
from truearm.readings import Session
from truearm.readings.anchors import distance_errors
from truearm.verbs.fit import fit

STD, POSES = 0.02, 40
ANCHORS = np.array([[900.0, 200.0, 100.0], [-700.0, 800.0, -200.0], [100.0, -1000.0, 500.0]])
OFFSETS = np.array([0.4, -0.7, 0.2])


def measured(chain, angles, rng, *, offsets=OFFSETS, std=STD):
    """A session with a distance to each anchor at every pose."""
    tips, k = chain.tip_in_base(angles), len(ANCHORS)
    distance = np.linalg.norm(tips[:, None] - ANCHORS, axis=2) + offsets + rng.normal(0, std, (len(tips), k))
    return Session(
        np.repeat(angles, k, axis=0),
        anchor=np.tile(["A", "B", "C"], len(tips)),
        distance_mm=distance.ravel(),
        u_distance_mm=np.full(distance.size, std),
    )


@pytest.fixture(scope="module")
def wires(real):
    rng = np.random.default_rng(11)
    return measured(real.chain, real.arm.working + rng.uniform(-1, 1, (POSES, 6)), rng)


@pytest.fixture(scope="module")
def model(real, wires):
    return KinematicModel(real.arm).fit_readings(wires)


def elsewhere(real):
    return real.arm.working + 0.8 * np.random.default_rng(12).uniform(-1, 1, (200, 6))


def shape_error(real, model):
    """Mean error of points whose frame was fitted [mm]: distances say nothing about the frame."""
    angles = elsewhere(real)
    predicted, true = model.predict(angles), real.chain.tip_in_base(angles)
    T = align(predicted, true)
    return np.linalg.norm(predicted @ T[:3, :3].T + T[:3, 3] - true, axis=1).mean()


def test_distances_alone_find_the_arm_and_the_offsets(real, wires, model):
    nominal = NominalModel(real.arm).fit_readings(wires)
    assert model.free_ == nominal.free_ == ("tip",)
    # 120 distances of 0.02 mm determine some 23 constants: 0.02 mm times the root of 23 of 120, and leverage.
    assert shape_error(real, model) < 0.03 < 0.1 * shape_error(real, nominal)
    (part,) = model.fit_.references
    # An offset is determined to 0.02 mm over the root of 40 distances, times the correlation with the anchor's place.
    found = [part.unknowns[f"offset of anchor {name} [mm]"] for name in "ABC"]
    np.testing.assert_allclose(found, OFFSETS, atol=0.1)


def test_distances_determine_the_size(real, model):
    angles = elsewhere(real)
    predicted, true = model.predict(angles), real.chain.tip_in_base(angles)
    scale = np.sqrt(predicted.var(axis=0).sum() / true.var(axis=0).sum())
    # 0.02 mm over half a metre, by 120 distances.
    assert scale == pytest.approx(1.0, abs=1e-4)


def test_a_stated_scale_of_distances_is_in_the_uncertainty(real, wires, model):
    """A ruler 0.05 % too long: the covariance that its stated scale adds is what it does to the arm."""
    angles, of_ruler = elsewhere(real), replace(wires, u_scale_ppm=np.full(len(wires), 500.0))
    stated = KinematicModel(real.arm).fit_readings(of_ruler)
    longer = KinematicModel(real.arm).fit_readings(replace(wires, distance_mm=1.0005 * wires.distance_mm))
    moved = longer.predict(angles) - model.predict(angles)
    added = np.subtract(*(one.predict(angles, return_cov=True)[1] for one in (stated, model)))
    # To first order; scales of the priors and weights hardly change.
    np.testing.assert_allclose(added, np.einsum("ni,nj->nij", moved, moved), atol=0.05 * np.abs(added).max())
    assert stated.length_scale_.u > 5e-4
    remarks = [" ".join(fit(real.arm, one, model="kinematic").remarks) for one in (wires, of_ruler)]
    rest = "All lengths of the arm rest on the scale of the distances, "
    assert f"{rest}which count as exact" in remarks[0]
    assert f"{rest}as uncertain as stated, 0.05 %." in remarks[1]


def test_held_out_distances_are_compared_pose_by_pose(wires, model):
    held = model.held_out_
    assert held.n_coordinates == 1
    np.testing.assert_array_equal(np.sort(held.rows), np.arange(3 * POSES))
    assert len(np.unique(held.group)) == POSES
    whitened = held.deviations[:, 0] ** 2 / (held.covariance[:, 0, 0] + model.residual_std_**2)
    # 120 squares of a standard normal deviate: mean 1, standard deviation 0.13.
    assert whitened.mean() == pytest.approx(1.0, abs=0.4)
    assert not len(model.held_out_distances_.rows)


def test_a_held_out_pose_is_predicted_as_by_an_arm_identified_without_it(real, wires, model):
    """The closed form against another fit; prior scales and noise differ by some per cent between the two."""
    group = model.held_out_.group
    without = wires.rows(np.arange(len(wires)) >= 3)
    again = KinematicModel(real.arm).fit_readings(without)
    unknowns = again.fit_.references[0].unknowns
    predicted = [
        np.linalg.norm(
            again.predict_readings(wires.rows([row]))[0] - [unknowns[f"{c} of anchor {a} [mm]"] for c in "xyz"]
        )
        + unknowns[f"offset of anchor {a} [mm]"]
        - wires.distance_mm[row]
        for row, a in enumerate("ABC")
    ]
    rows = [int(np.flatnonzero(model.held_out_.rows == row)[0]) for row in range(3)]
    assert len(set(group[rows])) == 1
    np.testing.assert_allclose(model.held_out_.deviations[rows, 0], predicted, atol=0.2 * STD)


def test_gross_errors_and_a_wrong_zero_of_a_wire_are_named(real, wires):
    distance = wires.distance_mm + 12.0 * (wires.anchor == "A")
    distance[[10, 55]] += [3.0, -25.0]
    found = fit(real.arm, replace(wires, distance_mm=distance), model="kinematic")
    assert {outlier.row for outlier in found.outliers if outlier.is_excluded} == {10, 55}
    assert {outlier.kind for outlier in found.outliers} == {"distance"}
    assert [outlier.name for outlier in found.length_outliers] == ["offset of anchor A"]
    assert "offset of anchor A: 12." in "\n".join(str(block) for block in found.blocks())
    assert "Mean error of a distance" in found.summary()
    assert shape_error(real, found.model) < 0.03


def test_distances_join_points_and_seats(real, wires, rng):
    """Points place the base; the held-out distances are reported beside them."""
    seen, held = real.points(12, rng), real.held(rng)
    n = [len(wires), len(seen), len(held)]
    both = Session(
        np.concatenate([wires.angles, seen.angles, held.angles]),
        np.concatenate([np.full((n[0], 3), np.nan), seen.points, np.full((n[2], 3), np.nan)]),
        seat=np.concatenate([np.full(n[0] + n[1], ""), held.seat]),
        anchor=np.concatenate([wires.anchor, np.full(n[1] + n[2], "")]),
        distance_mm=np.concatenate([wires.distance_mm, np.full(n[1] + n[2], np.nan)]),
    )
    found = fit(real.arm, both, model="kinematic")
    assert [part.kind for part in found.model.fit_.references] == ["point", "seat", "distance"]
    assert found.model.free_ == ("base", "tip")
    angles = elsewhere(real)
    errors = np.linalg.norm(found.model.predict(angles) - real.chain.tip_in_base(angles), axis=1)
    assert errors.mean() < 0.03
    assert found.held_out_distances["n"] == n[0]
    assert found.held_out_distances["mean_mm"] < 2 * STD
    assert found.model.held_out_.n_coordinates == 3


def test_a_new_tip_is_found_by_distances(real, model, rng):
    longer = replace(real.chain, tip_in_flange=real.chain.tip_in_flange + [3.0, -2.0, 5.0])
    new = measured(longer, real.arm.working + rng.uniform(-1, 1, (20, 6)), rng)
    moved = refit(model, new, free=("tip",))
    assert distance_errors(moved.predict_readings(new), new)["distance_mean_mm"] < 3 * STD
    # Every wire of a pose is a reading of its own.
    assert moved.trained_on(new).all()
    assert not moved.trained_on(replace(new, distance_mm=new.distance_mm + STD)).any()


def test_the_error_is_that_of_an_arm_identified_again_where_the_others_do_not_determine_the_readings(real, wires):
    """Five distances and seven unknowns of tip and anchor: what is predicted of the sixth is worth little."""
    found = fit(real.arm, wires.rows(np.flatnonzero(wires.anchor == "A")[:6]), model="nominal")
    assert found.model.held_out_errors_.n == 6
    assert found.held_out_mm[0] > 20 * STD
    assert "held-out" in found.summary()


def test_a_distance_counts_as_one_residual_and_an_anchor_as_four_unknowns(real, wires):
    with pytest.raises(InputError, match=r"21 residuals .* do not determine .* 3 anchors .* that takes 24"):
        fit(real.arm, wires.rows(slice(21)), model="kinematic")


def test_unknowns_of_anchors_take_up_residuals(model, wires):
    freedom = model.fit_.residual_freedom(references_of(wires, None))
    effective = sum(group.effective for group in model.fit_.groups)
    assert freedom == pytest.approx(len(wires) - 3 * len(ANCHORS) - effective)  # the offsets have priors


def test_models_keep_the_anchors_in_their_file(model, tmp_path):
    model.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    assert again.fit_.references[0].unknowns == model.fit_.references[0].unknowns


def test_an_evaluation_lists_every_distance(real, model, rng):
    test = measured(real.chain, real.arm.working + 0.8 * rng.uniform(-1, 1, (10, 6)), rng)
    found = ta.evaluate(model, test)
    assert found.errors["model"]["distance_mean_mm"] < 0.1 * found.errors["nominal"]["distance_mean_mm"]
    assert "Mean error of a distance" in found.summary()
    assert len(found.to_dict()["distances"]) == 30
    refuses("has distances to anchors only", ta.report, model, test)


def test_too_few_distances_are_ignored_and_named(real, rng):
    seen = real.points(60, rng)
    anchor, distance = np.full(60, "", dtype="U1"), np.full(60, np.nan)
    anchor[:3], distance[:3] = "A", 700.0
    found = fit(real.arm, replace(seen, anchor=anchor, distance_mm=distance), model="nominal")
    assert "anchor A has 3 usable readings; at least 4 are needed. Ignored." in found.remarks


@pytest.mark.parametrize(("unit", "mm"), [("cm", 10.0), ("inch", 25.4)])
def test_distances_of_a_printed_arm_in_another_unit_are_named_with_it(unit, mm):
    """Its lengths are no better known than to some per cent, so that it may be of that size: what was said."""
    options = {"preset": "printed", "anchors": 3, "reference": False, "strategy": "uniform", "seed": 3}
    session = ta.simulate("so101", poses=40, **options).session
    with pytest.raises(InputError, match="shorter than drawn|misses its references") as caught:
        ta.fit("so101", replace(session, distance_mm=session.distance_mm / mm))
    assert f"the distances to anchors may be in {unit}: convert them to mm" in caught.value.hint


def test_distances_in_another_unit_are_refused(real, wires):
    with pytest.raises(InputError, match="misses its references"):
        NominalModel(real.arm).fit_readings(replace(wires, distance_mm=wires.distance_mm / 25.4).rows(np.arange(24)))
