//! Protocol `search`: an agent proposes one design after the other and observes its value, until a budget of
//! evaluations is spent; the chosen design is then measured again.
//!
//! A design is an episode: every step decides a part of it, and the environment evaluates the part so far. The
//! budget counts steps, since a step is the expensive unit. The agent may learn between steps and between
//! designs; the state of the search is recorded after every design:
//!
//! | recorded | phase | design |
//! |---|---|---|
//! | `candidate_return`, `candidate_<metric>` | evaluate | the design that was just tried |
//! | `return`, `episode_length`, the environment's metrics | evaluate | the best design so far, as it was
//! observed |
//! | the same | final | the chosen design, built again on random numbers that the search never used |
//!
//! Designs are compared by their return, or by the metric that `by` names: an environment may reward progress, which is
//! the score less that at the start of the episode, while the search is for the score.
//!
//! The best of many noisy observations overestimates its design, so the final row is the one to compare. A
//! trial leaves all designs as a dataset, the best ones as `choice.json`, and the drawings of the chosen design
//! from its last construction.

mod candidates;
mod design_value;
#[cfg(test)]
mod tests;

use candidates::{Candidate, Candidates, DesignReplay, PlaceholderAgent};
use contract::{
    ArtifactKind, Config, End, Environment, Error, Feed, Interface, Metric, Mode, Observation, Phase,
    Protocol, Registry, Rng, Transition,
    dataset::{Dataset, DatasetWriter, Episode},
    design::Designs,
    episode_metrics::EpisodeMetrics,
    exact,
    protocol::{self, Blocks, Measurement, Position, Run, measure, observe, restored},
};
use design_value::DesignValue;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// Settings of the `search` protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Search {
    /// Total number of evaluations, which are steps of the environment. A design that is incomplete when they are spent
    /// is finished.
    #[schemars(range(min = 1), extend("x-unit" = "evaluations"))]
    pub evaluations: u64,
    /// Choice of the design for the final measurement.
    pub choose: Choose,
    /// The metric of the environment by which designs are compared, in its better direction; the return where
    /// absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// The fraction of the designs, counted from the last one, among which the best observed design is chosen.
    #[schemars(range(min = 0.001, max = 1.0))]
    pub among_last: f64,
    /// Number of times that the chosen design is built and measured again.
    #[schemars(range(min = 1))]
    pub final_episodes: u64,
    /// Number of these that are recorded step by step, for trajectory figures.
    pub trace_episodes: u64,
}

/// Choice of the design for the final measurement.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Choose {
    /// The best design as it was observed, the first of equals.
    #[default]
    BestSeen,
    /// The design that the agent builds in evaluation.
    Policy,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            evaluations: 300,
            choose: Choose::default(),
            by: None,
            among_last: 1.0,
            final_episodes: 3,
            trace_episodes: 0,
        }
    }
}

impl Config for Search {}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "search",
        1,
        "Let an agent propose one design after the other within a budget of evaluations; measure the chosen one \
         again.",
        |config: Search| config,
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for Search {
    fn metrics(&self) -> Vec<Metric> {
        let mut metrics = protocol::measurement_metrics();
        metrics.push(Metric::new(
            "candidate_return",
            "",
            "return of a design that was tried",
        ));
        metrics
    }

    fn metrics_of_environment(&self, of: &[Metric]) -> Vec<Metric> {
        let candidate = |metric: &Metric| Metric {
            name: format!("candidate_{}", metric.name),
            about: format!("{}; of a design that was tried", metric.about),
            ..metric.clone()
        };
        of.iter().cloned().chain(of.iter().map(candidate)).collect()
    }

    fn feed(&self) -> Feed {
        Feed::Designs
    }

    fn accepts(&self, interface: &Interface, metrics: &[Metric]) -> Result<(), Error> {
        match interface.seats.len() {
            1 => DesignValue::named(self.by.as_deref(), metrics).map(drop),
            seats => Err(Error::ManySeats { seats }),
        }
    }

    fn leaves(&self) -> Vec<ArtifactKind> {
        vec![
            ArtifactKind::Dataset,
            ArtifactKind::Choice,
            ArtifactKind::Graph,
            ArtifactKind::Images,
        ]
    }

    fn write_stub(&self, interface: &Interface, folder: &Path) -> Result<(), Error> {
        Designs::default().write(folder)?;
        Dataset::write_empty(folder, interface)
    }

    fn total_steps(&self) -> u64 {
        self.evaluations
    }

    fn experience(&self) -> u64 {
        self.evaluations
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let environment = (run.make_environment)()?;
        let interface = environment.interface();
        self.accepts(&interface, environment.metrics())?;
        let design_value = DesignValue::named(self.by.as_deref(), environment.metrics())?;
        let (candidates, blocks) = self.search(run, &design_value)?;
        (run.progress)(self.evaluations, self.evaluations);
        self.measure_chosen(run, &candidates, &design_value, blocks)?;
        run.record_updates(Phase::Final, self.evaluations);
        let Some(folder) = run.folder else {
            return Ok(());
        };
        candidates
            .best(&design_value, &interface.seats[0].action)?
            .write(folder)?;
        write_dataset(folder, &interface, &candidates)
    }
}

