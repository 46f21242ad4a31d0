"""What single errors do to single-point articulation and to lengths: a table computed elsewhere, reproduced.

The table (means over some 60 trials, random seats, ten random full-range poses in each) does not say where the seats
stood, nor between which points lengths were taken. Here the seats stand in a box before the arm, and lengths go from
the poses in one seat to those in another. Of its 32 numbers 30 come out within 20 %. The other two, and the scatter of
the rest, are the table's: its rows for 5 and 50 arcsec of the same error are in the ratio 1 : 13 in the columns of
lengths, where no error so small leaves the ratio 1 : 10.
"""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm.arm import Arm
from truearm.arm.denavit_hartenberg import chain_from_dh
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.wings.laboratory.standards.asme_b89_4_22 import SEAT_STATISTICS
from truearm.wings.laboratory.tasks.sampled_arms import PresetDistribution
from truearm.wings.planning.virtual import Preset

TRIALS, SEATS, POSES = 300, 3, 10
LOW, HIGH = (300.0, -600.0, 0.0), (900.0, 600.0, 600.0)  # of the seats [mm]
A, D = np.array([0, 62, 0, 62, 0, 0.0]), np.array([376.5, 0, 650, 0, 500, 15.0])
ARM = Arm("table", chain_from_dh(a=A, d=D, alpha=np.radians([-90, -90, 90, -90, 90, -90]), tip_in_flange=(0, 0, 150)))
# The table states amplitudes of harmonics with a random phase; a preset has standard deviations of cosine and sine.
EACH = 1 / np.sqrt(2)
ECCENTRICITY_UM = 60 / 412.5  # of one arcsec at a grating of 60 mm

GEOMETRY = Preset(length_std_mm=1.0, angle_std_deg=1.0)  # the table's geometry replaces what is drawn

# Error: preset and, of geometry, standard deviations of a and d [mm] and of alpha and theta [deg]; then the largest
# deviation in a seat, 2 s in a seat, lengths: root mean square, 95 % [um].
ROWS = {
    "white 1 arcsec": (Preset(encoder_noise_arcsec=1), None, (9, 12, 4.7, 10)),
    "white 3 arcsec": (Preset(encoder_noise_arcsec=3), None, (28, 35, 14, 31)),
    "1st harmonic 5 arcsec": (Preset(eccentricity_std_um=5 * EACH * ECCENTRICITY_UM), None, (28, 38, 14, 27)),
    "2nd harmonic 3 arcsec": (Preset(encoder_order2_std_arcsec=3 * EACH), None, (16, 21, 9, 18)),
    "1st harmonic 50 arcsec": (Preset(eccentricity_std_um=50 * EACH * ECCENTRICITY_UM), None, (268, 357, 182, 364)),
    "geometry 0.05 mm, 0.005 deg": (GEOMETRY, (0.05, 0.005), (305, 419, 208, 509)),
    "geometry 0.5 mm, 0.1 deg": (GEOMETRY, (0.5, 0.1), (4800, 6800, 2400, 4600)),
    "contact 5 um": (Preset(seat_std_mm=0.005), None, (13, 17, 7, 14)),
}


def in_seats(rng, n_seats):
    """Poses that put the tip in random seats, found from starts all over the joints' full turns, (n, POSES, 6)."""
    starts = 6 * POSES
    points = rng.uniform(LOW, HIGH, (n_seats, 3))
    found = solve_inverse_kinematics(
        ARM.chain, np.repeat(points, starts, axis=0), start=rng.uniform(-np.pi, np.pi, (n_seats * starts, 6))
    )
    reached = found.reached.reshape(n_seats, starts)
    angles = found.angles.reshape(n_seats, starts, 6)
    assert (reached.sum(axis=1) >= POSES).all()
    return np.stack([one[good][:POSES] for one, good in zip(angles, reached, strict=True)])


def dh_errors(std, rng):
    """Errors of a table's a, d, alpha and theta as motions of the joints' places, to first order (n_places, 6)."""
    a, d = std[0] * rng.standard_normal((2, 6))
    alpha, theta = np.radians(std[1]) * rng.standard_normal((2, 6))
    out = np.zeros((ARM.chain.n_places, 6))
    # A turn alpha about the x axis through the link's end (a, 0, d) is one about the joint's, and a shift along y.
    out[1:-1] = np.column_stack([alpha, 0 * alpha, theta, a, D * alpha, d])
    return out


