//! The plan of a study: its trials in order, the reasons why those that are not stored are new, and their expected
//! time.

mod cross_play;
mod estimate;
mod explain;
mod leaves;
mod nearest;
mod novelty;
#[cfg(test)]
mod tests;

pub use estimate::{Estimate, estimate};
pub use execution::store::{StoredCell, Took};
pub use explain::{explain, to_json};
pub use leaves::Difference;
pub use novelty::{Novelty, Reason, novelties};

use crate::{
    cell::{Cell, Place},
    checked_study::Study,
};
use contract::{
    artifact::Taken,
    cast::{Actors, Cast, Member},
    part::Part,
    trial::{Combination, Purpose, Trial, TrialCell, TrialKey, trial_id},
};
use presentation::vocabulary::Play;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// The trials of a study: those of its entries of `prepare`, then of environments, agents, settings and seeds, in the
/// order of the study, then of its plays.
///
/// Two trials may have the same id: if a sweep does not affect an agent (a protocol's training budget and an agent that
/// does not learn), its trials appear once in each setting, and the numbers are computed once.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the study.
    pub study: String,
    /// Heading of the study.
    pub title: String,
    /// The trials, in the order of the plan.
    pub trials: Vec<Arc<Trial>>,
}

/// Number of seeds of each combination of environment, agent and setting; those that are not named have the seeds of
/// the first look.
pub type Wanted = BTreeMap<Combination, u32>;

/// Trials of cells that others take from, by the index of the cell, in the order of their seeds.
type TrialsByCell = BTreeMap<usize, Vec<Arc<Trial>>>;

impl Study {
    /// The agents of its trials, each with its config once.
    #[must_use]
    pub fn built_agents(&self) -> Vec<Arc<Part>> {
        let all = self.cells.iter().map(|cell| Arc::clone(&cell.parts[1].part));
        let by_place = all.map(|part| (Arc::as_ptr(&part), part));
        by_place.collect::<BTreeMap<_, _>>().into_values().collect()
    }

    /// The trials of a study before any result: all of them, or those of the first look.
    #[must_use]
    pub fn plan(&self) -> Plan {
        self.plan_with(&Wanted::new())
    }

    /// Number of trials of [`plan`](Self::plan), which most studies know without making them.
    #[must_use]
    pub fn n_trials(&self) -> usize {
        // Samples of a sweep that gave the same setting are the same trials.
        if self.design.is_some() || !self.plays.is_empty() || self.repeats.is_some() {
            let mut plan = self.plan();
            plan.keep_once();
            return plan.trials.len();
        }
        let (taken, waiting) = (self.seeds_taken(), self.waiting());
        let ready = (0..self.cells.len()).filter(|index| !waiting.contains(index));
        ready.map(|index| self.seeds_of(index, &taken).len()).sum()
    }

    /// The trials of the study when some combinations have reached a later look. The trials of a look follow those of
    /// the one before, so that a growing plan keeps the order of its trials.
    #[must_use]
    pub fn plan_with(&self, wanted: &Wanted) -> Plan {
        let mut plan = self.plan_of_all_seeds();
        let Some(design) = &self.design else { return plan };
        let first = self.first_seed();
        // Entries of `prepare` have seeds of their own.
        let place = |trial: &Trial| trial.key.seed.saturating_sub(first);
        let look = |trial: &Arc<Trial>| {
            let place = place(trial);
            design.looks().partition_point(|most| place >= u64::from(*most))
        };
        let seeds = |trial: &Trial| {
            wanted
                .get(&trial.cell.combination)
                .copied()
                .unwrap_or(design.looks()[0])
        };
        plan.keep(|trial| match trial.cell.purpose {
            Purpose::Prepared => false,
            Purpose::Tried(_) | Purpose::Imported => true,
            Purpose::Cell | Purpose::Play(_) => place(trial) < u64::from(seeds(trial)),
        });
        plan.trials.sort_by_key(look);
        plan
    }

    /// The first of the study's seeds.
    #[must_use]
    pub fn first_seed(&self) -> u64 {
        self.seeds.first().copied().unwrap_or_default()
    }