impl Search {
    /// All designs that were tried, with the position at which the measurement of the chosen one continues.
    fn search(
        &self,
        run: &mut Run<'_>,
        design_value: &DesignValue,
    ) -> Result<(Candidates, Option<Blocks>), Error> {
        let mut under_way = match run.resume()? {
            None => SearchState::start(run)?,
            Some(Position {
                learning: Some(SearchCheckpoint::Searching(saved)),
                ..
            }) => SearchState::restored(run, *saved)?,
            Some(Position {
                learning: Some(SearchCheckpoint::Searched(candidates)),
                measuring,
            }) => return Ok((candidates, measuring)),
            Some(Position { learning: None, .. }) => {
                return Err(Error::Checkpoint {
                    what: "a search",
                    problem: "it holds no designs".into(),
                });
            }
        };
        while under_way.evaluations < self.evaluations || !under_way.between_designs() {
            run.checkpoint(|| Position {
                learning: Some(SearchCheckpoint::Searching(Box::new(under_way.save()))),
                measuring: None,
            })?;
            under_way.advance(run, design_value)?;
            (run.progress)(under_way.evaluations.min(self.evaluations), self.evaluations);
        }
        Ok((under_way.candidates, None))
    }

    fn measure_chosen(
        &self,
        run: &mut Run<'_>,
        candidates: &Candidates,
        design_value: &DesignValue,
        blocks: Option<Blocks>,
    ) -> Result<(), Error> {
        let what = Measurement::at_the_end(self.evaluations, self.final_episodes, self.trace_episodes)
            .with_drawings();
        let saved = || Some(SearchCheckpoint::Searched(candidates.clone()));
        let chosen = match self.choose {
            Choose::Policy => None,
            Choose::BestSeen => candidates.best_of_last(self.among_last, design_value),
        };
        let Some(chosen) = chosen else {
            return measure(run, &what, blocks, saved);
        };
        let agent = std::mem::replace(&mut run.agent, Box::new(PlaceholderAgent));
        run.agent = Box::new(DesignReplay::new(agent, chosen.episode.actions.clone()));
        measure(run, &what, blocks, saved)
    }
}

fn write_dataset(folder: &Path, interface: &Interface, candidates: &Candidates) -> Result<(), Error> {
    let mut writer = DatasetWriter::create(folder, interface).map_err(Error::of_store)?;
    for candidate in candidates.all() {
        writer.episode(&candidate.episode).map_err(Error::of_store)?;
    }
    writer.finish().map_err(Error::of_store)
}

/// State of a search in a checkpoint.
#[derive(Debug, Serialize, Deserialize)]
enum SearchCheckpoint {
    Searching(Box<SavedSearch>),
    Searched(Candidates),
}

/// State of a search between two steps.
struct SearchState {
    evaluations: u64,
    candidates: Candidates,
    environment: Box<dyn Environment>,
    environment_rng: Rng,
    act_rng: Rng,
    learn_rng: Rng,
    design: DesignUnderWay,
}

/// Observations, actions, rewards and metrics so far of the incomplete design.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct DesignUnderWay {
    #[serde(with = "exact")]
    observations: Vec<Vec<f64>>,
    #[serde(with = "exact")]
    actions: Vec<Vec<f64>>,
    #[serde(with = "exact")]
    rewards: Vec<f64>,
    metrics: EpisodeMetrics,
}

#[derive(Debug, Serialize, Deserialize)]
struct SavedSearch {
    evaluations: u64,
    candidates: Candidates,
    environment: Value,
    environment_rng: Rng,
    act_rng: Rng,
    learn_rng: Rng,
    design: DesignUnderWay,
}

