//! Computes stored trials again, beside the store, and compares their digests.

use crate::{
    Exit, Failure, Session,
    compute::Compute,
    one_trial::named,
    planned::costs,
    programs::{self, Program},
};
use contract::{Error, Registry, trial::Trial, trial_end::EndState};
use document::count::count;
use execution::{
    limits::Limits,
    scheduler::Task,
    store::{Fingerprint, Store, TrialFile},
    verification::{Receipt, ReceiptEntry, VerificationOutcome, cannot, id_here, rounds, sample},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};
use study::plan::Plan;

/// Schema version of the receipt.
const SCHEMA: u32 = 1;

/// The trials to compute again, and options of the computation.
#[derive(Debug, Clone, Default)]
pub struct VerifyOptions {
    /// Number of trials to draw at random; all where absent.
    pub sample: Option<usize>,
    /// Seed of the sample: the same seed draws the same trials.
    pub seed: u64,
    /// Number of worker processes; the machine's setting where absent.
    pub jobs: Option<usize>,
    /// Limits that replace those of study and machine.
    pub limits: Limits,
}

/// A stored trial that may be computed again.
struct Candidate {
    trial: Arc<Trial>,
    limits: Arc<Limits>,
    /// The step of the pause up to which it is computed; `None` for a trial that has ended.
    until: Option<u64>,
}

/// The stored trials that can be computed again, and those that cannot.
#[derive(Default)]
pub struct Verifiable {
    /// The trials that can be computed again, by id.
    candidates: BTreeMap<String, Candidate>,
    /// Trials that cannot be computed again.
    others: Vec<ReceiptEntry>,
    missing: usize,
    not_ok: usize,
    studies: Vec<String>,
}

impl Session<'_> {
    /// The stored trials of the studies, or of the whole store if no study is selected.
    ///
    /// # Errors
    /// Fails if there is no stored trial, and for a store that cannot be read.
    pub fn verifiable(&self, options: &VerifyOptions) -> Result<Verifiable, Failure> {
        let (how, store) = (self.again_by(options), self.store()?);
        let found = match self.selection.specs.is_empty() {
            true => of_store(&how, store)?,
            false => of_studies(&how, store)?,
        };
        if found.candidates.is_empty() && found.others.is_empty() {
            return Err(Failure {
                exit: Exit::NothingSelected,
                text: format!("no trial of `{}` can be computed again", store.root().display()),
            });
        }
        Ok(found)
    }

    /// The programs that [`verify`](Self::verify) starts.
    ///
    /// # Errors
    /// A program that cannot be built.
    pub fn programs_to_verify(&self, found: &Verifiable) -> Result<BTreeSet<Program>, Failure> {
        let trials = found.candidates.values().map(|it| &*it.trial);
        programs::of_trials(self.registry, trials, self.selection.specs.first())
    }

    /// Computes trials again, beside the store, and compares the results with the stored ones.
    ///
    /// # Errors
    /// Trials that do not fit on the machine, and stores that cannot be written.
    pub fn verify(&self, found: Verifiable, options: &VerifyOptions) -> Result<Receipt, Failure> {
        receipt(&self.again_by(options), found, self.store()?, options)
    }

    fn again_by(&self, options: &VerifyOptions) -> Compute<'_> {
        Compute {
            limits: options.limits.clone(),
            ..Compute::of(self, options.jobs.unwrap_or(self.settings.workers))
        }
    }
}

/// The exit of a command with this receipt.
#[must_use]
pub fn exit_of_receipt(receipt: &Receipt) -> Exit {
    if receipt.count(|it| matches!(it, VerificationOutcome::Different { .. })) > 0 {
        Exit::Differs
    } else if receipt.count(|it| *it != VerificationOutcome::Same) > 0 {
        Exit::Incomplete
    } else {
        Exit::Ok
    }
}

