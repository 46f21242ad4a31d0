"""
A reader of exported models, without truearm
============================================

Reads the JSON that `truearm export MODEL --out arm.json` writes and computes the tip. It needs NumPy only, and its
some seventy lines of code can be written again in any language. Copy this file into your program.
"""

import json

import numpy as np


def tips(path, joints, temperature_degC=None, directions=None, columns=None):
    """Tips (n, 3) [mm] at joints (n, n_joints) [rad, mm]; what is not stated is as on average in training."""
    with open(path, encoding="utf-8") as file:
        model = json.load(file)
    if model["model"] == "network":
        return network_tips(model["network"], np.asarray(joints, dtype=float))
    training = model["training"]
    if temperature_degC is None and training["temperature_degC"]:
        temperature_degC = training["temperature_degC"]["mean"]
    means = {name: stated["mean"] for name, stated in training["columns"].items()}
    state = {"columns": means | (columns or {}), "temperature_degC": temperature_degC}
    state["directions"] = np.zeros(len(joints[0])) if directions is None else directions
    return np.array([tip(model, q, state) for q in joints])


def tip(model, q, state):
    """The tip at one reading: F0 E0 J1(q1) E1 F1 ... Jn(qn) En Fn (tip + E(n+1)), with the motions E of the terms."""
    joints, chain = model["arm"]["joints"], model["identified"]["chain"]
    motions, torques = np.zeros((len(q) + 2, 6)), gravity_torques(model["arm"], q)
    for term in model["identified"]["terms"]:
        size = np.dot(term["coefficients"], [value(one, q, torques, state) for one in functions_of(term["basis"])])
        motions[term["place"]] += size * np.array(term["direction"])
    T = chain["fixed"][0] @ rigid_motion(motions[0])
    for joint, angle, motion, F in zip(joints, q, motions[1:-1], chain["fixed"][1:], strict=True):
        T = T @ joint_motion(joint, angle) @ rigid_motion(motion) @ F
    return T[:3, :3] @ (chain["tip_in_flange_mm"] + motions[-1, 3:]) + T[:3, 3]


def functions_of(basis):
    """A term's functions as expressions: a number, or a list of an operation and what it is of."""
    kind = basis["kind"]
    if kind == "Formula":
        return basis["functions"]
    if kind == "Harmonics":
        turns = [["product", k, ["angle", basis["joint"]]] for k in basis["orders"]]
        return [[function, turn] for turn in turns for function in ("cos", "sin")]
    inputs = {"GravityTorque": "gravity torque", "InSession": "session"}
    return [1.0 if kind == "Constant" else [inputs.get(kind, kind.lower()), *list(basis.values())[1:]]]


def value(expression, q, torques, state):
    """Value of an expression at one reading."""
    if not isinstance(expression, list):
        return expression
    kind, first, *more = expression
    if kind in ("sum", "product", "power", "cos", "sin"):
        x, *others = (value(one, q, torques, state) for one in (first, *more))
        if kind in ("cos", "sin"):
            return np.cos(x) if kind == "cos" else np.sin(x)
        return x ** others[0] if kind == "power" else x + sum(others) if kind == "sum" else x * np.prod(others)
    if kind in ("session", "tip"):
        return 0.0  # points are in the frame of the first session
    if kind == "temperature":
        return state["temperature_degC"] - 20.0
    if kind == "gravity torque":
        return torques[first][more[0]]
    return state["columns"][first] if kind == "column" else (q if kind == "angle" else state["directions"])[first - 1]


def gravity_torques(arm, q):
    """Torques of the weight on the base (first) and at each joint along the axes of its place, nominal chain [N m]."""
    places = [np.eye(4)]
    for joint, angle, F in zip(arm["joints"], q, arm["chain"]["fixed"], strict=False):
        places.append(places[-1] @ F @ joint_motion(joint, angle))
    weights = np.outer(arm["mass_kg"], arm["gravity_in_base_m_s2"])
    centres = np.array([T[:3] @ [*c, 1.0] for T, c in zip(places[1:], arm["centre_in_joint_mm"], strict=True)])
    levers = [(centres[i:] - T[:3, 3]) * 1e-3 for i, T in enumerate(places[1:])]
    torques = [
        T[:3, :3].T @ np.cross(r, weights[-len(r) :]).sum(axis=0) for T, r in zip(places[1:], levers, strict=True)
    ]
    return [joint_motion(arm["joints"][0], q[0])[:3, :3] @ torques[0], *torques]


def joint_motion(joint, q):
    """Motion (4, 4) of a joint that turns about z [rad] or slides along it [mm]."""
    return rigid_motion([0, 0, q, 0, 0, 0] if joint["kind"] == "revolute" else [0, 0, 0, 0, 0, q])


def rigid_motion(motion):
    """Motion (4, 4) that turns by a rotation vector [rad] and shifts then [mm]; np.sinc(x) is sin(pi x) / (pi x)."""
    T, (x, y, z) = np.eye(4), motion[:3]
    turns, K = np.linalg.norm(motion[:3]) / np.pi, np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T[:3, :3] += np.sinc(turns) * K + 0.5 * np.sinc(turns / 2) ** 2 * K @ K
    T[:3, 3] = motion[3:]
    return T


def network_tips(network, joints):
    """Tips (n, 3) [mm] of a network model: the mean of its members."""
    functions = {"tansig": np.tanh, "logsig": lambda x: 0.5 + 0.5 * np.tanh(0.5 * x), "purelin": lambda x: x}
    q0, q1 = np.array([network["joint_range"]["lower"], network["joint_range"]["upper"]])
    p0, p1 = np.array([network["point_range_mm"]["lower"], network["point_range_mm"]["upper"]])
    total = 0.0
    for member in network["members"]:
        values = (joints - (q0 + q1) / 2) / ((q1 - q0) / 2)
        for W, activation in zip(member["layers"], network["activations"], strict=True):
            values = functions[activation](values @ W[:-1] + W[-1])
        total = total + values / len(network["members"])
    return total * (p1 - p0) / 2 + (p0 + p1) / 2
