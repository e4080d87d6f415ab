//! Reconfiguration of a distribution feeder after faults: the switches to close so that most load is supplied.
//!
//! The feeder is the 33-bus one of Baran and Wu (1989) ([`feeder`]). Lines fail; some lines and all ties have
//! switches, every other line stays closed unless it failed, and a failed line stays open whatever the position
//! of its switch. An episode is one step: a position for every switch. The feeder must then run
//!
//! - radially: the substation feeds no loop,
//! - with a voltage of at least `lowest_voltage_pu` at every bus that is fed,
//! - with currents of at most `trunk_limit_a` in lines 1 to 5 and `line_limit_a` in the others,
//!
//! by a power flow with constant loads ([`power_flow`]). The reward is the supplied fraction of all load (3715
//! kW) less `loss_weight` times the losses as a fraction of it; it is 0 where a condition fails, since
//! protection then opens at the substation. Both are recorded, with the best score of all configurations, which
//! are tried one by one when a set of faults first occurs ([`restoration`]): 4096 of them, some milliseconds,
//! with the default switches.
//!
//! Faults stay the same in all episodes (`failed_lines`), so that a search has one best design, or are drawn
//! for each (`drawn_faults`), so that a policy has to observe them.
//!
//! Departures: the paper gives the feeder and reconfigures it without faults by exchanging branches; it has no
//! limits of current, so those are this project's, and the lowest voltage is that of MATPOWER's `case33bw`.
//! Without faults the least losses known, 139.55 kW with lines 7, 9, 14, 32 and 37 open, are among the
//! configurations of the default switches and are found.

pub mod config;
pub mod feeder;
pub mod power_flow;
pub mod restoration;

pub use config::GridReconfigurationConfig;

use contract::{Channel, Choice, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, Step};
use feeder::N_LINES;
use restoration::{Operation, Switchgear};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

/// The `grid_reconfiguration` environment.
#[derive(Debug)]
pub struct GridReconfiguration {
    config: GridReconfigurationConfig,
    gear: Switchgear,
    seats: Vec<Seat>,
    choices: Vec<Choice>,
    metrics: Vec<Metric>,
    situation: Situation,
}

/// State of an episode.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Situation {
    /// Failed lines, in order.
    failed: Vec<usize>,
    /// Whether each switch is closed; `None` before the step.
    closed: Option<Vec<bool>>,
}

/// Builds the environment; registered as `grid_reconfiguration`.
///
/// # Errors
/// Errors of [`GridReconfigurationConfig::check`].
pub fn build(config: GridReconfigurationConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(GridReconfiguration::new(config)?))
}

