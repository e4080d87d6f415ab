//! What a report shows, computed: grids, charts, claims, and how many of each outcome there are.

use super::StudyInfo;
use crate::{
    cross_play::Encounters,
    figure::{self, Chart},
    results::{Results, TrialResult},
    statistics::{Aggregate, Claim, ClaimOutcome, ClaimVerdict, Operand, Verdict, claim, evaluate},
    table::{self, Axis, Grid, NumberFormat, Scope, TableSpec},
};
use std::collections::BTreeSet;

/// The words of verdicts on published values, in the order in which they are shown.
pub const VERDICT_WORDS: [&str; 5] = ["REPRODUCED", "DIFFERS", "INCONCLUSIVE", "NOT RUN", "FAILED"];
/// The words of verdicts on claims, in the order in which they are shown.
pub const CLAIM_WORDS: [&str; 5] = ["SUPPORTED", "REFUTED", "INCONCLUSIVE", "NOT RUN", UNREAD];
const UNREAD: &str = "NOT READ";

/// Everything that a report shows, in the order of the study. What could not be made holds the reason in its place.
#[derive(Debug, Clone, Default)]
pub struct Contents {
    /// Tables by name.
    pub tables: Vec<(String, Result<Grid, String>)>,
    /// Figures by name.
    pub figures: Vec<(String, Result<Chart, String>)>,
    /// Claims, a line for each environment and setting that they are held against.
    pub claims: Vec<ClaimLine>,
}

/// A claim in one environment.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimLine {
    /// The claim as the study has it.
    pub text: String,
    /// The environment, and the setting where there are several.
    pub place: String,
    /// What the seeds say; the reason where the claim cannot be read.
    pub verdict: Result<ClaimVerdict, String>,
}

impl Contents {
    /// Computes all tables, figures and claims of a study.
    #[must_use]
    pub fn of(study: &StudyInfo, results: &Results) -> Self {
        let context = figure::Context { results, agents: &study.agents, units: &study.units };
        let grid = |spec: &TableSpec| make_table(spec, study, results).map_err(|error| error.to_string());
        let chart = |spec| figure::build(spec, context).map_err(|error| error.to_string());
        Self {
            tables: study.tables.iter().map(|(name, spec)| (name.clone(), grid(spec))).collect(),
            figures: study.figures.iter().map(|(name, spec)| (name.clone(), chart(spec))).collect(),
            claims: study.claims.iter().flat_map(|(text, place)| claim_lines(text, place.as_deref(), study, results)).collect(),
        }
    }

    /// How many published values have each verdict, in the order of [`VERDICT_WORDS`].
    #[must_use]
    pub fn verdicts(&self) -> [(&'static str, usize); 5] {
        let cells = || self.tables.iter().filter_map(|(_, grid)| grid.as_ref().ok()).flat_map(|grid| grid.cells.iter().flatten());
        VERDICT_WORDS.map(|word| (word, cells().filter(|cell| cell.verdict().map(Verdict::word) == Some(word)).count()))
    }

    /// How many claims have each verdict, in the order of [`CLAIM_WORDS`]; a claim counts once per environment.
    #[must_use]
    pub fn outcomes(&self) -> [(&'static str, usize); 5] {
        CLAIM_WORDS.map(|word| (word, self.claims.iter().filter(|line| line.word() == word).count()))
    }

    /// True where a published value differs or a claim is refuted.
    #[must_use]
    pub fn contradicts(&self) -> bool {
        self.verdicts()[1].1 > 0 || self.outcomes()[1].1 > 0
    }
}

fn make_table(spec: &TableSpec, study: &StudyInfo, results: &Results) -> Result<Grid, crate::Error> {
    let mut grid = table::build(spec, results)?;
    let comparison = spec.improvement.as_ref().or(spec.comparison.as_ref());
    let compared = comparison.filter(|comparison| comparison.has_unit_of_metric()).map(|comparison| &comparison.value);
    let raw = spec.cross_play.as_ref().filter(|matrix| !matrix.normalise).map(|matrix| &matrix.value);
    if let Some(metric) = compared.or(raw) {
        grid.unit = study.units.get(metric).filter(|unit| *unit != "1").cloned().unwrap_or_default();
    }
    Ok(grid)
}

impl ClaimLine {
    /// The word of the verdict.
    #[must_use]
    pub fn word(&self) -> &'static str {
        self.verdict.as_ref().map_or(UNREAD, |verdict| verdict.verdict.word())
    }

    /// The difference between the sides with its interval and the number of seeds; empty where nothing has run.
    #[must_use]
    pub fn numbers(&self) -> String {
        let Ok(verdict) = &self.verdict else { return String::new() };
        let Some(difference) = verdict.difference else { return String::new() };
        let ends = verdict.interval.map(|interval| [interval.low, interval.high]);
        let format = NumberFormat::fitting(ends.into_iter().flatten().chain([difference]));
        let interval = verdict.interval.map_or(String::new(), |interval| {
            format!(
                " [{}, {}] at {} %",
                format.write(interval.low),
                format.write(interval.high),
                (100.0 * interval.level).round()
            )
        });
        let pairs = if verdict.paired { "pairs" } else { "seeds" };
        format!("{}{interval}, n = {} {pairs}", format.write(difference), verdict.n)
    }

    /// What the reader must know besides.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        match &self.verdict {
            Err(reason) => vec![reason.clone()],
            Ok(verdict) => {
                let more = verdict.more_seeds.filter(|_| verdict.verdict == ClaimOutcome::Inconclusive);
                let more = more.map(|more| format!("about {more} more seeds would decide"));
                let advised = verdict.notes.iter().any(|note| note.contains("would decide"));
                verdict.notes.iter().cloned().chain(more.filter(|_| !advised)).collect()
            }
        }
    }
}