    fn plan_of_all_seeds(&self) -> Plan {
        let (seeds, waiting) = (self.seeds_taken(), self.waiting());
        let mut of_cells = TrialsByCell::new();
        // Trials of cells that others take from are made first; the others are made when they are added to the plan.
        let taken = self.taken_from();
        for &index in self
            .order
            .iter()
            .filter(|index| taken.contains(index) && !waiting.contains(index))
        {
            of_cells.insert(index, self.trials_of(index, &seeds, &of_cells));
        }
        let is_ready = |play: &&Play| !play.players.iter().any(|player| waiting.contains(&player.cell));
        let plays = self.plays.iter().filter(is_ready);
        let plays: Vec<Arc<Trial>> = plays
            .flat_map(|play| cross_play::trials(self, play, &of_cells))
            .collect();
        let n_combinations = self.cells.n_combinations();
        let mut trials = Vec::with_capacity(n_combinations * self.seeds.len() + plays.len());
        // Entries of `prepare` come first, then settings that searches try, then combinations.
        for index in (n_combinations..self.cells.len()).chain(0..n_combinations) {
            if let Some(made) = of_cells.get(&index) {
                trials.extend(made.iter().cloned());
            } else if !waiting.contains(&index) {
                trials.extend(self.trials_of(index, &seeds, &of_cells));
            }
        }
        trials.extend(plays);
        Plan {
            study: self.name.clone(),
            title: self.title.clone(),
            trials,
        }
    }

    /// The cells that others take from, or whose policies take part in plays.
    fn taken_from(&self) -> BTreeSet<usize> {
        let sources = self.order.iter().flat_map(|index| self.cells.sources(*index));
        let players = self.plays.iter().flat_map(|play| &play.players);
        sources
            .map(|source| source.cell)
            .chain(players.map(|player| player.cell))
            .collect()
    }