impl GridReconfiguration {
    fn new(config: GridReconfigurationConfig) -> Result<Self, Error> {
        config.check()?;
        let gear = Switchgear::of(&config);
        let switch = |line: &usize| Choice::new(format!("line_{line}"), &["open", "closed"]);
        let choices: Vec<Choice> = gear.switches.iter().map(switch).collect();
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(fault_channels()),
            action: Space::Choices(choices.clone()),
        };
        Ok(Self {
            config,
            gear,
            seats: vec![seat],
            choices,
            metrics: metrics(),
            situation: Situation::default(),
        })
    }

    /// 1 for every line that failed, from line 2 on.
    fn observe(&self) -> Vec<f64> {
        (2..=N_LINES)
            .map(|line| flag(self.situation.failed.contains(&line)))
            .collect()
    }

    fn operation(&self) -> Option<Operation> {
        let closed = self.situation.closed.as_ref()?;
        self.gear.operate(closed, &self.situation.failed)
    }

    /// The best score with these faults, computed once for each config within a process.
    fn optimum(&self) -> f64 {
        static KNOWN: Mutex<BTreeMap<String, f64>> = Mutex::new(BTreeMap::new());
        let failed = &self.situation.failed;
        // A panic while the lock was held has left the map unchanged.
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        *known
            .entry(format!("{:?} {failed:?}", self.config))
            .or_insert_with(|| self.gear.best(failed).1)
    }

    /// The score of the configuration, and its metrics.
    fn judged(&self) -> (f64, [(&'static str, f64); 6]) {
        let operation = self.operation();
        let score = self.gear.score(operation.as_ref());
        let within = operation.filter(|one| self.gear.is_within_limits(one));
        let (load_kw, losses_kw) = within.map_or((0.0, 0.0), |one| (one.load_kw, one.losses_kw));
        let supplied = load_kw / restoration::total_load_kw();
        let optimum = self.optimum();
        let metrics = [
            ("score", score),
            ("supplied", supplied),
            ("losses", losses_kw),
            ("feasible", flag(within.is_some())),
            ("optimum", optimum),
            ("gap", optimum - score),
        ];
        (score, metrics)
    }
}

fn flag(is: bool) -> f64 {
    f64::from(u8::from(is))
}

fn fault_channels() -> Vec<Channel> {
    let failed = |line: usize| {
        Channel::new(format!("failed_{line}"), "")
            .within(0.0, 1.0)
            .typical(0.0, 0.2)
    };
    (2..=N_LINES).map(failed).collect()
}

fn metrics() -> Vec<Metric> {
    let last = |name, unit, about| Metric::new(name, unit, about).per_episode(PerEpisode::Last);
    vec![
        last(
            "score",
            "",
            "supplied part of all load less weighted losses; 0 where a limit is broken",
        ),
        last(
            "supplied",
            "",
            "supplied part of all load; 0 where a limit is broken",
        ),
        last("losses", "kW", "losses of all lines; 0 where a limit is broken").lower_is_better(),
        last("feasible", "", "1 for a radial design within all limits, else 0"),
        last(
            "optimum",
            "",
            "the best score of any configuration for the same faults",
        ),
        last("gap", "", "what the score lacks of the optimum").lower_is_better(),
    ]
}

impl Environment for GridReconfiguration {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.situation = Situation {
            failed: self.config.draw_faults(rng),
            closed: None,
        };
        Ok(vec![self.observe()])
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        crate::unit_box::check_seats(actions, 1)?;
        let taken = contract::choice::taken(&self.choices, &actions[0])?;
        self.situation.closed = Some(taken.into_iter().map(|option| option == 1).collect());
        let (score, metrics) = self.judged();
        let step = Step::new(vec![self.observe()], vec![score], Some(End::Terminated));
        Ok(step.record_all(metrics))
    }

    fn state_channels(&self) -> Vec<Channel> {
        fault_channels()
    }

    fn state(&self) -> Vec<f64> {
        self.observe()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let closed = |line: &usize| Channel::new(format!("closed_{line}"), "").within(0.0, 1.0);
        let of_operation = [
            Channel::new("fed_load", "kW").within(0.0, restoration::total_load_kw()),
            Channel::new("line_losses", "kW").within(0.0, f64::INFINITY),
            Channel::new("lowest_voltage", "p.u.").within(0.0, 1.0),
            Channel::new("largest_loading", "").within(0.0, f64::INFINITY),
        ];
        fault_channels()
            .into_iter()
            .chain(self.gear.switches.iter().map(closed))
            .chain(of_operation)
            .collect()
    }

    /// Faults, switches, and the operation of the feeder without protection.
    fn trace(&self) -> Vec<f64> {
        let closed = match &self.situation.closed {
            Some(closed) => closed.iter().copied().map(flag).collect(),
            None => vec![f64::NAN; self.gear.switches.len()],
        };
        let operation = self.operation().map_or([f64::NAN; 4], |one| {
            [
                one.load_kw,
                one.losses_kw,
                one.lowest_voltage_pu,
                one.largest_loading,
            ]
        });
        self.observe()
            .into_iter()
            .chain(closed)
            .chain(operation)
            .collect()
    }

    fn snapshot(&self) -> serde_json::Value {
        // A plain struct: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(&self.situation).expect("faults and switches serialise")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem| Error::Checkpoint {
            what: "grid_reconfiguration",
            problem,
        };
        let situation = Situation::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        let switches = self.gear.switches.len();
        if situation
            .closed
            .as_ref()
            .is_some_and(|closed| closed.len() != switches)
        {
            return Err(misfit(format!("positions of other than {switches} switches")));
        }
        if !situation.failed.iter().all(|line| (2..=N_LINES).contains(line)) {
            return Err(misfit("a failed line that does not exist".into()));
        }
        self.situation = situation;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng as _;
    use serde_json::json;

    fn feeder(values: serde_json::Value) -> GridReconfiguration {
        GridReconfiguration::new(serde_json::from_value(values).unwrap()).unwrap()
    }

    /// Closes all switches except these.
    fn opening(environment: &GridReconfiguration, open: &[usize]) -> Vec<f64> {
        let lines = environment.gear.switches.iter();
        let taken: Vec<usize> = lines.map(|line| usize::from(!open.contains(line))).collect();
        contract::choice::vector(&environment.choices, &taken)
    }

    #[test]
    fn the_least_losses_have_no_gap() {
        let mut environment = feeder(json!({ "failed_lines": [], "loss_weight": 1.0 }));
        let mut rng = contract::random::stream(&[]);
        assert_eq!(environment.reset(&mut rng).unwrap(), [vec![0.0; 36]]);
        let best = opening(&environment, &[7, 9, 14, 32, 37]);
        let step = environment.step(&[best], &mut rng).unwrap();
        assert!((step.metric("losses").unwrap() - 139.55).abs() < 0.005);
        assert_eq!(
            (
                step.metric("supplied").unwrap(),
                step.metric("feasible").unwrap(),
                step.metric("gap").unwrap()
            ),
            (1.0, 1.0, 0.0)
        );
        assert_eq!(
            (step.rewards[0], step.end),
            (step.metric("optimum").unwrap(), Some(End::Terminated))
        );
        let ties_open = opening(&environment, &[33, 34, 35, 36, 37]);
        let step = environment.step(&[ties_open], &mut rng).unwrap();
        assert!(
            (step.metric("gap").unwrap() - (202.677 - 139.551) / 3715.0).abs() < 1e-6,
            "{step:?}"
        );
    }

    #[test]
    fn a_loop_is_worth_nothing_and_has_nothing_to_show() {
        let mut environment = feeder(json!({ "failed_lines": [5] }));
        let mut rng = contract::random::stream(&[]);
        let seen = environment.reset(&mut rng).unwrap();
        assert_eq!(seen[0].iter().position(|failed| *failed == 1.0), Some(3));
        let all_closed = opening(&environment, &[]);
        let step = environment.step(&[all_closed], &mut rng).unwrap();
        for metric in ["score", "supplied", "losses", "feasible"] {
            assert_eq!(step.metric(metric), Some(0.0), "{metric}");
        }
        assert_eq!(step.rewards, [0.0]);
        assert!(
            step.metric("optimum").unwrap() > 0.9
                && step.metric("gap").unwrap() == step.metric("optimum").unwrap()
        );
        assert!(environment.trace()[48..].iter().all(|value| value.is_nan()));
    }

    #[test]
    fn no_design_is_better_than_the_optimum() {
        let mut environment = feeder(json!({ "drawn_faults": 2 }));
        let mut rng = contract::random::stream(&["designs"]);
        let mut feasible = 0;
        for _ in 0..60 {
            environment.reset(&mut rng).unwrap();
            let action: Vec<f64> = (0..24).map(|_| rng.random_range(-1.0..1.0)).collect();
            let step = environment.step(&[action], &mut rng).unwrap();
            assert!(
                step.metric("gap").unwrap() >= 0.0 && step.metric("supplied").unwrap() <= 1.0,
                "{step:?}"
            );
            feasible += usize::from(step.metric("feasible").unwrap() == 1.0);
        }
        assert!(feasible > 10, "{feasible} of 60");
    }

    #[test]
    fn an_episode_is_restored_before_and_after_its_step() {
        let mut one = feeder(json!({ "drawn_faults": 3 }));
        let mut two = feeder(json!({ "drawn_faults": 3 }));
        let mut rng = contract::random::stream(&["restored"]);
        one.reset(&mut rng).unwrap();
        two.restore(&one.snapshot()).unwrap();
        let action = opening(&one, &[7, 9, 14, 32, 37]);
        let steps =
            [&mut one, &mut two].map(|feeder| feeder.step(std::slice::from_ref(&action), &mut rng).unwrap());
        assert_eq!(steps[0], steps[1]);
        two.restore(&one.snapshot()).unwrap();
        assert_eq!(format!("{:?}", one.trace()), format!("{:?}", two.trace()));
        for snapshot in [
            json!({ "failed": [1], "closed": null }),
            json!({ "failed": [2], "closed": [true] }),
            json!({ "failed": 2 }),
        ] {
            assert!(matches!(two.restore(&snapshot), Err(Error::Checkpoint { .. })));
        }
    }

    /// The stated best designs of the presets.
    #[test]
    fn presets_state_what_can_be_supplied() {
        for (values, base_kw, best_kw, equally_good) in [
            (json!({}), 1480.0, 3655.0, 1),
            (json!({ "failed_lines": [22] }), 2785.0, 3715.0, 1),
            (json!({ "failed_lines": [2] }), 460.0, 1755.0, 8),
        ] {
            let feeder = feeder(values);
            let (gear, failed) = (&feeder.gear, &feeder.config.failed_lines);
            let base: Vec<bool> = gear.switches.iter().map(|line| *line <= 32).collect();
            assert_eq!(gear.operate(&base, failed).unwrap().load_kw, base_kw);
            let within = gear
                .configurations()
                .filter_map(|closed| gear.operate(&closed, failed));
            let loads: Vec<f64> = within
                .filter(|one| gear.is_within_limits(one))
                .map(|one| one.load_kw)
                .collect();
            assert_eq!(loads.iter().copied().fold(0.0, f64::max), best_kw);
            assert_eq!(
                loads.iter().filter(|load| **load == best_kw).count(),
                equally_good
            );
        }
    }

    #[test]
    fn presets_are_configs() {
        for preset in <GridReconfigurationConfig as contract::Config>::presets() {
            assert!(
                build(serde_json::from_value(preset.values).unwrap()).is_ok(),
                "{}",
                preset.name
            );
        }
        let refusal = build(serde_json::from_value(json!({ "switches": [1] })).unwrap());
        assert!(matches!(refusal, Err(Error::Config { .. })));
    }
}
