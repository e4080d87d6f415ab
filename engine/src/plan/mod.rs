//! The plan of a study: its trials, in order, and why those that are not stored are new.

mod cross_play;
mod explain;
mod leaves;
mod novelty;
#[cfg(test)]
mod tests;

pub use explain::{explain, seed_ranges, to_json};
pub use leaves::Difference;
pub use novelty::{Novelty, Reason, StoredCell, novelties};

use crate::{
    cast::{Cast, Member, Seating},
    product::Taken,
    results::CellName,
    spec::{Cell, Place, Play, Study},
    trial::{Part, Purpose, Trial, TrialKey, trial_id},
};
use std::collections::{BTreeMap, BTreeSet};

/// The kind of device that trials run on.
const DEVICE: &str = "cpu";

/// The trials of a study: what its entries of `prepare` run, then environments, agents, settings and seeds,
/// in the order of the study, then its plays.
///
/// Two trials may have the same id: where a sweep does not reach an agent (a protocol's training budget and
/// an agent that does not learn), its trials stand once in each setting, and the numbers are computed once.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the study.
    pub study: String,
    /// Its heading.
    pub title: String,
    /// The trials.
    pub trials: Vec<Trial>,
}

/// How many seeds combinations of environment, agent and setting have; those that are not named have the
/// first look's.
pub type Wanted = BTreeMap<CellName, u32>;

impl Study {
    /// The trials that the study has whatever its results are: all of them, or those of the first look.
    #[must_use]
    pub fn plan(&self) -> Plan {
        self.plan_with(&Wanted::new())
    }

    /// The trials where some combinations have come to a later look. Those of a look follow those of the one
    /// before, so that a plan that grows keeps the order of what it had.
    #[must_use]
    pub fn plan_with(&self, wanted: &Wanted) -> Plan {
        let mut plan = self.plan_of_all_seeds();
        let Some(design) = &self.design else { return plan };
        let look = |trial: &Trial| {
            design
                .looks()
                .partition_point(|most| trial.key.seed >= u64::from(*most))
        };
        let seeds = |trial: &Trial| {
            let cell = (
                trial.environment.clone(),
                trial.agent.clone(),
                trial.setting.clone(),
            );
            wanted.get(&cell).copied().unwrap_or(design.looks()[0])
        };
        plan.keep(|trial| match trial.purpose {
            Purpose::Prepared => false,
            Purpose::Tried(_) | Purpose::Imported => true,
            Purpose::Cell | Purpose::Play(_) => trial.key.seed < u64::from(seeds(trial)),
        });
        plan.trials.sort_by_key(look);
        plan
    }

    fn plan_of_all_seeds(&self) -> Plan {
        let (seeds, waiting) = (self.seeds_of_cells(), self.waiting());
        let mut of_cells: Vec<Vec<Trial>> = vec![Vec::new(); self.cells.len()];
        for &index in self.order.iter().filter(|index| !waiting.contains(index)) {
            of_cells[index] = self.trials_of(index, &seeds, &of_cells);
        }
        let is_ready = |play: &&Play| !play.players.iter().any(|player| waiting.contains(&player.cell));
        let plays = self.plays.iter().filter(is_ready);
        let plays: Vec<Trial> = plays
            .flat_map(|play| cross_play::trials(self, play, &of_cells))
            .collect();
        // Combinations come first, then the entries of `prepare`, then what searches try.
        let n_combinations = self.cells.iter().filter(|cell| cell.pair().is_some()).count();
        let before = of_cells.split_off(n_combinations);
        let trials = before
            .into_iter()
            .chain(of_cells)
            .flatten()
            .chain(plays)
            .collect();
        Plan {
            study: self.name.clone(),
            title: self.title.clone(),
            trials,
        }
    }

    /// The steps at which searches pause trials of a plan, by id. What something else needs as well goes to its end.
    #[must_use]
    pub fn pauses(&self, plan: &Plan) -> BTreeMap<String, u64> {
        let (mut pauses, mut whole) = (BTreeMap::new(), BTreeSet::new());
        let mut met: BTreeMap<&str, usize> = BTreeMap::new();
        for trial in &plan.trials {
            let stop = match &trial.purpose {
                Purpose::Tried(name) => {
                    let met = met.entry(name).or_default();
                    *met += 1;
                    self.stop(name, *met - 1)
                }
                _ => None,
            };
            match stop {
                // Equal settings of several brackets: the farthest pause holds.
                Some(stop) => {
                    let known = pauses.entry(trial.id.clone()).or_insert(stop);
                    *known = stop.max(*known);
                }
                None => {
                    whole.insert(trial.id.as_str());
                }
            }
        }
        pauses.retain(|id, _| !whole.contains(id.as_str()));
        pauses
    }

    /// Where a trial of a search pauses, by its place among them.
    fn stop(&self, name: &str, place: usize) -> Option<u64> {
        let (search, progress) = self.searches.iter().find(|(search, _)| search.name == *name)?;
        progress.stops.get(place / search.seeds.len()).copied().flatten()
    }

    /// The cells that have no trials yet: those of agents whose setting is not chosen, and those that take from
    /// them.
    fn waiting(&self) -> BTreeSet<usize> {
        let open = |agent: &str| {
            let mut open = self
                .searches
                .iter()
                .filter(|(_, progress)| progress.chosen.is_none());
            open.any(|(search, _)| search.agent == agent)
        };
        let mut waiting = BTreeSet::new();
        for &index in &self.order {
            let cell = &self.cells[index];
            let own = cell.pair().is_some_and(|(_, agent)| open(&self.agents[agent]));
            if own || cell.sources.iter().any(|source| waiting.contains(&source.cell)) {
                waiting.insert(index);
            }
        }
        waiting
    }