    /// The steps at which searches pause trials of a plan, by id. A trial that another cell also needs runs to its end.
    #[must_use]
    pub fn pauses(&self, plan: &Plan) -> BTreeMap<String, u64> {
        let (mut pauses, mut whole) = (BTreeMap::new(), BTreeSet::new());
        if self.searches.is_empty() {
            return pauses;
        }
        let mut met: BTreeMap<&str, usize> = BTreeMap::new();
        for trial in &plan.trials {
            let stop = match &trial.cell.purpose {
                Purpose::Tried(name) => {
                    let met = met.entry(name).or_default();
                    *met += 1;
                    self.stop(name, *met - 1)
                }
                _ => None,
            };
            match stop {
                // If several brackets have equal settings, the latest pause holds.
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

    /// The step at which a trial of a search pauses, by its place among the settings.
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
            let pair = self.cells.place(index).pair();
            let own = pair.is_some_and(|(_, agent)| open(&self.agents[agent]));
            let mut sources = self.cells.sources(index).iter();
            if own || sources.any(|source| waiting.contains(&source.cell)) {
                waiting.insert(index);
            }
        }
        waiting
    }

    /// The seeds that other cells take from each cell.
    fn seeds_taken(&self) -> BTreeMap<usize, Vec<u64>> {
        let mut taken: BTreeMap<usize, Vec<u64>> = BTreeMap::new();
        for &index in self.order.iter().rev() {
            for source in self.cells.sources(index) {
                let seeds = self.seeds_of(index, &taken).iter();
                let more: Vec<u64> = seeds.map(|seed| source.seed_for(*seed)).collect();
                let of_source = taken.entry(source.cell).or_default();
                of_source.extend(more);
                of_source.sort_unstable();
                of_source.dedup();
            }
        }
        taken
    }

    /// The seeds that a cell runs: those of the study, or for an entry of `prepare` those that other cells take.
    fn seeds_of<'a>(&'a self, index: usize, taken: &'a BTreeMap<usize, Vec<u64>>) -> &'a [u64] {
        match self.cells.place(index) {
            Place::Combination(..) => &self.seeds,
            Place::Tried(search) => &self.searches[search].0.seeds,
            Place::Prepared(_) | Place::Leading(..) => taken.get(&index).map_or(&[], Vec::as_slice),
        }
    }

    /// The trials of a cell, once the trials that it takes from exist. Parts that do not depend on the seed are made
    /// and hashed once.
    fn trials_of(
        &self,
        index: usize,
        taken: &BTreeMap<usize, Vec<u64>>,
        of_cells: &TrialsByCell,
    ) -> Vec<Arc<Trial>> {
        let cell = self.cells.at(index);
        // A source runs the seeds that are taken from it, and precedes this cell in the order of cells.
        let source = |cell: usize, seed: u64| {
            let seeds = self.seeds_of(cell, taken);
            let place = seeds.iter().position(|it| *it == seed).unwrap_or_default();
            &*of_cells[&cell][place]
        };
        let named = Arc::new(self.named(&cell));
        let shared = cell.sources.is_empty().then(|| self.key(&cell, 0, &source));
        let trial = |&seed: &u64| {
            let (id, key) = match &shared {
                Some(shared) => (self.id(&cell, seed), shared.with_seed(seed)),
                None => {
                    let key = self.key(&cell, seed, &source);
                    (key.id(), key)
                }
            };
            let cell = Arc::clone(&named);
            Arc::new(Trial { id, cell, key })
        };
        self.seeds_of(index, taken).iter().map(trial).collect()
    }

    /// The id of a trial of a cell that takes no artifact.
    fn id(&self, cell: &Cell, seed: u64) -> String {
        let parts = cell.parts.each_ref().map(|part| part.id());
        trial_id(parts, seed, self.numerics)
    }

    fn named(&self, cell: &Cell) -> TrialCell {
        let (environment, agent) = self.names(cell);
        let purpose = match cell.place {
            Place::Combination(..) => Purpose::Cell,
            Place::Prepared(_) | Place::Leading(..) => Purpose::Prepared,
            Place::Tried(search) => Purpose::Tried(self.searches[search].0.name.clone()),
        };
        let combination = Combination {
            environment,
            agent,
            point: cell.point.clone(),
        };
        TrialCell { combination, purpose }
    }

    fn names(&self, cell: &Cell) -> (String, String) {
        match cell.place {
            Place::Combination(environment, agent) => {
                (self.environments[environment].clone(), self.agents[agent].clone())
            }
            Place::Leading(environment, agent) => {
                let (environment, agent) = (&self.environments[environment], &self.agents[agent]);
                (format!("schedule of {agent} in {environment}"), agent.clone())
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
            let mut part = Arc::clone(&cell.parts[place].part);
            for it in cell.sources.iter().filter(|it| it.part == place) {
                let trial = source(it.cell, it.seed_for(seed)).id.clone();
                Arc::make_mut(&mut part)
                    .artifacts
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
            None => Actors::Agent(Arc::unwrap_or_clone(part(1))),
        };
        TrialKey {
            environment: part(0),
            agent: agent.into(),
            protocol: part(2),
            seed,
            numerics: self.numerics,
        }
    }
}

/// The policy that a trial left, in all seats.
fn policy_of(trial: &Trial) -> Actors {
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
    Actors::Cast(Cast {
        roles: BTreeMap::from([(String::from("all"), member)]),
    })
}

impl Plan {
    /// Keeps the wanted trials and their direct and indirect sources.
    pub fn keep(&mut self, wanted: impl Fn(&Trial) -> bool) {
        let sources = self.sources_of(&wanted);
        // Two combinations may share a trial; one that is not wanted must not be kept because of the other.
        self.trials
            .retain(|trial| wanted(trial) || sources.contains(&trial.id));
    }

    /// Keeps each trial once in its combination: a search may propose the same setting twice.
    pub fn keep_once(&mut self) {
        let mut seen = BTreeSet::new();
        self.trials
            .retain(|trial| seen.insert((trial.cell.combination.clone(), trial.id.clone())));
    }

    /// The ids of the direct and indirect sources of the wanted trials.
    fn sources_of(&self, wanted: impl Fn(&Trial) -> bool) -> BTreeSet<String> {
        let mut open: Vec<String> = self
            .trials
            .iter()
            .filter(|trial| trial.key.takes() && wanted(trial))
            .flat_map(|trial| trial.key.sources())
            .collect();
        let mut sources = BTreeSet::new();
        if open.is_empty() {
            return sources;
        }
        let by_id: BTreeMap<&str, &Trial> = self
            .trials
            .iter()
            .map(|trial| (trial.id.as_str(), &**trial))
            .collect();
        while let Some(id) = open.pop() {
            if sources.contains(&id) {
                continue;
            }
            open.extend(
                by_id
                    .get(id.as_str())
                    .iter()
                    .flat_map(|source| source.key.sources()),
            );
            sources.insert(id);
        }
        sources
    }
}