fn claim_lines(text: &str, place: Option<&str>, study: &StudyInfo, results: &Results) -> Vec<ClaimLine> {
    let claim = match claim::parse(text) {
        Ok(claim) => claim,
        Err(error) => return vec![ClaimLine { text: text.into(), place: String::new(), verdict: Err(error.to_string()) }],
    };
    if claim.operands().iter().all(|operand| operand.within.is_some()) {
        let plays: BTreeSet<&str> =
            claim.operands().into_iter().filter_map(|it| Some(it.within.as_ref()?.play.as_str())).collect();
        let verdict = Ok(evaluate(&claim, &|operand: &Operand| in_play(results, operand)));
        return vec![ClaimLine { text: text.into(), place: plays.into_iter().collect::<Vec<_>>().join(", "), verdict }];
    }
    let environments = match claim.environment.as_deref().or(place) {
        Some(environment) => vec![environment.to_owned()],
        None => study.environments.clone(),
    };
    let all = Scope { trials: results.trials.iter().collect() };
    let in_environment = |environment: &String| {
        let scope = all.at(Axis::Environment, environment);
        let line = |setting: Option<String>| {
            let place = setting.as_ref().map_or(environment.clone(), |setting| format!("{environment}, {setting}"));
            let values = |operand: &Operand| match operand.within {
                Some(_) => in_play(results, operand),
                None => values(&scope, operand, setting.as_deref()),
            };
            ClaimLine { text: text.into(), place, verdict: Ok(evaluate(&claim, &values)) }
        };
        settings(&claim, &scope).into_iter().map(line).collect::<Vec<_>>()
    };
    environments.iter().flat_map(in_environment).collect()
}

/// The settings that a claim is held against one by one: those of its agents that have several. Settings are never pooled.
fn settings(claim: &Claim, scope: &Scope<'_>) -> Vec<Option<String>> {
    let mut settings: Vec<Option<String>> = Vec::new();
    for operand in claim.operands() {
        let own = scope.at(Axis::Agent, &operand.agent).names(Axis::Setting, &[]);
        let new = own.iter().filter(|_| own.len() > 1).cloned().map(Some).filter(|setting| !settings.contains(setting));
        settings.extend(new.collect::<Vec<_>>());
    }
    if settings.is_empty() { vec![None] } else { settings }
}

/// One value per seed of an agent in a role of a play: the mean over its trained opponents; `None` where there is none.
fn in_play(results: &Results, operand: &Operand) -> Option<Vec<(u64, f64)>> {
    let within = operand.within.as_ref().filter(|_| operand.aggregate == Aggregate::Final)?;
    let encounters = Encounters::of(results, &within.play);
    let values: Vec<_> = encounters.by_seed(&[(&within.role, &operand.agent)], &operand.metric).into_iter().collect();
    (!values.is_empty()).then_some(values)
}

/// One value per seed of an operand, of the setting where its agent has several; `None` where there is none.
fn values(scope: &Scope<'_>, operand: &Operand, setting: Option<&str>) -> Option<Vec<(u64, f64)>> {
    let mut scope = scope.at(Axis::Agent, &operand.agent);
    if let Some(setting) = setting.filter(|_| scope.varies(Axis::Setting)) {
        scope = scope.at(Axis::Setting, setting);
    }
    let value = |trial: &&TrialResult| Some((trial.trial.key.seed, operand.aggregate.of_trial(trial, &operand.metric)?));
    let values: Vec<(u64, f64)> = scope.trials.iter().filter(|trial| trial.is_ok()).filter_map(value).collect();
    (!values.is_empty()).then_some(values)
}