    /// The seeds that each cell runs: those of the study, and for an entry of `prepare` those that something
    /// takes.
    fn seeds_of_cells(&self) -> Vec<Vec<u64>> {
        let mut taken: Vec<BTreeSet<u64>> = vec![BTreeSet::new(); self.cells.len()];
        let mut seeds = vec![Vec::new(); self.cells.len()];
        for &index in self.order.iter().rev() {
            let cell = &self.cells[index];
            seeds[index] = match cell.place {
                Place::Combination(..) => self.seeds.clone(),
                Place::Tried(search) => self.searches[search].0.seeds.clone(),
                Place::Prepared(_) => taken[index].iter().copied().collect(),
            };
            for source in &cell.sources {
                taken[source.cell].extend(seeds[index].iter().map(|seed| source.seed_for(*seed)));
            }
        }
        seeds
    }

    /// The trials of a cell, once those are there that it takes from. Parts that take nothing are hashed
    /// once, not once per seed.
    fn trials_of(&self, index: usize, seeds: &[Vec<u64>], of_cells: &[Vec<Trial>]) -> Vec<Trial> {
        let cell = &self.cells[index];
        let (environment, agent) = self.names(cell);
        let trial = |&seed: &u64| {
            // A source runs the seeds that are taken from it, and comes before in the order of cells.
            let source = |cell: usize, seed: u64| {
                let place = seeds[cell].iter().position(|it| *it == seed).unwrap_or_default();
                &of_cells[cell][place]
            };
            let key = self.key(cell, seed, &source);
            let id = if cell.sources.is_empty() {
                let [environment, agent, protocol] = &cell.parts;
                trial_id(
                    [&environment.id, &agent.id, &protocol.id],
                    seed,
                    self.numerics,
                    DEVICE,
                )
            } else {
                key.id()
            };
            let purpose = match cell.place {
                Place::Combination(..) => Purpose::Cell,
                Place::Prepared(_) => Purpose::Prepared,
                Place::Tried(search) => Purpose::Tried(self.searches[search].0.name.clone()),
            };
            Trial {
                id,
                environment: environment.clone(),
                agent: agent.clone(),
                setting: cell.setting.clone(),
                point: cell.point.clone(),
                purpose,
                key,
            }
        };
        seeds[index].iter().map(trial).collect()
    }

    fn names(&self, cell: &Cell) -> (String, String) {
        match cell.place {
            Place::Combination(environment, agent) => {
                (self.environments[environment].clone(), self.agents[agent].clone())
            }
            Place::Prepared(index) => (self.prepared[index].clone(), cell.parts[1].part.plugin.clone()),
            Place::Tried(index) => {
                let search = &self.searches[index].0;
                (search.environment.clone(), search.agent.clone())
            }
        }
    }

    fn key<'a>(&self, cell: &Cell, seed: u64, source: &dyn Fn(usize, u64) -> &'a Trial) -> TrialKey {
        let part = |place: usize| {
            let mut part = cell.parts[place].part.clone();
            for it in cell.sources.iter().filter(|it| it.part == place) {
                let trial = source(it.cell, it.seed_for(seed)).id.clone();
                part.products
                    .insert(it.pointer.clone(), Taken { trial, kind: it.kind });
            }
            part
        };
        let agent = match cell
            .sources
            .iter()
            .find(|it| it.part == 1)
            .filter(|_| cell.is_policy())
        {
            Some(it) => policy_of(source(it.cell, it.seed_for(seed))),
            None => Seating::Agent(part(1)),
        };
        let (environment, protocol) = (part(0), part(2));
        TrialKey {
            environment,
            agent,
            protocol,
            seed,
            numerics: self.numerics,
            device: DEVICE.into(),
        }
    }
}

/// The policy that a trial left, in all seats.
fn policy_of(trial: &Trial) -> Seating {
    let agent = trial
        .key
        .agent
        .agent()
        .cloned()
        .unwrap_or_else(|| Part::new("", 0, serde_json::Value::Null));
    let member = Member {
        seats: Vec::new(),
        agent,
        trial: Some(trial.id.clone()),
    };
    Seating::Cast(Cast {
        roles: BTreeMap::from([(String::from("all"), member)]),
    })
}

impl Plan {
    /// Keeps the trials that are wanted, and those that they take from, through any number of steps.
    pub fn keep(&mut self, wanted: impl Fn(&Trial) -> bool) {
        let by_id: BTreeMap<&str, &Trial> = self
            .trials
            .iter()
            .map(|trial| (trial.id.as_str(), trial))
            .collect();
        let mut open: Vec<&Trial> = self.trials.iter().filter(|trial| wanted(trial)).collect();
        let mut kept: BTreeSet<String> = BTreeSet::new();
        let mut sources: BTreeSet<String> = BTreeSet::new();
        while let Some(trial) = open.pop() {
            if !kept.insert(trial.id.clone()) {
                continue;
            }
            for source in trial.key.sources() {
                open.extend(by_id.get(source.as_str()));
                sources.insert(source);
            }
        }
        // Two combinations may share a trial; one that is not wanted does not come in by the other.
        self.trials
            .retain(|trial| wanted(trial) || sources.contains(&trial.id));
    }
}
