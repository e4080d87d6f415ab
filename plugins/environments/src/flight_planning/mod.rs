//! The plan of a flight: airspeed and height of every leg, for the least consumption in a mean wind.
//!
//! A rotary-wing UAV ([`power`]) flies legs over ground in a wind that grows with height ([`mission`]). An
//! episode is a plan, a step a leg: its airspeed (seven) and its height (three). Against the wind a plan flies
//! faster and lower, with it slower and higher, and every climb has to be earned back on the legs that follow.
//!
//! | symbol | here | range |
//! |---|---|---|
//! | E_i | consumption of leg i on the chosen course, with the loss of the pack | J |
//! | C_i | the same on the constant plan: 15 m/s over ground, 20 m above it | J |
//! | r_i = (C_i - E_i) / sum C | reward of a step | |
//!
//! So a return is the fraction of the constant plan's consumption that a plan saves. The optimum is exact, by
//! dynamic programming ([`optimum`]); a test compares it with all 9261 plans of three legs.
//!
//! `uav_fleet` flies such plans: its config takes the choice of a search in this environment.

pub mod mission;
pub mod optimum;
pub mod power;

use contract::{Channel, Choice, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, Step};
use mission::{AIRSPEEDS_M_PER_S, Course, HEIGHTS_M, Mission, Speed};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Settings of the `flight_planning` environment.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlightPlanningConfig {
    /// The legs of the flight, and the mean wind.
    pub mission: Mission,
}

impl contract::Config for FlightPlanningConfig {}

/// The `flight_planning` environment.
#[derive(Debug)]
pub struct FlightPlanning {
    mission: Mission,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    /// Consumption of the constant plan, leg by leg, J.
    constant_j: Vec<f64>,
    /// Return of the best plan.
    optimum: f64,
    /// Courses of the legs planned so far.
    planned: Vec<Course>,
}

/// Builds the environment; registered as `flight_planning`.
///
/// # Errors
/// Errors of [`Mission::check`].
pub fn build(config: FlightPlanningConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(FlightPlanning::new(config)?))
}

/// The choices of every leg.
#[must_use]
pub fn choices() -> Vec<Choice> {
    let named = |values: &[f64], unit: &str| values.iter().map(|value| format!("{value}_{unit}")).collect();
    let choice = |name: &str, options: Vec<String>| Choice {
        name: name.into(),
        options,
    };
    vec![
        choice("airspeed", named(&AIRSPEEDS_M_PER_S, "m_per_s")),
        choice("height", named(&HEIGHTS_M, "m")),
    ]
}

/// The course that an action chooses.
///
/// # Errors
/// [`Error::Action`] for an action outside [`choices`].
pub fn course(action: &[f64]) -> Result<Course, Error> {
    let taken = contract::choice::taken(&choices(), action)?;
    Ok(Course::of(taken[0], taken[1]))
}

