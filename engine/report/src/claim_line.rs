//! Lines of claims: each claim in each environment and setting, with its verdict.

use super::{
    claim_settings::{lacking, of_setting, settings},
    floors,
    notes::with_agents,
    rounds::RoundVerdict,
    study_info::StudyInfo,
};
use analysis::{
    claim::{self, Aggregate, Claim, ClaimOutcome, ClaimVerdict, NumberOrigin, Operand, evaluate},
    cross_play::Encounters,
    results::{Programs, Results},
    training_share::{self, trained},
};
use contract::{trial::Combination, trial_result::TrialResult};
use presentation::{
    claim_spec::ClaimSpec,
    table::{Axis, NumberFormat, Scope, changed_rule_in_words, unplanned_look_in_words, untrained_in_words},
};
use statistics::{
    Seeds, TrainingShare,
    verdict::{self, NOT_AT_THIS_BUDGET},
};
use std::collections::BTreeSet;

/// The word for a claim that cannot be read.
pub const UNREAD: &str = "NOT READ";

/// A claim in one environment.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimLine {
    /// Number of the claim in the study, from 1.
    pub number: usize,
    /// The claim as the study has it.
    pub spec: ClaimSpec,
    /// The environment, and the setting where there are several.
    pub place: String,
    /// The verdict of the seeds; the reason where the claim cannot be read.
    pub verdict: Result<ClaimVerdict, String>,
    /// The smallest difference that matters to the claim, in the unit of its metric; `None` where any difference
    /// matters.
    pub min_effect: Option<f64>,
    /// Share of the source's training behind the claim; `None` where the study does not state it.
    pub training: Option<TrainingShare>,
    /// An earlier number of seeds at which the verdict was seen without a plan.
    pub seen_at: Option<u32>,
    /// First rule of the verdict, if it was changed after the verdict was seen; the verdict is exploratory in that
    /// case.
    pub first_judged_by: Option<String>,
    /// Seeds that the verdict may rest on.
    pub looks: Seeds,
    /// The combinations whose seeds are behind it.
    pub rests_on: BTreeSet<Combination>,
    /// The verdict of each round alone, where there are several; `verdict` is that of all rounds together.
    pub rounds: Vec<RoundVerdict>,
}

impl ClaimLine {
    /// Approximate number of fresh seeds that would decide an open claim without looks left.
    pub(super) fn seeds_to_decide(&self) -> Option<u32> {
        let claim = self.verdict.as_ref().ok()?;
        let open = claim.verdict.is_open();
        let more = claim.more_seeds.filter(|_| open)?;
        u32::try_from(claim.n).ok().map(|n| n + more)
    }

    /// The claim with its environment and setting, unless its text ends with them.
    #[must_use]
    pub fn in_place(&self) -> String {
        let place = format!(" in {}", self.place);
        if self.place.is_empty() || self.spec.claim.ends_with(&place) {
            self.spec.claim.clone()
        } else {
            format!("{}{place}", self.spec.claim)
        }
    }

