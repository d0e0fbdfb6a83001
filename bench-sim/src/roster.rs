//! The roster: who follows whom, at what distance, in which lane and how fast, as time goes by.
//!
//! It starts as one platoon in the order of the trucks' numbers, and changes by the scenario's
//! events. What a truck is to do is its [`Place`]; the rig sends it as the truck's mission.
//!
//! ```text
//! leader distance of a truck = its own distance + the leader distance of the truck it follows
//! ```
//!
//! Numbers move along a [`Transition`]. A distance to the truck that is followed already starts
//! from what was asked; one to a truck not followed before starts from what it is: nobody is asked
//! to jump.

use crate::scenario::{Event, Scenario, TRUCKS_MAX};
use crate::transition::Transition;

/// What one truck is to do at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Place {
    /// Its place in its platoon, 0 leads.
    pub(crate) place: usize,
    /// Trucks of its platoon.
    pub(crate) size: usize,
    /// The truck that leads; itself when it leads.
    pub(crate) leader: usize,
    /// The truck it follows; itself when it leads.
    pub(crate) predecessor: usize,
    /// Desired distance to the truck it follows, CG to CG \[m\].
    pub(crate) spacing_m: f64,
    /// Desired distance to its leader \[m\]; 0 for the leader.
    pub(crate) leader_distance_m: f64,
    /// Set speed of its leader \[m/s\].
    pub(crate) speed_mps: f64,
    /// Desired lateral position \[m\].
    pub(crate) desired_y_m: f64,
}

/// The orders of one truck.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Orders {
    follows: Option<usize>,
    spacing_m: Transition,
    speed_mps: Transition,
    desired_y_m: Transition,
}

/// The roster of a run. Time only goes forward.
#[derive(Debug, Clone)]
pub(crate) struct Roster {
    orders: Vec<Orders>,
    events: Vec<Event>,
    applied: usize,
}

impl Roster {
    /// The roster before anything happened, not even what is to happen at 0 s.
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let platoon = &scenario.platoon;
        let orders = |truck: usize| Orders {
            follows: truck.checked_sub(1),
            spacing_m: Transition::at_rest(platoon.spacing_m),
            speed_mps: Transition::at_rest(platoon.speed_mps),
            desired_y_m: Transition::at_rest(platoon.desired_y_m),
        };
        let orders = (0..platoon.trucks).map(orders).collect();
        Self { orders, events: scenario.events.clone(), applied: 0 }
    }

    /// Applies the events that are due, given where every truck is along the road; true when there
    /// was one.
    pub(crate) fn advance(&mut self, time_s: f64, x_m: impl Fn(usize) -> f64) -> bool {
        let before = self.applied;
        while let Some(event) = self.events.get(self.applied).filter(|e| e.at_s <= time_s) {
            let event = *event;
            self.apply(&event, &x_m);
            self.applied += 1;
        }
        self.applied > before
    }

    /// Applies one event, given where every truck is along the road.
    pub(crate) fn apply(&mut self, event: &Event, x_m: impl Fn(usize) -> f64) {
        let orders = &mut self.orders[event.truck];
        let follows = event.follows.or(orders.follows).filter(|_| !event.leads);
        let distance_m = match follows {
            Some(ahead) if orders.follows != follows => x_m(ahead) - x_m(event.truck),
            _ => orders.spacing_m.value(event.at_s),
        };
        let asked_m = event.spacing_m.unwrap_or(orders.spacing_m.to);
        orders.follows = follows;
        if event.changes_distance() {
            orders.spacing_m = change(event, distance_m, asked_m);
        }
        let numbers = [
            (&mut orders.speed_mps, event.speed_mps),
            (&mut orders.desired_y_m, event.desired_y_m),
        ];
        for (number, target) in numbers {
            if let Some(to) = target {
                *number = change(event, number.value(event.at_s), to);
            }
        }
    }

    /// Whether somebody's numbers move at this instant.
    pub(crate) fn is_moving(&self, time_s: f64) -> bool {
        self.orders.iter().any(|orders| {
            [orders.spacing_m, orders.speed_mps, orders.desired_y_m]
                .iter()
                .any(|number| number.is_moving(time_s))
        })
    }

    /// What a truck is to do now.
    pub(crate) fn place(&self, truck: usize, time_s: f64) -> Place {
        let own = &self.orders[truck];
        let mut place = Place {
            leader: truck,
            predecessor: own.follows.unwrap_or(truck),
            spacing_m: own.spacing_m.value(time_s),
            desired_y_m: own.desired_y_m.value(time_s),
            ..Place::default()
        };
        // A chain is no longer than there are trucks; the check of a scenario refuses circles.
        for _ in 0..self.orders.len() {
            let Some(ahead) = self.orders[place.leader].follows else { break };
            place.leader_distance_m += self.orders[place.leader].spacing_m.value(time_s);
            place.leader = ahead;
            place.place += 1;
        }
        place.speed_mps = self.orders[place.leader].speed_mps.value(time_s);
        place
    }

    /// What every truck is to do now.
    pub(crate) fn places(&self, time_s: f64, places: &mut [Place]) {
        for (truck, place) in places.iter_mut().enumerate() {
            *place = self.place(truck, time_s);
        }
        let mut sizes = [0; TRUCKS_MAX];
        for place in places.iter() {
            sizes[place.leader] += 1;
        }
        for place in places.iter_mut() {
            place.size = sizes[place.leader];
        }
    }

    /// The truck each truck follows now.
    pub(crate) fn follows(&self, truck: usize) -> Option<usize> {
        self.orders[truck].follows
    }
}

fn change(event: &Event, from: f64, to: f64) -> Transition {
    Transition { from, to, from_s: event.at_s, until_s: event.until_s() }
}

/// For every truck the trucks it follows, or is led by, at any time of a scenario.
pub(crate) fn sources(scenario: &Scenario) -> Vec<Vec<usize>> {
    let mut roster = Roster::new(scenario);
    let trucks = scenario.platoon.trucks;
    let mut sources = vec![Vec::new(); trucks];
    let mut times: Vec<f64> = scenario.events.iter().map(|event| event.at_s).collect();
    times.insert(0, 0.0);
    for time_s in times {
        roster.advance(time_s, |_| 0.0);
        for (truck, sources) in sources.iter_mut().enumerate() {
            let place = roster.place(truck, time_s);
            for source in [place.leader, place.predecessor] {
                if source != truck && !sources.contains(&source) {
                    sources.push(source);
                }
            }
        }
    }
    sources
}

#[cfg(test)]
mod tests;