impl SearchState {
    fn start(run: &mut Run<'_>) -> Result<Self, Error> {
        let mut search = Self {
            evaluations: 0,
            candidates: Candidates::default(),
            environment: (run.make_environment)()?,
            environment_rng: run.streams.environment("search", 0),
            act_rng: run.streams.agent("act"),
            learn_rng: run.streams.agent("learn"),
            design: DesignUnderWay::default(),
        };
        search.begin_design(run)?;
        Ok(search)
    }

    /// Whether no step of the next design was taken yet.
    fn between_designs(&self) -> bool {
        self.design.actions.is_empty()
    }

    fn begin_design(&mut self, run: &mut Run<'_>) -> Result<(), Error> {
        let seats = self.environment.reset(&mut self.environment_rng)?;
        run.agent.restart();
        self.design = DesignUnderWay {
            observations: seats,
            metrics: EpisodeMetrics::new(self.environment.metrics()),
            ..DesignUnderWay::default()
        };
        Ok(())
    }

    fn observation(&self, run: &Run<'_>, at: usize) -> Observation {
        observe(
            &*run.agent,
            &*self.environment,
            vec![self.design.observations[at].clone()],
        )
    }

    /// Takes one step, which is one evaluation.
    fn advance(&mut self, run: &mut Run<'_>, design_value: &DesignValue) -> Result<(), Error> {
        let at = self.design.actions.len();
        let observation = self.observation(run, at);
        let rows = [observation];
        let actions = run.agent.act(&rows, Mode::Train, &mut self.act_rng)?;
        let [observation] = rows;
        let action = actions.into_iter().next().unwrap_or_default();
        let step = self.environment.step(&action, &mut self.environment_rng)?;
        self.evaluations += 1;
        self.design.take(&action, &step, self.environment.metrics())?;
        let transition = Transition {
            observation,
            action,
            rewards: step.rewards,
            next_observation: self.observation(run, at + 1),
            end: step.end,
        };
        run.agent
            .learn(&[transition], &mut self.learn_rng, &mut run.record)?;
        match step.end {
            Some(end) => self.end_design(run, design_value, end, true),
            None if run.agent.truncates() => self.end_design(run, design_value, End::Truncated, false),
            None => Ok(()),
        }
    }

    fn end_design(
        &mut self,
        run: &mut Run<'_>,
        design_value: &DesignValue,
        end: End,
        whole: bool,
    ) -> Result<(), Error> {
        let design = std::mem::take(&mut self.design);
        let metrics = self.environment.metrics();
        let candidate = design.candidate(metrics, end, whole);
        run.record.flush_means(self.evaluations);
        run.record_updates(Phase::Train, self.evaluations);
        if whole {
            candidate.record(run, Phase::Evaluate, self.evaluations, metrics, "candidate_");
        }
        self.candidates.add(candidate);
        if let Some(best) = self.candidates.best_of_last(1.0, design_value) {
            best.record(run, Phase::Evaluate, self.evaluations, metrics, "");
        }
        self.begin_design(run)
    }

    fn save(&self) -> SavedSearch {
        SavedSearch {
            evaluations: self.evaluations,
            candidates: self.candidates.clone(),
            environment: self.environment.snapshot(),
            environment_rng: self.environment_rng.clone(),
            act_rng: self.act_rng.clone(),
            learn_rng: self.learn_rng.clone(),
            design: self.design.clone(),
        }
    }

    fn restored(run: &Run<'_>, saved: SavedSearch) -> Result<Self, Error> {
        Ok(Self {
            evaluations: saved.evaluations,
            candidates: saved.candidates,
            environment: restored(run.make_environment, &saved.environment)?,
            environment_rng: saved.environment_rng,
            act_rng: saved.act_rng,
            learn_rng: saved.learn_rng,
            design: saved.design,
        })
    }
}

impl DesignUnderWay {
    fn take(&mut self, action: &[Vec<f64>], step: &contract::Step, metrics: &[Metric]) -> Result<(), Error> {
        self.actions.push(action[0].clone());
        self.rewards.push(step.rewards[0]);
        self.observations.push(step.observations[0].clone());
        self.metrics.add(metrics, step)
    }

    fn candidate(self, metrics: &[Metric], end: End, whole: bool) -> Candidate {
        Candidate {
            observed_return: self.rewards.iter().sum(),
            metrics: self.metrics.of_episode(metrics),
            whole,
            episode: Episode {
                observations: self.observations,
                actions: self.actions,
                rewards: self.rewards,
                states: Vec::new(),
                end,
            },
        }
    }
}