    /// Word of the verdict, [`UNREAD`] where the claim cannot be read.
    #[must_use]
    pub fn word(&self) -> &'static str {
        self.verdict
            .as_ref()
            .map_or(UNREAD, |verdict| verdict.verdict.word())
    }

    /// The verdict with all claims of the study taken together (Holm), where it differs from that of the claim alone.
    #[must_use]
    pub fn together(&self) -> Option<ClaimOutcome> {
        self.verdict
            .as_ref()
            .ok()
            .and_then(|claim| claim.adjusted.filter(|adjusted| *adjusted != claim.verdict))
    }

    /// The verdict, followed by the verdict with all claims together (Holm) where that differs.
    #[must_use]
    pub fn verdict_in_words(&self) -> String {
        let at = match self.training {
            Some(share) if self.word() == NOT_AT_THIS_BUDGET => format!(" ({})", share.percent()),
            _ => String::new(),
        };
        let together = self.together();
        let holm = together.map_or_else(String::new, |outcome| format!(" (Holm: {outcome})"));
        format!("{}{at}{holm}", self.word())
    }

    /// The difference between the sides with its interval, its level and the number of seeds; empty before trials
    /// have run.
    #[must_use]
    pub fn numbers(&self) -> String {
        let (Ok(verdict), Some(difference)) = (&self.verdict, self.difference()) else {
            return String::new();
        };
        let level = verdict.interval.map_or(String::new(), |interval| {
            let percent = (1000.0 * interval.level).round() / 10.0;
            format!(" at {percent} %")
        });
        format!("{difference}{level}, {}", verdict.size())
    }

    /// The difference between the sides with its interval; `None` before trials have run.
    pub(super) fn difference(&self) -> Option<String> {
        let verdict = self.verdict.as_ref().ok()?;
        let difference = verdict.difference?;
        let ends = verdict.interval.map(|interval| [interval.low, interval.high]);
        let format = NumberFormat::fitting(ends.into_iter().flatten().chain([difference]));
        let interval = ends.map_or(String::new(), |[low, high]| {
            format!(" [{}, {}]", format.write(low), format.write(high))
        });
        Some(format!("{}{interval}", format.write(difference)))
    }

    /// The cause of a refuted claim; `None` where the claim is not refuted or the study states no cause.
    #[must_use]
    pub fn cause(&self) -> Option<&str> {
        let refuted = matches!(&self.verdict, Ok(claim) if claim.verdict == ClaimOutcome::Refuted);
        let text = self.spec.cause.as_deref().filter(|_| refuted)?.trim();
        Some(text).filter(|text| !text.is_empty())
    }

    /// Whether the claim, or the rule of its verdict, was chosen after results were seen.
    #[must_use]
    pub fn is_exploratory(&self) -> bool {
        self.spec.exploratory || self.first_judged_by.is_some()
    }

    /// Cautions and remarks on the verdict.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let exploratory = self
            .spec
            .exploratory
            .then(|| "exploratory: thought of after results were seen".to_owned());
        let calibrated =
            self.spec
                .calibrated_on
                .as_ref()
                .map(|on| match self.word() == ClaimOutcome::Refuted.word() {
                    true => format!("in spite of calibration: {on}"),
                    false => format!("calibrated: {on}"),
                });
        let min_effect = self
            .min_effect
            .map(|min_effect| match self.spec.min_effect {
                Some(_) => min_effect.to_string(),
                None => NumberFormat::fitting([min_effect].into_iter()).write(min_effect),
            })
            .map(|min_effect| format!("differences of less than {min_effect} do not matter"));
        let training = self.training.filter(|share| share.own < share.paper);
        let training = training.map(|share| share.to_string());
        let why = (!self.spec.why.is_empty()).then(|| self.spec.why.clone());
        let unplanned = self.seen_at.map(unplanned_look_in_words);
        let changed = self.first_judged_by.as_deref().map(changed_rule_in_words);
        let found = match &self.verdict {
            Err(reason) => vec![reason.clone()],
            Ok(claim) => notes_of(claim),
        };
        found
            .into_iter()
            .chain(
                [
                    unplanned,
                    changed,
                    exploratory,
                    calibrated,
                    training,
                    min_effect,
                    why,
                ]
                .into_iter()
                .flatten(),
            )
            .collect()
    }
}

fn notes_of(claim: &ClaimVerdict) -> Vec<String> {
    let open = claim.verdict.is_open();
    let stage = claim
        .stage
        .filter(|_| claim.verdict.is_judged())
        .map(|stage| stage.phrase(open));
    let more = claim
        .more_seeds
        .filter(|_| open && claim.stage.is_none())
        .map(verdict::more_seeds_in_words);
    claim.notes.iter().cloned().chain(stage).chain(more).collect()
}

/// The lines of a claim, one for each environment and setting.
pub(super) fn claim_lines(
    number: usize,
    spec: &ClaimSpec,
    study: &StudyInfo,
    results: &Results,
) -> Vec<ClaimLine> {
    let claim = match claim::parse(&spec.claim) {
        Ok(claim) => claim,
        Err(error) => return vec![claim_line(number, spec, String::new(), Err(error.to_string()))],
    };
    let held = |scope: &Scope<'_>, setting: Option<&str>, place: String| {
        let held = held_in(&claim, (spec, study), results, scope, setting);
        held.line(number, spec, place, results)
    };
    // If there are several settings, their names follow the place.
    let in_settings = |scope: &Scope<'_>, place: &str| {
        let line = |setting: Option<String>| {
            let named = |setting: &String| format!("{place}, {setting}");
            let place = setting.as_ref().map_or(place.to_owned(), named);
            held(scope, setting.as_deref(), place)
        };
        settings(&claim, scope).into_iter().map(line).collect::<Vec<_>>()
    };
    let all = Scope {
        trials: results.trials.iter().collect(),
    };
    if let Some(plays) = plays_of(&claim) {
        return vec![held(&all, None, plays)];
    }
    if let Some([left, right]) = claim.environments_of_sides() {
        return in_settings(&all, &format!("{left}, {right}"));
    }
    let environments = match claim.environment.as_ref().or(spec.environment.as_ref()) {
        Some(environment) => vec![environment.clone()],
        None => study.environments.clone(),
    };
    let in_environment =
        |environment: &String| in_settings(&all.at(Axis::Environment, environment), environment);
    environments.iter().flat_map(in_environment).collect()
}