def table_row(preset, geometry, poses, seed):
    """The four numbers [um]."""
    largest, twice, lengths = [], [], []
    rng = np.random.default_rng([seed, 1])
    for trial, here in enumerate(poses):
        drawn = PresetDistribution(ARM, preset).draw(seed + trial)
        if geometry is not None:
            systematic = drawn.virtual.systematic.with_geometry(dh_errors(geometry, rng))
            drawn = replace(drawn, virtual=replace(drawn.virtual, systematic=systematic))
        angles = here.reshape(-1, 6)
        errors = (drawn.systematic(angles) + drawn.random(angles, rng)).reshape(SEATS, POSES, 3)
        tips = ARM.chain.tip_in_base(angles).reshape(SEATS, POSES, 3)
        largest.append(SEAT_STATISTICS["SPAT.Max"](tips + errors))
        twice.append(SEAT_STATISTICS["SPAT.2s"](tips + errors))
        for i, j in ((0, 1), (1, 2), (2, 0)):
            along = tips[i] - tips[j]
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            lengths.append(((errors[i] - errors[j]) * along).sum(axis=1))
    lengths = np.concatenate(lengths)
    return 1e3 * np.array(
        [np.mean(largest), np.mean(twice), np.sqrt((lengths**2).mean()), np.quantile(np.abs(lengths), 0.95)]
    )


@pytest.fixture(scope="module")
def reproduced():
    poses = in_seats(np.random.default_rng(0), TRIALS * SEATS).reshape(TRIALS, SEATS, POSES, 6)
    return {name: table_row(preset, geometry, poses, seed=0) for name, (preset, geometry, _) in ROWS.items()}


# Lengths of the smaller geometry: see `test_the_smaller_geometry_is_as_calculated_by_hand`.
NOT_MET = {("geometry 0.05 mm, 0.005 deg", 2), ("geometry 0.05 mm, 0.005 deg", 3)}


def test_single_errors_do_what_the_table_says(reproduced):
    """Within 20 %, but for two numbers of one row."""
    off = {
        (name, column): float(ratio)
        for name, (_, _, table) in ROWS.items()
        for column, ratio in enumerate(reproduced[name] / np.array(table))
        if abs(ratio - 1) > 0.20
    }
    assert set(off) == NOT_MET, off
    assert min(off.values()) > 0.6


def test_errors_are_proportional_where_the_table_is_not(reproduced):
    """3 arcsec of noise do three times what one does, 50 of a harmonic ten times what 5 do, with the same draws."""
    assert reproduced["white 3 arcsec"] / reproduced["white 1 arcsec"] == pytest.approx([3] * 4, rel=0.01)
    ratio = reproduced["1st harmonic 50 arcsec"] / reproduced["1st harmonic 5 arcsec"]
    assert ratio == pytest.approx([10] * 4, rel=0.01)
    stated = np.array(ROWS["1st harmonic 50 arcsec"][2]) / ROWS["1st harmonic 5 arcsec"][2]
    assert stated[:2] == pytest.approx([10] * 2, rel=0.07)
    assert (stated[2:] > 12.9).all()


def test_the_smaller_geometry_is_as_calculated_by_hand(reproduced):
    """Lengths between poses in two seats: 0.17 mm rms, where the table has 0.21, and 95 % at twice that, not at 2.4.

    Eleven lengths (all but d of joint 1) of 0.05 mm have directions at the two poses that are nearly independent and
    even over the sphere: each moves the length by 0.05 sqrt(2/3) mm, all by 0.135. Eleven angles (all but theta of
    joint 1) of 18 arcsec move it as the noise of 18 arcsec of six joints does, 1 arcsec of which is 4.7 um: 0.085 mm,
    times sqrt(11/6). Together 0.18 mm. A sum of so many normal errors is near normal: 95 % at 2 standard deviations.
    """
    of_lengths = 1e3 * 0.05 * np.sqrt(11 * 2 / 3)
    of_angles = 18 * 4.7 * np.sqrt(11 / 6)
    rms, high = reproduced["geometry 0.05 mm, 0.005 deg"][2:]
    assert rms == pytest.approx(np.hypot(of_lengths, of_angles), rel=0.1)
    assert high / rms == pytest.approx(2, rel=0.05)
