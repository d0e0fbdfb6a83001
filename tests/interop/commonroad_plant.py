"""Holds the two-track truck against the vehicle models of CommonRoad.

    python tests/interop/commonroad_plant.py target/debug/examples/plant_trajectories

Exits 1 at the first quantity that differs by more than its limit. Takes about 20 s of CPU.

CommonRoad's models (M. Althoff and G. Würsching, "CommonRoad: Vehicle Models", 2020) are other
people's code after other people's equations:

- `st`, a single track with cornering stiffness in proportion to load and load transfer along the
  truck. Our truck is made the same thing: stiff suspension and steering, no air, short relaxation.
- `mb`, 29 states after a model of the US Department of Transportation: roll, pitch, axles on
  tyres, wheel spin, magic formula. Both get their Vanagon; camber, which our truck ignores, and
  the tyres' asymmetries are switched off in theirs, the suspension's figures go into ours.

Ours is driven by commands; theirs follow with the steering angle and acceleration that ours
reports, so that actuators do not count.
"""

import math
import subprocess
import sys

import numpy
from vehiclemodels.init_mb import init_mb
from vehiclemodels.init_st import init_st
from vehiclemodels.parameters_vehicle3 import parameters_vehicle3
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st

PERIOD_S = 0.01
SUBSTEPS = 10
COLUMNS = ["time", "x", "y", "heading", "u", "v", "r", "ax", "ay", "roll", "steer"]


def step_steer(amplitude_rad):
    return lambda t: (0.0, amplitude_rad if t > 0.5 else 0.0)


def lane_change(amplitude_rad):
    return lambda t: (0.0, amplitude_rad * math.sin(math.pi * t) if t < 2 else 0.0)


def braked_turn(amplitude_rad, force_n):
    return lambda t: (force_n if t > 2 else 0.0, amplitude_rad if t > 0.5 else 0.0)


def drive(binary, changes, speed_mps, seconds, command):
    """Our truck's trajectory under a command(t) -> (force, steer), as a dictionary of arrays."""
    questions = [f"set {name} {value!r}" for name, value in changes.items()]
    questions.append(f"start two-track {speed_mps!r}")
    for step in range(round(seconds / PERIOD_S)):
        force_n, steer_rad = command(step * PERIOD_S)
        questions.append(f"run {PERIOD_S!r} {force_n!r} {steer_rad!r}")
    run = subprocess.run(
        [binary], input="\n".join(questions) + "\n", capture_output=True, text=True, timeout=300
    )
    answers = run.stdout.splitlines()
    if run.returncode or len(answers) != len(questions):
        sys.exit(f"{binary}: exit {run.returncode}, {len(answers)} answers: {run.stderr}")
    rows = [[float(number) for number in answer.split()] for answer in answers[len(changes) :]]
    return dict(zip(COLUMNS, numpy.array(rows).T))


def follow(ours, dynamics, start, parameters, accel_mps2):
    """Their trajectory under the steering ours had, and an acceleration: classical Runge-Kutta."""

    def slope(state, inputs):
        return numpy.array(dynamics(list(state), inputs, parameters))

    state, states = numpy.array(start, dtype=float), [start]
    for steer, accel in zip(numpy.diff(ours["steer"]) / PERIOD_S, accel_mps2):
        inputs, h = [steer, accel], PERIOD_S / SUBSTEPS
        for _ in range(SUBSTEPS):
            k1 = slope(state, inputs)
            k2 = slope(state + h / 2 * k1, inputs)
            k3 = slope(state + h / 2 * k2, inputs)
            k4 = slope(state + h * k3, inputs)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(state)
    return numpy.array(states).T