/// The stored trials of studies.
fn of_studies(how: &Compute<'_>, store: &Store) -> Result<Verifiable, Failure> {
    let mut found = Verifiable::default();
    let mut absent: BTreeMap<String, Arc<Trial>> = BTreeMap::new();
    let mut seen = BTreeSet::new();
    for one in how.session.load_with_looks()? {
        let limits = Arc::new(how.limits_of(&one.study.limits));
        found.studies.push(one.study.name.clone());
        how.session.say_imported(&one, "cannot be computed again here");
        for trial in &one.paused {
            if seen.insert(trial.id.clone()) {
                found.look_at_pause(trial, &limits, store)?;
            }
        }
        for trial in one.plan.trials {
            // Studies and settings may share trials.
            if !seen.insert(trial.id.clone()) {
                continue;
            }
            match found.look(trial, &limits, store)? {
                None => {}
                Some(trial) => drop(absent.insert(trial.id.clone(), trial)),
            }
        }
    }
    found.missing = absent.len();
    if !absent.is_empty() {
        found.of_other_versions(&absent, how.session.registry, store);
    }
    Ok(found)
}

/// Every trial of a store.
fn of_store(how: &Compute<'_>, store: &Store) -> Result<Verifiable, Failure> {
    let mut found = Verifiable::default();
    let limits = Arc::new(how.limits_of(&Limits::default()));
    for id in store.ids_beginning_with("") {
        // An unreadable trial has no names.
        let ended = store.file(&id).ok().flatten().map(|file| file.key);
        let has_ended = ended.is_some();
        let paused = || Some(store.partial(&id).ok()??.file.key);
        match ended.or_else(paused) {
            Some(key) => match cannot(&key, how.session.registry) {
                Some(problem) => {
                    let entry = entry(&named(&id, key), VerificationOutcome::CannotVerify { problem });
                    found.others.push(entry);
                }
                None if has_ended => drop(found.look(named(&id, key).into(), &limits, store)?),
                None => found.look_at_pause(&named(&id, key).into(), &limits, store)?,
            },
            None => found.unreadable(&id, store),
        }
    }
    Ok(found)
}

fn entry(trial: &Trial, outcome: VerificationOutcome) -> ReceiptEntry {
    ReceiptEntry {
        trial: trial.id.clone(),
        environment: trial.cell.environment.clone(),
        agent: trial.cell.agent.clone(),
        setting: trial.cell.point.words().to_owned(),
        seed: trial.key.seed,
        stored: None,
        now: None,
        outcome,
    }
}

impl Verifiable {
    /// Takes in a trial that the store knows; returns a trial without any stored data.
    fn look(
        &mut self,
        trial: Arc<Trial>,
        limits: &Arc<Limits>,
        store: &Store,
    ) -> Result<Option<Arc<Trial>>, Failure> {
        match store.end(&trial.id) {
            // The trial's record at a pause may be damaged.
            Ok(None) => match store.partial(&trial.id) {
                Err(Error::Damaged { .. }) => self.look_at_pause(&trial, limits, store)?,
                _ => return Ok(Some(trial)),
            },
            Ok(Some(end)) if end.state != EndState::Ok => self.not_ok += 1,
            Ok(Some(_)) => {
                let (id, limits, until) = (trial.id.clone(), Arc::clone(limits), None);
                self.candidates.insert(id, Candidate { trial, limits, until });
            }
            Err(error @ Error::Damaged { .. }) => {
                let problem = error.to_string();
                self.others
                    .push(entry(&trial, VerificationOutcome::Damaged { problem }));
            }
            Err(error) => return Err(error.into()),
        }
        Ok(None)
    }

