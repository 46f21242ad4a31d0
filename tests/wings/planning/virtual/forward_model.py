"""A plain forward model of the virtual arm, independent of the package: loops over joints, 4 x 4 matrices.

It draws the errors of an arm from the documented streams of random numbers and knows no terms. Only the nominal chain
(matrices, tip), the preset's numbers and the state's are taken from the package.
"""

import math

import numpy as np

ARCSEC = math.pi / 648000
G = 9.80665


def stream(seed: int, what: str) -> np.random.Generator:
    return np.random.default_rng([1, seed, *what.encode()])


def rotation(vector) -> np.ndarray:
    """Rodrigues' formula."""
    angle = math.sqrt(sum(v * v for v in vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = (v / angle for v in vector)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def matrix(motion) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = rotation(motion[:3])
    T[:3, 3] = motion[3:]
    return T


def nominal_frames(chain, q) -> list[np.ndarray]:
    """Frame of the base's place, of every joint's, and of the flange."""
    T = chain.fixed[0].copy()
    frames = [T]
    for i, angle in enumerate(q, start=1):
        T = T @ matrix([0, 0, angle, 0, 0, 0])
        frames.append(T)
        T = T @ chain.fixed[i]
    return [*frames, T]


def link_vectors(chain) -> list[np.ndarray]:
    """Stand and links, along the axes of the places where they start [mm]."""
    n = len(chain.fixed) - 1
    vectors = [chain.fixed[0][:3, :3].T @ chain.fixed[0][:3, 3]]
    vectors += [chain.fixed[i][:3, 3].copy() for i in range(1, n + 1)]
    vectors[n] = vectors[n] + chain.fixed[n][:3, :3] @ chain.tip_in_flange
    return vectors


def load_at_joint(chain, q, masses, gravity, joint) -> tuple[np.ndarray, np.ndarray]:
    """Torque [N m] about a joint's origin and force [N] by all outward of it, along the joint's axes."""
    frames = nominal_frames(chain, q)
    torque, force = np.zeros(3), np.zeros(3)
    for k in range(joint, len(q) + 1):
        mass, centre = masses.mass_kg[k - 1], frames[k] @ [*masses.centre_in_joint_mm[k - 1], 1.0]
        arm_m = (centre[:3] - frames[joint][:3, 3]) / 1000
        torque += np.cross(arm_m, mass * gravity)
        force += mass * gravity
    R = frames[joint][:3, :3]
    return R.T @ torque, R.T @ force


def cantilever(link_mm, torque, force, share, EI, GJ) -> np.ndarray:
    """Motion at the held end that moves the far end as an Euler-Bernoulli beam with a share of own weight does."""
    L = np.linalg.norm(link_mm) / 1000
    if L == 0:
        return np.zeros(6)
    u = np.asarray(link_mm) / 1000 / L
    own, carried = share * force, (1 - share) * force
    across = torque - (torque @ u) * u
    slope = (L * across - L**2 / 2 * np.cross(u, carried) - L**2 / 3 * np.cross(u, own)) / EI
    moment = (L**2 / 2 * across - L**3 / 6 * np.cross(u, carried) - L**3 / 8 * np.cross(u, own)) / EI
    turn = slope + L * (torque @ u) * u / GJ
    shift = 1000 * np.cross(moment, u)
    return np.concatenate([turn, shift - np.cross(turn, np.asarray(link_mm))])


class PlainArm:
    """The errors of one arm, class by class."""

    def __init__(self, arm, preset, seed, masses, geometry=None):
        n = self.n = arm.n_joints
        self.chain, self.preset, self.masses = arm.chain, preset, masses
        self.gravity = G * np.asarray(arm.gravity_direction)
        normal = stream(seed, "geometry").standard_normal((n + 2, 6))
        self.geometry = normal * ([np.radians(preset.angle_std_deg)] * 3 + [preset.length_std_mm] * 3)
        self.geometry[-1, :3] = 0
        if geometry is not None:  # as a constrained draw gives it
            self.geometry = geometry
        e = 2e-3 * preset.eccentricity_std_um / preset.grating_diameter_mm
        stds = [e, preset.encoder_order2_std_arcsec * ARCSEC, preset.encoder_order4_std_arcsec * ARCSEC]
        self.encoder = stream(seed, "encoder").standard_normal((n, 3, 2)) * np.array(stds)[:, None]
        tilt, runout = preset.bearing_tilt_std_arcsec * ARCSEC, preset.bearing_runout_std_um / 1000
        five = np.array([tilt, tilt, 0, runout, runout, runout])
        self.bearing = [
            share * stream(seed, f"bearing {k}").standard_normal((n, 2, 6)) * five
            for k, share in ((1, 1.0), (2, preset.bearing_order2_ratio))
        ]
        tilt, runout = preset.cage_tilt_std_arcsec * ARCSEC, preset.cage_runout_std_um / 1000
        self.cage = stream(seed, "cage").standard_normal((n, 2, 6)) * [tilt, tilt, 0, runout, runout, runout]
        self.softness = np.exp(preset.stiffness_spread * stream(seed, "stiffness").standard_normal((n, 2)))
        spread = stream(seed, "temperature").standard_normal(n + 1)
        self.expansion = preset.expansion_per_K + preset.expansion_spread_per_K * spread
        self.hysteresis = preset.hysteresis_std_arcsec * ARCSEC * stream(seed, "hysteresis").standard_normal(n)

    def motion(self, place, q, direction, temperature, force, phase) -> np.ndarray:
        """Motion at a place in one pose: all classes added up."""
        p, n = self.preset, self.n
        out = self.geometry[place].copy()
        if place <= n:
            out[3:] += self.expansion[place] * (temperature[place] - 20) * link_vectors(self.chain)[place]
        else:
            out[3:] += p.tip_compliance_um_per_N / 1000 * force
        if 1 <= place <= n:
            i, angle = place - 1, q[place - 1]
            for (cosine, sine), order in zip(self.encoder[i], (1, 2, 4), strict=True):
                out[2] += cosine * math.cos(order * angle) + sine * math.sin(order * angle)
            for order in (1, 2):
                cosine, sine = self.bearing[order - 1][i]
                out += cosine * math.cos(order * angle) + sine * math.sin(order * angle)
            cage = p.cage_ratio * angle + phase[i]
            out += self.cage[i][0] * math.cos(cage) + self.cage[i][1] * math.sin(cage)
            out[2] += self.hysteresis[i] * direction[i]
            torque, weight = load_at_joint(self.chain, q, self.masses, self.gravity, place)
            tilt, drive = p.joint_tilt_arcsec_per_Nm * ARCSEC, p.joint_drive_arcsec_per_Nm * ARCSEC
            out[:3] += self.softness[i, 0] * np.array([tilt, tilt, drive]) * torque
            outward = sum(self.masses.mass_kg[i:])
            share = self.masses.mass_kg[i] / outward if outward > 0 else 0.0
            stiffness = p.link_bending_stiffness_Nm2, p.link_torsion_stiffness_Nm2
            link = link_vectors(self.chain)[place]
            out += self.softness[i, 1] * cantilever(link, torque, weight, share, *stiffness)
        return out

    def tip(self, q, direction, temperature, force, phase) -> np.ndarray:
        """Tip in the base frame in one pose [mm], motions composed as finite ones."""
        state = q, direction, temperature, force, phase
        T = self.chain.fixed[0] @ matrix(self.motion(0, *state))
        for place, angle in enumerate(q, start=1):
            T = T @ matrix([0, 0, angle, 0, 0, 0]) @ matrix(self.motion(place, *state)) @ self.chain.fixed[place]
        return (T @ [*(self.chain.tip_in_flange + self.motion(self.n + 1, *state)[3:]), 1.0])[:3]