/// A line without trials behind it yet.
fn claim_line(
    number: usize,
    spec: &ClaimSpec,
    place: String,
    verdict: Result<ClaimVerdict, String>,
) -> ClaimLine {
    ClaimLine {
        number,
        spec: spec.clone(),
        place,
        verdict,
        seen_at: None,
        first_judged_by: None,
        min_effect: spec.min_effect,
        training: None,
        looks: Seeds::default(),
        rests_on: BTreeSet::new(),
        rounds: Vec::new(),
    }
}

/// The plays that a claim is about; `None` if it is also about trials.
fn plays_of(claim: &Claim) -> Option<String> {
    let plays = claim
        .operands()
        .into_iter()
        .map(|it| Some(it.within.as_ref()?.play.as_str()));
    let plays: BTreeSet<&str> = plays.collect::<Option<_>>()?;
    Some(plays.into_iter().collect::<Vec<_>>().join(", "))
}

/// The verdict on a claim, with the trials behind it.
struct JudgedClaim<'r> {
    verdict: ClaimVerdict,
    /// The smallest difference that matters, in the unit of the metric; `None` where any difference matters.
    min_effect: Option<f64>,
    /// The trials behind the verdict.
    trials: Vec<&'r TrialResult>,
    looks: Seeds,
}

impl JudgedClaim<'_> {
    fn line(self, number: usize, spec: &ClaimSpec, place: String, results: &Results) -> ClaimLine {
        let training = training_share::behind(&self.trials, results);
        let verdict = ClaimVerdict {
            verdict: self.verdict.verdict.at_budget(training),
            ..self.verdict
        };
        ClaimLine {
            looks: self.looks,
            min_effect: self.min_effect,
            training,
            rests_on: self
                .trials
                .iter()
                .map(|trial| trial.combination().clone())
                .collect(),
            ..claim_line(number, spec, place, Ok(verdict))
        }
    }
}

/// The verdict on a claim in a scope, in one setting of agents with several, and the trials behind it.
fn held_in<'r>(
    claim: &Claim,
    (spec, study): (&ClaimSpec, &StudyInfo),
    results: &'r Results,
    scope: &Scope<'r>,
    setting: Option<&str>,
) -> JudgedClaim<'r> {
    let operands = claim.operands().into_iter();
    let trials: Vec<&TrialResult> = operands
        .flat_map(|operand| trials_behind(scope, results, operand, setting))
        .collect();
    let looks = results.seeds_of(&trials);
    let found = |operand: &Operand, limit: u64| match operand.within {
        Some(_) => in_play(results, operand, limit),
        None => values(scope, operand, setting),
    };
    let origin = |operand: &Operand| {
        let reports = |trial: &&TrialResult| trial.reports(&operand.metric);
        if results.imported.iter().any(|origin| origin.name == operand.agent) {
            NumberOrigin::Imported
        } else if trials_behind(scope, results, operand, setting)
            .iter()
            .any(reports)
        {
            NumberOrigin::Reported
        } else {
            NumberOrigin::Measured
        }
    };
    let min_effect = spec.min_effect.or_else(|| margin(claim, study, &found));
    let mut verdict = hold(claim, (spec, min_effect), &trials, &looks, &found, &origin);
    let trained = trained(&trials, results);
    if verdict.verdict.is_judged() && !floors::are_passed(claim, study, &trained, &found) {
        verdict = ClaimVerdict {
            verdict: ClaimOutcome::NotLearned,
            statement: None,
            notes: vec![floors::in_words(&study.floors)],
            ..verdict
        };
    }
    let notes = std::mem::take(&mut verdict.notes);
    let named = |name: &str| {
        let is_there = trials.iter().any(|it| it.trial.cell.agent == name);
        is_there.then(|| name.to_owned())
    };
    verdict.notes = with_agents(notes, results, Programs::OnlyLacking, named);
    verdict.notes.extend(lacking(claim, scope, setting));
    JudgedClaim {
        verdict,
        min_effect,
        trials,
        looks,
    }
}

