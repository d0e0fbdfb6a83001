//! Drives a truck by commands from standard input, so that a plant of other authorship can be
//! driven alongside (`tests/interop/commonroad_plant.py`).
//!
//! One question per line, one answer per line:
//!
//! ```text
//! set NAME VALUE                -> ok            changes the two-track truck, before start
//! start MODEL SPEED_MPS         -> a state       single-track, two-track or prediction
//! run SECONDS FORCE_N STEER_RAD -> a state       one command, steps of 1 ms
//! state: time x y heading forward lateral yaw accel_forward accel_lateral roll steer
//! ```

use std::error::Error;
use std::io::{BufRead, Write};

use bench_sim::truck::{Command, PredictionParameters, Truck, TruckParameters, TwoTrackParameters};

const STEP_S: f64 = 1e-3;

type Answer = Result<String, Box<dyn Error>>;

fn main() -> Result<(), Box<dyn Error>> {
    let mut drive = Drive { parameters: TwoTrackParameters::default(), truck: None, steps: 0 };
    let mut output = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let answer = match words[..] {
            ["set", name, value] => drive.set(name, value.parse()?),
            ["start", model, speed] => drive.start(model, speed.parse()?),
            ["run", seconds, force, steer] => {
                drive.run(seconds.parse()?, force.parse()?, steer.parse()?)
            }
            _ => Err(format!("{line:?} is none of set, start, run").into()),
        };
        writeln!(output, "{}", answer?)?;
    }
    Ok(())
}

/// A truck under way.
struct Drive {
    parameters: TwoTrackParameters,
    truck: Option<Truck>,
    steps: u32,
}

impl Drive {
    fn start(&mut self, model: &str, forward_mps: f64) -> Answer {
        self.truck = Some(match model {
            "single-track" => Truck::new(TruckParameters::default(), 0.0, 0.0, forward_mps),
            "two-track" => Truck::new(self.parameters, 0.0, 0.0, forward_mps),
            "prediction" => Truck::new(PredictionParameters::default(), 0.0, 0.0, forward_mps),
            _ => return Err(format!("no model {model:?}").into()),
        });
        self.steps = 0;
        self.state()
    }

    fn run(&mut self, seconds: f64, force_n: f64, steer_rad: f64) -> Answer {
        let truck = self.truck.as_mut().ok_or("run before start")?;
        for _ in 0..(seconds / STEP_S).round() as u32 {
            truck.step(&Command { force_n, steer_rad }, STEP_S);
            self.steps += 1;
        }
        self.state()
    }

    fn state(&self) -> Answer {
        let truck = self.truck.as_ref().ok_or("no truck yet")?;
        let (s, a) = (truck.state(), truck.acceleration());
        let numbers = [
            f64::from(self.steps) * STEP_S,
            s.x_m,
            s.y_m,
            s.heading_rad,
            s.forward_mps,
            s.lateral_mps,
            s.yaw_radps,
            a.forward_mps2,
            a.lateral_mps2,
            truck.attitude().roll_rad,
            s.steer_rad,
        ];
        Ok(numbers.map(|number| format!("{number:?}")).join(" "))
    }

    fn set(&mut self, name: &str, value: f64) -> Answer {
        *self.parameter(name)? = value;
        // Both axles have the same tyres here.
        self.parameters.rear_tyre = self.parameters.tyre;
        Ok("ok".to_owned())
    }

    fn parameter(&mut self, name: &str) -> Result<&mut f64, Box<dyn Error>> {
        let p = &mut self.parameters;
        Ok(match name {
            "mass_kg" => &mut p.mass_kg,
            "yaw_inertia_kgm2" => &mut p.yaw_inertia_kgm2,
            "front_axle_m" => &mut p.front_axle_m,
            "rear_axle_m" => &mut p.rear_axle_m,
            "front_track_m" => &mut p.track_m[0],
            "rear_track_m" => &mut p.track_m[1],
            "front_unsprung_kg" => &mut p.unsprung_kg[0],
            "rear_unsprung_kg" => &mut p.unsprung_kg[1],
            "sprung_height_m" => &mut p.sprung_height_m,
            "roll_inertia_kgm2" => &mut p.roll_inertia_kgm2,
            "pitch_inertia_kgm2" => &mut p.pitch_inertia_kgm2,
            "front_roll_centre_m" => &mut p.roll_centre_m[0],
            "rear_roll_centre_m" => &mut p.roll_centre_m[1],
            "front_spring_n_per_m" => &mut p.spring_n_per_m[0],
            "rear_spring_n_per_m" => &mut p.spring_n_per_m[1],
            "front_damper_ns_per_m" => &mut p.damper_ns_per_m[0],
            "rear_damper_ns_per_m" => &mut p.damper_ns_per_m[1],
            "front_roll_stiffness_nm_per_rad" => &mut p.roll_stiffness_nm_per_rad[0],
            "rear_roll_stiffness_nm_per_rad" => &mut p.roll_stiffness_nm_per_rad[1],
            "front_roll_damping_nms_per_rad" => &mut p.roll_damping_nms_per_rad[0],
            "rear_roll_damping_nms_per_rad" => &mut p.roll_damping_nms_per_rad[1],
            "axle_roll_lag_s" => &mut p.axle_roll_lag_s,
            "wheel_radius_m" => &mut p.wheel_radius_m,
            "front_wheel_inertia_kgm2" => &mut p.wheel_inertia_kgm2[0],
            "rear_wheel_inertia_kgm2" => &mut p.wheel_inertia_kgm2[1],
            "front_tyres_per_wheel" => &mut p.tyres_per_wheel[0],
            "rear_tyres_per_wheel" => &mut p.tyres_per_wheel[1],
            "rolling" => &mut p.rolling,
            "drag_n_s2_per_m2" => &mut p.drag_n_s2_per_m2,
            "side_drag_n_s2_per_m2" => &mut p.side_drag_n_s2_per_m2,
            "engine_brake_max_n" => &mut p.engine_brake_max_n,
            "steer_stiffness_nm_per_rad" => &mut p.steer_stiffness_nm_per_rad,
            "friction" => &mut p.surroundings.friction,
            "tyre.rated_load_n" => &mut p.tyre.rated_load_n,
            "tyre.cornering_peak_per_rad" => &mut p.tyre.cornering_peak_per_rad,
            "tyre.cornering_peak_load" => &mut p.tyre.cornering_peak_load,
            "tyre.slip_stiffness" => &mut p.tyre.slip_stiffness,
            "tyre.friction_load_slope" => &mut p.tyre.friction_load_slope,
            "tyre.shape" => &mut p.tyre.shape,
            "tyre.curvature" => &mut p.tyre.curvature,
            "tyre.carcass_x_n_per_m" => &mut p.tyre.carcass_x_n_per_m,
            "tyre.carcass_y_n_per_m" => &mut p.tyre.carcass_y_n_per_m,
            "tyre.relaxation_min_m" => &mut p.tyre.relaxation_min_m,
            _ => return Err(format!("no parameter {name:?}").into()),
        })
    }
}
