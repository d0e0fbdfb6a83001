use super::*;
use crate::bicycle::tests::textbook_slope;
use crate::calibration::TruckBelief;
use crate::wide::Work;

const START: State = [18.0, 0.05, 0.02, 0.01, 5.0, 1.0];
const PLAN: [[f64; 2]; BLOCKS] = [[2.0, 1.0], [5.0, 1.5], [-3.0, 0.5], [-8.0, -1.0], [0.0, -0.2]];

fn all(start: &State, plan: &[[f64; 2]; BLOCKS]) -> [Instant; STEPS] {
    let mut instants = [Instant { state: [0.0; STATES], gain: [[0.0; WIDTH]; STATES] }; STEPS];
    predict(&Bicycle::new(&TruckBelief::default()), start, plan, |k, instant| {
        instants[k] = *instant;
    });
    instants
}

/// Two classical Runge-Kutta steps over a prediction step, of the textbook's equations.
fn textbook_step(state: State, input: [f64; 2]) -> State {
    let truck = TruckBelief::default();
    let slope = |state: &State| textbook_slope(&truck, state, input);
    let h = 0.5 * STEP_S;
    let moved = |state: &State, slope: &State, h: f64| -> State {
        core::array::from_fn(|i| state[i] + h * slope[i])
    };
    (0..2).fold(state, |state, _| {
        let first = slope(&state);
        let second = slope(&moved(&state, &first, 0.5 * h));
        let third = slope(&moved(&state, &second, 0.5 * h));
        let fourth = slope(&moved(&state, &third, h));
        let sum: State =
            core::array::from_fn(|i| first[i] + 2.0 * second[i] + 2.0 * third[i] + fourth[i]);
        moved(&state, &sum, h / 6.0)
    })
}

#[test]
fn the_predicted_states_are_the_textbooks() {
    // From the highway, from below the guarded speed, and turned far enough to need the reduction
    // of angles.
    for start in [START, [7.0, 0.0, 0.1, 0.2, 0.0, 0.0], [15.0, 0.0, 0.1, 2.0, 0.0, 3.0]] {
        let mut state = start;
        for (k, instant) in all(&start, &PLAN).iter().enumerate() {
            state = textbook_step(state, PLAN[block(k)]);
            for i in 0..STATES {
                let error = (instant.state[i] - state[i]).abs();
                assert!(error < 1e-11, "{start:?}, step {k}, state {i}: {error:e}");
            }
        }
    }
}

#[test]
fn gains_agree_with_central_differences_of_the_rollout() {
    for start in [START, [7.0, 0.0, 0.1, 0.2, 0.0, 0.0]] {
        let instants = all(&start, &PLAN);
        for j in 0..INPUTS {
            let nudge = 1e-4;
            let moved = |sign: f64| {
                let mut plan = PLAN;
                plan[j / 2][j % 2] += sign * nudge;
                all(&start, &plan)
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for k in 0..STEPS {
                for i in 0..STATES {
                    let difference = (up[k].state[i] - down[k].state[i]) / (2.0 * nudge);
                    let error = (instants[k].gain[i][j] - difference).abs();
                    assert!(error < 1e-6, "step {k}, state {i}, input {j}: {error:e}");
                }
            }
        }
    }
}

#[test]
fn a_rows_last_entry_is_what_the_plan_makes() {
    for instant in all(&START, &PLAN) {
        for row in instant.gain {
            let planned: f64 = (0..INPUTS).map(|j| row[j] * PLAN[j / 2][j % 2]).sum();
            assert!((row[PLANNED] - planned).abs() < 1e-11, "{} {planned}", row[PLANNED]);
        }
    }
}

#[test]
fn the_width_of_the_registers_changes_no_bit() {
    let model = Bicycle::new(&TruckBelief::default());
    let mut moving = Moving { core: [START[0], START[1], START[2]], heading: START[3] };
    let mut group = Group::EMPTY;
    for lane in 0..LANES {
        group.roll(&model, &mut moving, PLAN[lane], lane);
    }
    let work = Linearise { model: &model, group: &group };
    let bits = |tangent: Tangent| {
        let columns = tangent.columns.map(|column| column.map(|lanes| lanes.0.map(f64::to_bits)));
        (columns, tangent.way.map(|lanes| lanes.0.map(f64::to_bits)))
    };
    assert_eq!(bits(widest(work)), bits(work.run()));
}