    /// Takes in a trial at its pause.
    fn look_at_pause(
        &mut self,
        trial: &Arc<Trial>,
        limits: &Arc<Limits>,
        store: &Store,
    ) -> Result<(), Failure> {
        match store.partial(&trial.id) {
            Ok(Some(partial)) if partial.file.end.state == EndState::Paused => {
                let candidate = Candidate {
                    trial: Arc::clone(trial),
                    limits: Arc::clone(limits),
                    until: partial.step(),
                };
                self.candidates.insert(trial.id.clone(), candidate);
            }
            // The trial has failed since, or only its log is stored.
            Ok(_) => self.not_ok += 1,
            Err(error @ Error::Damaged { .. }) => {
                let problem = error.to_string();
                self.others
                    .push(entry(trial, VerificationOutcome::Damaged { problem }));
            }
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    /// Takes in a trial whose acknowledgement is damaged. A trial without an acknowledgement has not run.
    fn unreadable(&mut self, id: &str, store: &Store) {
        if let Err(error) = store.file(id).and(store.partial(id).map(drop)) {
            self.others.push(ReceiptEntry {
                trial: id.to_owned(),
                environment: String::new(),
                agent: String::new(),
                setting: String::new(),
                seed: 0,
                stored: None,
                now: None,
                outcome: VerificationOutcome::Damaged {
                    problem: error.to_string(),
                },
            });
        }
    }

    /// Finds stored trials that other versions of plugins computed in place of the missing ones.
    fn of_other_versions(
        &mut self,
        absent: &BTreeMap<String, Arc<Trial>>,
        registry: &Registry,
        store: &Store,
    ) {
        for id in store.ids_beginning_with("") {
            let Ok(Some(file)) = store.file(&id) else { continue };
            let Some(problem) = cannot(&file.key, registry) else {
                continue;
            };
            if let Some(trial) = absent.get(&id_here(&file.key, registry)) {
                let stored = Some(Fingerprint::of(&file, store));
                let outcome = VerificationOutcome::CannotVerify { problem };
                self.others.push(ReceiptEntry {
                    trial: id,
                    stored,
                    ..entry(trial, outcome)
                });
            }
        }
    }
}

fn receipt(
    how: &Compute<'_>,
    found: Verifiable,
    store: &Store,
    options: &VerifyOptions,
) -> Result<Receipt, Failure> {
    let ids: BTreeSet<&str> = found.candidates.keys().map(String::as_str).collect();
    let drawn = sample(&ids, options.sample, options.seed);
    let drawn: Vec<&Candidate> = drawn.into_iter().map(|id| &found.candidates[id]).collect();
    let mut trials = compute(how, &drawn, store)?;
    trials.extend(found.others);
    Ok(Receipt {
        schema: SCHEMA,
        program: format!("regimen {}", env!("CARGO_PKG_VERSION")),
        build: how.session.registry.build.clone(),
        store: store.root().to_owned(),
        studies: found.studies,
        eligible: found.candidates.len(),
        sample: options.sample,
        seed: options.seed,
        missing: found.missing,
        not_ok: found.not_ok,
        trials,
    })
}

/// Computes trials again, round by round, each round in a temporary store.
fn compute(how: &Compute<'_>, drawn: &[&Candidate], store: &Store) -> Result<Vec<ReceiptEntry>, Failure> {
    let trials: Vec<&Trial> = drawn.iter().map(|candidate| &*candidate.trial).collect();
    let mut entries: BTreeMap<usize, ReceiptEntry> = BTreeMap::new();
    for round in rounds(&trials) {
        let folder = tempfile::Builder::new()
            .prefix("regimen-verify-")
            .tempdir()
            .map_err(Error::file("create a folder in", &std::env::temp_dir()))?;
        let beside = Store::at(folder.path()).by(how.session.registry.build.clone());
        let members: Vec<&Candidate> = round.iter().map(|place| drawn[*place]).collect();
        entries.extend(
            round
                .iter()
                .copied()
                .zip(one_round(how, &members, store, &beside)?),
        );
    }
    Ok(entries.into_values().collect())
}

fn one_round(
    how: &Compute<'_>,
    members: &[&Candidate],
    store: &Store,
    beside: &Store,
) -> Result<Vec<ReceiptEntry>, Failure> {
    let mut entries: Vec<ReceiptEntry> = members
        .iter()
        .map(|member| begun(member, store, beside))
        .collect();
    let ready: Vec<&Candidate> = members
        .iter()
        .zip(&entries)
        .filter(|(_, entry)| is_open(entry))
        .map(|(member, _)| *member)
        .collect();
    let tasks = tasks(how, &ready);
    if !tasks.is_empty() {
        how.session.notice(&format!(
            "computing {} again on {}",
            count(tasks.len(), "trial"),
            how.processes(tasks.len())
        ));
        how.refuse_unfit(&tasks)?;
        how.work(&tasks, beside)?;
    }
    for (entry, member) in entries.iter_mut().zip(members) {
        if is_open(entry) {
            *entry = ended(entry.clone(), stored_of(member, beside)?, beside);
        }
    }
    Ok(entries)
}

/// The problem of a trial that has not ended yet.
const NOT_ENDED: &str = "it did not end";

fn is_open(entry: &ReceiptEntry) -> bool {
    matches!(&entry.outcome, VerificationOutcome::NotComputed { problem } if problem == NOT_ENDED)
}

/// The file that acknowledges a trial in a store, at its end or at its pause, after its files were checked.
fn stored_of(member: &Candidate, store: &Store) -> Result<Option<TrialFile>, Error> {
    match member.until {
        None => store.sound(&member.trial.id),
        Some(_) => Ok(store.partial(&member.trial.id)?.map(|partial| partial.file)),
    }
}

/// Checks the stored files of a trial, and makes the artifacts that it takes available in the store in which it is
/// computed.
fn begun(member: &Candidate, store: &Store, beside: &Store) -> ReceiptEntry {
    let trial = &*member.trial;
    let open = entry(
        trial,
        VerificationOutcome::NotComputed {
            problem: NOT_ENDED.into(),
        },
    );
    let stored = match stored_of(member, store) {
        Ok(Some(file)) => Fingerprint::of(&file, store),
        Ok(None) => {
            let problem = "it was stored a moment ago, and is gone".into();
            let outcome = VerificationOutcome::Damaged { problem };
            return ReceiptEntry { outcome, ..open };
        }
        Err(error) => {
            let problem = error.to_string();
            let outcome = VerificationOutcome::Damaged { problem };
            return ReceiptEntry { outcome, ..open };
        }
    };
    let lent = trial
        .key
        .taken()
        .iter()
        .try_for_each(|taken| store.lend(taken, beside));
    let open = ReceiptEntry {
        stored: Some(stored),
        ..open
    };
    match lent {
        Ok(()) => open,
        Err(error) => ReceiptEntry {
            outcome: VerificationOutcome::NotComputed {
                problem: error.to_string(),
            },
            ..open
        },
    }
}

/// The trials as tasks of the scheduler.
fn tasks<'a>(how: &Compute<'_>, members: &[&'a Candidate]) -> Vec<Task<'a>> {
    let plan = Plan {
        study: String::new(),
        title: String::new(),
        trials: members.iter().map(|member| Arc::clone(&member.trial)).collect(),
    };
    let costs = costs(how.session.registry, &plan);
    let task = |(member, cost): (&&'a Candidate, u64)| Task {
        trial: &member.trial,
        cost,
        pace_s: None,
        limits: Arc::clone(&member.limits),
        before: None,
        after: member.trial.key.sources(),
        until: member.until,
        needs: how.session.registry.needs(member.trial.key.agent.agent()),
    };
    members.iter().zip(costs).map(task).collect()
}

fn ended(entry: ReceiptEntry, file: Option<TrialFile>, store: &Store) -> ReceiptEntry {
    match file {
        Some(file) if matches!(file.end.state, EndState::Ok | EndState::Paused) => {
            entry.compared(Fingerprint::of(&file, store))
        }
        Some(file) => {
            let problem = format!("it ended as {} now: {}", file.end.state.name(), file.end.reason);
            ReceiptEntry {
                now: Some(Fingerprint::of(&file, store)),
                outcome: VerificationOutcome::NotComputed { problem },
                ..entry
            }
        }
        None => entry,
    }
}