/// The difference that matters by the rule of the study, in the metric and the place of a claim's first operand.
fn margin(
    claim: &Claim,
    study: &StudyInfo,
    values: &dyn Fn(&Operand, u64) -> Option<Vec<(u64, f64)>>,
) -> Option<f64> {
    let relevance = study
        .relevance
        .as_ref()
        .filter(|_| claim.relation.is_direction())?;
    let first = *claim.operands().first()?;
    let of_agent = |agent: &str| {
        let operand = Operand {
            agent: agent.into(),
            setting: Vec::new(),
            ..first.clone()
        };
        let values = values(&operand, u64::MAX)?;
        Some(values.into_iter().map(|(_, value)| value).collect())
    };
    relevance.margin(&of_agent)
}

/// The verdict on a claim. It is NOT TRAINED if an agent behind it made no update, and CALIBRATED if it agrees with a
/// choice that was made with the claim in view.
fn hold(
    claim: &Claim,
    (spec, min_effect): (&ClaimSpec, Option<f64>),
    trials: &[&TrialResult],
    looks: &Seeds,
    values: &dyn Fn(&Operand, u64) -> Option<Vec<(u64, f64)>>,
    origin: &dyn Fn(&Operand) -> NumberOrigin,
) -> ClaimVerdict {
    let verdict = evaluate(claim, min_effect, values, origin, looks);
    let untrained: BTreeSet<&str> = trials
        .iter()
        .filter(|trial| trial.updates() == Some(0.0))
        .map(|trial| trial.trial.cell.agent.as_str())
        .collect();
    if !untrained.is_empty() {
        let notes = vec![untrained_in_words(untrained.into_iter())];
        return ClaimVerdict {
            verdict: ClaimOutcome::NotTrained,
            permutation: None,
            statement: None,
            notes,
            ..verdict
        };
    }
    let agrees = [ClaimOutcome::Supported, ClaimOutcome::DirectionOnly].contains(&verdict.verdict);
    if spec.calibrated_on.is_some() && agrees {
        return ClaimVerdict {
            verdict: ClaimOutcome::Calibrated,
            statement: None,
            ..verdict
        };
    }
    verdict
}

/// The trials of an operand, including those that have not run.
fn trials_behind<'r>(
    scope: &Scope<'r>,
    results: &'r Results,
    operand: &Operand,
    setting: Option<&str>,
) -> Vec<&'r TrialResult> {
    match &operand.within {
        Some(within) => Encounters::of(results, &within.play).trials(&[(&within.role, &operand.agent)]),
        None => of_setting(scope, operand, setting).trials,
    }
}

/// Values by seed below a limit of an agent in a role of a play: the mean over its trained opponents, with seeds
/// below the limit, too. `None` for operands outside plays.
fn in_play(results: &Results, operand: &Operand, limit: u64) -> Option<Vec<(u64, f64)>> {
    let within = operand
        .within
        .as_ref()
        .filter(|_| operand.aggregate == Aggregate::Final)?;
    let encounters = Encounters::of(results, &within.play).until(limit);
    let values = encounters.by_seed(&[(&within.role, &operand.agent)], &operand.metric);
    Some(values.into_iter().collect())
}

/// Values by seed of an operand, in one setting where its agent has several; `None` where there is none.
fn values(scope: &Scope<'_>, operand: &Operand, setting: Option<&str>) -> Option<Vec<(u64, f64)>> {
    let scope = of_setting(scope, operand, setting);
    let value = |trial: &&TrialResult| {
        Some((
            trial.trial.key.seed,
            operand.aggregate.of_trial(trial, &operand.metric)?,
        ))
    };
    let values: Vec<(u64, f64)> = scope
        .trials
        .iter()
        .filter(|trial| trial.is_ok())
        .filter_map(value)
        .collect();
    (!values.is_empty()).then_some(values)
}