def linear_tyre(coefficient_per_rad, friction):
    """Our tyre with cornering stiffness in proportion to load, quick and without other slip."""
    far = 1e3
    return {
        "friction": friction,
        "tyre.rated_load_n": 1e4,
        "tyre.cornering_peak_load": far,
        "tyre.cornering_peak_per_rad": coefficient_per_rad * far / 2,
        "tyre.friction_load_slope": 0.0,
        "tyre.relaxation_min_m": 0.02,
        "tyre.carcass_x_n_per_m": 1e9,
        "tyre.carcass_y_n_per_m": 1e9,
        "rolling": 0.0,
        "drag_n_s2_per_m2": 0.0,
        "side_drag_n_s2_per_m2": 0.0,
        "steer_stiffness_nm_per_rad": 1e12,
        "front_tyres_per_wheel": 1.0,
        "rear_tyres_per_wheel": 1.0,
    }


def their_vanagon():
    """Their parameters, with what our truck does not model switched off: camber, asymmetric tyres,
    lateral give of tyres and axles; and without their limits on steering."""
    p = parameters_vehicle3()
    for name in ["p_hx1", "p_vx1", "r_hx1", "p_dy3", "p_hy1", "p_hy3", "p_vy1", "p_vy3"]:
        setattr(p.tire, name, 0.0)
    for name in ["r_by3", "r_hy1", "r_vy1", "r_vy3"]:
        setattr(p.tire, name, 0.0)
    p.K_lt, p.K_ras = 0.0, 30 * p.K_ras
    p.steering.v_min, p.steering.v_max = -10.0, 10.0
    return p


def our_vanagon(p):
    """The same vehicle in our parameters."""

    def roll_stiffness(spring, auxiliary, track):
        on_springs, on_tyres = spring * track**2 / 2 - auxiliary, p.K_zt * track**2 / 2
        return on_springs * on_tyres / (on_springs + on_tyres)

    return linear_tyre(-p.tire.p_ky1, p.tire.p_dy1) | {
        "mass_kg": p.m,
        "yaw_inertia_kgm2": p.I_z,
        "front_axle_m": p.a,
        "rear_axle_m": p.b,
        "front_track_m": p.T_f,
        "rear_track_m": p.T_r,
        "front_unsprung_kg": p.m_uf,
        "rear_unsprung_kg": p.m_ur,
        "sprung_height_m": p.h_s,
        "roll_inertia_kgm2": p.I_Phi_s,
        "pitch_inertia_kgm2": p.I_y_s,
        "front_roll_centre_m": p.h_raf,
        "rear_roll_centre_m": p.h_rar,
        "front_spring_n_per_m": 2 * p.K_sf,
        "rear_spring_n_per_m": 2 * p.K_sr,
        "front_damper_ns_per_m": 2 * p.K_sdf,
        "rear_damper_ns_per_m": 2 * p.K_sdr,
        "front_roll_stiffness_nm_per_rad": roll_stiffness(p.K_sf, p.K_tsf, p.T_f),
        "rear_roll_stiffness_nm_per_rad": roll_stiffness(p.K_sr, p.K_tsr, p.T_r),
        "front_roll_damping_nms_per_rad": p.K_sdf * p.T_f**2 / 2,
        "rear_roll_damping_nms_per_rad": p.K_sdr * p.T_r**2 / 2,
        "wheel_radius_m": p.R_w,
        "front_wheel_inertia_kgm2": p.I_y_w,
        "rear_wheel_inertia_kgm2": p.I_y_w,
        "tyre.shape": p.tire.p_cy1,
        "tyre.curvature": p.tire.p_ey1,
        "tyre.slip_stiffness": p.tire.p_kx1,
    }


def our_truck():
    """The nominal truck with a single track's tyres: no air, hardly any roll, stiff steering."""
    return linear_tyre(5.9, 0.85) | RIGID


def their_truck():
    """The same for their single track, which only takes these."""
    p = their_vanagon()
    p.m, p.I_z, p.a, p.b, p.h_s = 5760.0, 34802.6, 1.11, 3.89, 1.0158
    p.tire.p_ky1, p.tire.p_dy1 = -5.9, 0.85
    return p