impl FlightPlanning {
    fn new(config: FlightPlanningConfig) -> Result<Self, Error> {
        let FlightPlanningConfig { mission } = config;
        mission.check("mission.", 1.0)?;
        let constant = mission.segments(&mission.constant_plan(), 1.0, 1.0);
        let constant_j: Vec<f64> = constant
            .iter()
            .map(|segment| mission.consumption_j(segment))
            .collect();
        let best_j = mission.total_j(&optimum::optimum(&mission));
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(channels(&mission)),
            action: Space::Choices(choices()),
        };
        Ok(Self {
            seats: vec![seat],
            metrics: metrics(),
            optimum: 1.0 - best_j / constant_j.iter().sum::<f64>(),
            constant_j,
            planned: Vec::new(),
            mission,
        })
    }

    /// Consumption of the legs planned so far, J.
    fn spent_j(&self) -> Vec<f64> {
        let legs = self.planned.len();
        let so_far = Mission {
            legs: self.mission.legs[..legs].to_vec(),
            ..self.mission.clone()
        };
        let segments = so_far.segments(&self.planned, 1.0, 1.0);
        segments
            .iter()
            .map(|segment| self.mission.consumption_j(segment))
            .collect()
    }

    /// Savings so far, as a fraction of the consumption of the constant plan.
    fn saved(&self) -> f64 {
        let spent = self.spent_j();
        let kept: f64 = self
            .constant_j
            .iter()
            .zip(&spent)
            .map(|(plain, spent)| plain - spent)
            .sum();
        kept / self.constant_j.iter().sum::<f64>()
    }

    fn height_m(&self) -> f64 {
        self.planned.last().map_or(0.0, |course| course.height_m)
    }

    /// The legs (1 for the next one), the height at which it begins, and the wind on it 10 m above ground.
    fn observe(&self) -> Vec<f64> {
        let present = self.planned.len();
        let legs = self.mission.legs.iter().enumerate();
        let wind = match self.mission.legs.get(present) {
            Some(leg) => self.mission.wind_on(leg, 10.0, 1.0),
            None => (0.0, 0.0),
        };
        legs.map(|(leg, _)| f64::from(u8::from(leg == present)))
            .chain([self.height_m(), wind.0, wind.1])
            .collect()
    }
}

/// The airspeed of a chosen course, m/s.
fn air(course: &Course) -> f64 {
    match course.speed {
        Speed::Air(speed) | Speed::Ground(speed) => speed,
    }
}

fn channels(mission: &Mission) -> Vec<Channel> {
    let leg = |leg: usize| {
        Channel::new(format!("leg_{leg}"), "")
            .within(0.0, 1.0)
            .typical(0.0, 0.4)
    };
    let wind = |name: &str| Channel::new(name, "m/s").typical(0.0, 4.0);
    (1..=mission.legs.len())
        .map(leg)
        .chain([
            Channel::new("height_m", "m")
                .within(0.0, 120.0)
                .typical(60.0, 40.0),
            wind("wind_along_m_per_s"),
            wind("wind_across_m_per_s"),
        ])
        .collect()
}

fn metrics() -> Vec<Metric> {
    let last = |name, unit, about| Metric::new(name, unit, about).per_episode(PerEpisode::Last);
    vec![
        last(
            "saved",
            "",
            "part of the plain plan's consumption that the plan saves",
        ),
        last("optimum", "", "what the best plan saves"),
        last("gap", "", "what the plan saves less than the best one").lower_is_better(),
        last(
            "consumption_kj",
            "kJ",
            "what the cells give in the flight, their own loss included",
        )
        .lower_is_better(),
        Metric::new("duration_s", "s", "time of the flight").lower_is_better(),
    ]
}

