//! Settings in which claims are evaluated one by one. Settings are never pooled.
//!
//! Each side keeps its own swept keys, and the sides of a claim meet where the keys that both have are equal: a learner
//! with two swept keys meets a rule with one of them at the values of that one.

use analysis::claim::{Claim, Operand};
use contract::{sweep_point::split_words, trial_result::TrialResult};
use document::count::count;
use presentation::table::{Axis, Scope};

/// The settings of a claim in a scope, each in words: those of its agents with several, joined where they agree. A
/// setting that another agent does not have is a setting, too, since its claim has no seeds.
pub(super) fn settings(claim: &Claim, scope: &Scope<'_>) -> Vec<Option<String>> {
    let mut joined: Vec<String> = Vec::new();
    for operand in claim.operands() {
        let own = own_settings(scope, operand);
        if own.len() > 1 {
            joined = join(&joined, &own);
        }
    }
    match joined.len() {
        0 => vec![None],
        _ => joined.into_iter().map(Some).collect(),
    }
}

/// The trials of an operand's agent, in one setting where the claim has several.
pub(super) fn of_setting<'r>(scope: &Scope<'r>, operand: &Operand, setting: Option<&str>) -> Scope<'r> {
    let mut scope = told_apart(scope, operand);
    if let Some(setting) = setting {
        scope
            .trials
            .retain(|trial| agree(&words(trial, operand), setting));
    }
    scope
}

/// A note for each agent of a claim whose trials failed, or that has none planned in the setting.
pub(super) fn lacking(claim: &Claim, scope: &Scope<'_>, setting: Option<&str>) -> Vec<String> {
    let mut notes: Vec<String> = Vec::new();
    for operand in claim.operands().into_iter().filter(|it| it.within.is_none()) {
        let (agent, trials) = (&operand.agent, of_setting(scope, operand, setting));
        let note = match (trials.failed(), trials.trials.len()) {
            (0, 0) => format!("no trial of `{agent}` is planned here"),
            (0, _) => continue,
            (failed, all) => format!("{failed} of {} of `{agent}` failed", count(all, "trial")),
        };
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
    notes
}

/// The settings of an operand's agent, without the keys whose values the claim names.
fn own_settings(scope: &Scope<'_>, operand: &Operand) -> Vec<String> {
    let mut own: Vec<String> = Vec::new();
    for trial in told_apart(scope, operand).trials {
        let words = words(trial, operand);
        if !own.contains(&words) {
            own.push(words);
        }
    }
    own
}

/// The trials of an operand's agent that have the values of swept keys that the claim names.
fn told_apart<'r>(scope: &Scope<'r>, operand: &Operand) -> Scope<'r> {
    let mut scope = scope.at(Axis::Agent, &operand.agent);
    if let Some(environment) = &operand.environment {
        scope = scope.at(Axis::Environment, environment);
    }
    scope
        .trials
        .retain(|trial| operand.is_at(&trial.trial.cell.point));
    scope
}

/// The swept keys and values of a trial that the claim does not name, in words.
fn words(trial: &TrialResult, operand: &Operand) -> String {
    let named: Vec<&str> = operand.setting.iter().map(|(key, _)| key.as_str()).collect();
    trial.trial.cell.point.without(&named).words().to_owned()
}

/// All pairs of settings that agree, as one setting each, and settings without a partner.
fn join(joined: &[String], own: &[String]) -> Vec<String> {
    let mut pairs: Vec<String> = Vec::new();
    for setting in joined {
        let partners = own.iter().filter(|own| agree(own, setting));
        let before = pairs.len();
        pairs.extend(partners.map(|own| union(setting, own)));
        if pairs.len() == before {
            pairs.push(setting.clone());
        }
    }
    let is_alone = |own: &&String| !joined.iter().any(|setting| agree(own, setting));
    pairs.extend(own.iter().filter(is_alone).cloned());
    pairs
}

/// Whether two settings have the same values of the keys that both have.
fn agree(one: &str, other: &str) -> bool {
    let same_key = |(key, _): &(&str, &str)| {
        let key = *key;
        entries(other).find(|(other, _)| *other == key)
    };
    entries(one).all(|entry| same_key(&entry).is_none_or(|(_, value)| value == entry.1))
}

/// The words of one setting, and those of another one with further keys.
fn union(one: &str, other: &str) -> String {
    let is_new = |word: &&str| !split_words(one).any(|known| known == *word);
    let words = split_words(one).chain(split_words(other).filter(is_new));
    words.collect::<Vec<_>>().join(" ")
}

/// The keys of a setting in words, with their values.
fn entries(setting: &str) -> impl Iterator<Item = (&str, &str)> {
    split_words(setting).filter_map(|word| word.split_once('='))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(one: &[&str], other: &[&str]) -> Vec<String> {
        let [one, other] = [one, other].map(|list| list.iter().map(ToString::to_string).collect::<Vec<_>>());
        join(&one, &other)
    }

    #[test]
    fn settings_meet_where_the_keys_of_both_are_equal() {
        let learner = [
            "ohm=0.1 cells=4",
            "ohm=0.1 cells=8",
            "ohm=0.2 cells=4",
            "ohm=0.2 cells=8",
        ];
        assert_eq!(joined(&learner, &["cells=4", "cells=8"]), learner);
        assert_eq!(
            joined(&["cells=4", "cells=8"], &["cells=4", "cells=8"]),
            ["cells=4", "cells=8"]
        );
        assert_eq!(
            joined(&["cells=4", "cells=8"], &learner[..3]),
            ["cells=4 ohm=0.1", "cells=4 ohm=0.2", "cells=8 ohm=0.1"]
        );
    }

    #[test]
    fn keys_of_one_side_alone_meet_every_setting_of_the_other() {
        assert_eq!(
            joined(&["rate=1", "rate=2"], &["depth=3", "depth=4"]),
            [
                "rate=1 depth=3",
                "rate=1 depth=4",
                "rate=2 depth=3",
                "rate=2 depth=4"
            ]
        );
    }

    #[test]
    fn settings_without_a_partner_stay() {
        assert_eq!(
            joined(&["cells=4", "cells=8"], &["cells=4", "cells=2"]),
            ["cells=4", "cells=8", "cells=2"]
        );
        assert_eq!(
            joined(&[], &["kind=\"a b\"", "kind=c"]),
            ["kind=\"a b\"", "kind=c"]
        );
    }
}