# A single track does not roll, and its wheels have no inertia.
RIGID = {
    "front_roll_stiffness_nm_per_rad": 1e7,
    "rear_roll_stiffness_nm_per_rad": 1e7,
    "front_wheel_inertia_kgm2": 0.5,
    "rear_wheel_inertia_kgm2": 0.5,
}


def worst(ours, theirs):
    """Largest difference over largest value."""
    return float(numpy.max(numpy.abs(ours - theirs)) / numpy.max(numpy.abs(theirs)))


def judge(what, ours, differences):
    """Prints the differences and fails if one is above its limit."""
    shown = ", ".join(f"{name} {100 * share:.2f} %" for name, (share, _) in differences.items())
    print(f"{what}, up to {numpy.max(numpy.abs(ours['ay'])):.2f} m/s²: {shown}", flush=True)
    for name, (share, limit) in differences.items():
        if not share <= limit:
            sys.exit(f"{what}: {name} differs by {100 * share:.2f} %, allowed are {100 * limit} %")


def against_single_track(binary, what, changes, p, speed_mps, command):
    """Small amplitudes, where tyres are linear: 1.5 %. In a braked turn ours moves load with a
    delay and brake slip takes a little side force: 3 %, as for slip angles, small differences."""
    ours = drive(binary, changes, speed_mps, 6.0, command)
    start = init_st([0, 0, 0, speed_mps, 0, 0, 0])
    theirs = follow(ours, vehicle_dynamics_st, start, p, ours["ax"])
    slip_angle = numpy.arctan(ours["v"] / ours["u"])
    limit = 0.03 if "braked" in what else 0.015
    differences = {
        "yaw rate": (worst(ours["r"], theirs[5]), limit),
        "slip angle": (worst(slip_angle, theirs[6]), 0.03),
        "y": (worst(ours["y"], theirs[1]), limit),
    }
    judge(f"single track, {what} at {speed_mps} m/s", ours, differences)


def against_multi_body(binary, what, changes, p, speed_mps, command):
    """Coasting. Their tyres slip with the speed of the sprung mass's CG, ours with that of the
    contact point, so the onset of roll differs: 2.5 %, and roll is compared where it is steady."""
    ours = drive(binary, changes, speed_mps, 6.0, command)
    start = init_mb([0, 0, 0, speed_mps, 0, 0, 0], p)
    theirs = follow(ours, vehicle_dynamics_mb, start, p, 0 * ours["ax"])
    differences = {
        "yaw rate": (worst(ours["r"], theirs[5]), 0.025),
        "y": (worst(ours["y"], theirs[1]), 0.025),
    }
    if abs(ours["r"][-1]) > 0.01:
        differences["final roll"] = (abs(ours["roll"][-1] / theirs[6][-1] + 1), 0.02)
    judge(f"multi body, {what}", ours, differences)


def main():
    binary = sys.argv[1]
    vanagons = our_vanagon(their_vanagon()) | RIGID, their_vanagon()
    trucks = our_truck(), their_truck()
    for name, (changes, p), brake_n in [("van", vanagons, -1.5e3), ("truck", trucks, -6e3)]:
        for speed_mps in [10.0, 20.0]:
            for what, command in [
                ("step", step_steer(0.005)),
                ("lane change", lane_change(0.005)),
                ("braked turn", braked_turn(0.005, brake_n)),
            ]:
                against_single_track(binary, f"{name}, {what}", changes, p, speed_mps, command)
    p = their_vanagon()
    for what, command in [
        ("step of 0.02 rad", step_steer(0.02)),
        ("step of 0.04 rad", step_steer(0.04)),
        ("step of 0.06 rad", step_steer(0.06)),
        ("lane change of 0.02 rad", lane_change(0.02)),
        ("lane change of 0.06 rad", lane_change(0.06)),
    ]:
        against_multi_body(binary, what, our_vanagon(p), p, 15.0, command)


if __name__ == "__main__":
    main()