impl Environment for FlightPlanning {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, _rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.planned.clear();
        Ok(vec![self.observe()])
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        crate::unit_box::check_seats(actions, 1)?;
        let course = course(&actions[0])?;
        let Some(leg) = self.mission.legs.get(self.planned.len()) else {
            return Err(Error::Model {
                model: "flight_planning",
                problem: "every leg is planned; the episode has ended".into(),
            });
        };
        let duration_s = self
            .mission
            .segment(leg, course, self.height_m(), 1.0, 1.0)
            .duration_s;
        let before = self.saved();
        self.planned.push(course);
        let saved = self.saved();
        let consumption_kj = self.spent_j().iter().sum::<f64>() / 1000.0;
        let is_whole = self.planned.len() == self.mission.legs.len();
        let end = is_whole.then_some(End::Terminated);
        Ok(Step::new(vec![self.observe()], vec![saved - before], end)
            .record("saved", saved)
            .record("optimum", self.optimum)
            .record("gap", self.optimum - saved)
            .record("consumption_kj", consumption_kj)
            .record("duration_s", duration_s))
    }

    fn state_channels(&self) -> Vec<Channel> {
        channels(&self.mission)
    }

    fn state(&self) -> Vec<f64> {
        self.observe()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        vec![
            Channel::new("planned", "").within(0.0, 20.0),
            Channel::new("flown_airspeed_m_per_s", "m/s").within(0.0, 24.0),
            Channel::new("flown_height_m", "m").within(0.0, 120.0),
            Channel::new("consumption_j", "J").within(0.0, f64::INFINITY),
        ]
    }

    /// The last planned leg, and its consumption.
    fn trace(&self) -> Vec<f64> {
        let (airspeed, height) = self
            .planned
            .last()
            .map_or((f64::NAN, f64::NAN), |course| (air(course), course.height_m));
        let consumption = self.spent_j().last().copied().unwrap_or(f64::NAN);
        vec![self.planned.len() as f64, airspeed, height, consumption]
    }

    fn snapshot(&self) -> serde_json::Value {
        json!(self.planned)
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem| Error::Checkpoint {
            what: "flight_planning",
            problem,
        };
        let planned = Vec::<Course>::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        let (length, most) = (planned.len(), self.mission.legs.len());
        if length > most {
            return Err(misfit(format!("{length} planned legs of {most}")));
        }
        self.planned = planned;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fly(plan: &[Course]) -> (f64, Step, Vec<f64>) {
        let mut environment = FlightPlanning::new(FlightPlanningConfig::default()).unwrap();
        let mut rng = contract::random::stream(&[]);
        environment.reset(&mut rng).unwrap();
        let place = |of: &[f64], value: f64| of.iter().position(|known| *known == value).unwrap();
        let mut sum = 0.0;
        let mut last = None;
        for course in plan {
            let taken = [
                place(&AIRSPEEDS_M_PER_S, air(course)),
                place(&HEIGHTS_M, course.height_m),
            ];
            let action = contract::choice::vector(&choices(), &taken);
            let step = environment.step(&[action], &mut rng).unwrap();
            sum += step.rewards[0];
            last = Some(step);
        }
        (sum, last.unwrap(), environment.trace())
    }

    #[test]
    fn the_best_plan_has_no_gap() {
        let mission = Mission::default();
        let plan = optimum::optimum(&mission);
        let (sum, last, trace) = fly(&plan);
        assert!(last.metric("gap").unwrap().abs() < 1e-12 && last.end == Some(End::Terminated));
        assert!((sum - last.metric("optimum").unwrap()).abs() < 1e-12 && sum > 0.0);
        assert!((last.metric("consumption_kj").unwrap() * 1000.0 - mission.total_j(&plan)).abs() < 1e-6);
        assert_eq!(trace[..3], [6.0, air(&plan[5]), plan[5].height_m]);
    }

    #[test]
    fn savings_are_relative_to_the_constant_plan() {
        let mission = Mission::default();
        let plan = vec![Course::of(0, 2); 6];
        let (sum, last, _) = fly(&plan);
        let expected = 1.0 - mission.total_j(&plan) / mission.total_j(&mission.constant_plan());
        assert!((sum - expected).abs() < 1e-12 && (last.metric("saved").unwrap() - expected).abs() < 1e-12);
        assert!(
            (last.metric("gap").unwrap() - (last.metric("optimum").unwrap() - expected)).abs() < 1e-12
                && expected < 0.0
        );
    }

    #[test]
    fn a_plan_ends_with_its_legs() {
        let mut environment = FlightPlanning::new(FlightPlanningConfig::default()).unwrap();
        let mut rng = contract::random::stream(&[]);
        let seen = environment.reset(&mut rng).unwrap().remove(0);
        assert_eq!(seen[..7], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let action = vec![0.0; 10];
        for _ in 0..6 {
            environment.step(std::slice::from_ref(&action), &mut rng).unwrap();
        }
        assert!(matches!(
            environment.step(&[action], &mut rng),
            Err(Error::Model { .. })
        ));
        let too_many = json!(vec![Course::CONSTANT; 7]);
        for misfit in [json!(7), too_many] {
            assert!(matches!(
                environment.restore(&misfit),
                Err(Error::Checkpoint { .. })
            ));
        }
    }
}
