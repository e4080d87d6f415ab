//! Results of searches for settings, as text.

use crate::{
    results::{SearchResult, Sight, TriedSetting},
    search::schedule_in_words,
};
use document::count::{count, either};
use std::collections::BTreeSet;

/// Largest number of settings without a value that are named; further ones are only counted.
const MOST_NAMED: usize = 4;

/// The number of tried settings, the best one, the metric, and the settings without a value.
#[must_use]
pub fn search_in_words(it: &SearchResult) -> String {
    let search = &it.search;
    let best = it.best().map(|place| &it.tried[place]);
    let best = best.map_or_else(
        || "none has ended well".to_owned(),
        |tried| {
            let value = tried.value().unwrap_or(f64::NAN);
            format!(
                "the best is {} with a {} of {value:.4}",
                tried.setting,
                search.metric.replace('_', " ")
            )
        },
    );
    let seeds = match search.seeds.len() {
        1 => "one seed".to_owned(),
        n => count(n, "seed"),
    };
    format!(
        "search {} of {}: {}, in {} by {seeds} of its own; {best}{}{}",
        search.name,
        search.agent,
        state(it),
        search.environment,
        last_in_words(it),
        failed_in_words(it),
    )
}

/// Progress of the search, as text.
fn state(it: &SearchResult) -> String {
    // Results of a setting beyond its pause do not count.
    let early = it.tried.iter().filter(|tried| tried.stop.is_some()).count();
    let early = if early > 0 {
        format!(", of which {early} were looked at up to a pause alone")
    } else {
        String::new()
    };
    match it.chosen {
        _ if it.search.is_population() => population_in_words(it),
        Some(_) => format!("its setting was chosen among {}{early}", different_of(it)),
        None if it.found_nothing() => "no setting can be chosen".to_owned(),
        None => {
            let seen = it.seen_so(Sight::Valued).len() + it.seen_so(Sight::Last).len();
            format!("{seen} of {} settings were tried", it.search.settings)
        }
    }
}

/// The number of tried settings, and of the different ones among them.
fn different_of(it: &SearchResult) -> String {
    let n = it.tried.len();
    let different: BTreeSet<&str> = it.tried.iter().map(|tried| tried.setting.as_str()).collect();
    if different.len() < n {
        format!("{n} ({} different)", different.len())
    } else {
        n.to_string()
    }
}

/// Progress of a population, as text.
fn population_in_words(it: &SearchResult) -> String {
    let (members, generations) = (it.search.settings, it.search.generation_ends().len() + 1);
    let members = count(members, "member");
    match it.chosen {
        Some(_) => format!("its schedule is that of the best of {members} after {generations} generations"),
        None if it.found_nothing() => "no schedule can be chosen".to_owned(),
        None => {
            let number = it.tried.len().div_ceil(it.search.settings).max(1);
            format!("{members} learn in generation {number} of {generations}")
        }
    }
}

/// The settings that rank last because some of their trials ended unsuccessfully; empty if there are none.
fn last_in_words(it: &SearchResult) -> String {
    let last = it.seen_so(Sight::Last);
    if last.is_empty() {
        return String::new();
    }
    let (settings, are) = (count(last.len(), "setting"), either(&last.len(), "ranks", "rank"));
    format!("; {settings} {are} last without a value: {}", named(&last))
}

/// The settings for which the search waits because some of their trials failed; empty if it waits for none.
fn failed_in_words(it: &SearchResult) -> String {
    let failed = it.seen_so(Sight::Failed);
    if failed.is_empty() {
        return String::new();
    }
    let settings = count(failed.len(), "setting");
    format!(
        "; it waits for {settings} whose trials failed: {}",
        named(&failed)
    )
}

/// Settings, each with the states in which its trials ended.
fn named(settings: &[&TriedSetting]) -> String {
    let one = |tried: &&TriedSetting| {
        let states: Vec<&str> = tried.failures.iter().map(|state| state.name()).collect();
        format!("{} ({})", tried.setting, states.join(", "))
    };
    let mut words: Vec<String> = settings.iter().take(MOST_NAMED).map(one).collect();
    if settings.len() > MOST_NAMED {
        words.push(format!("and {} more", settings.len() - MOST_NAMED));
    }
    words.join(", ")
}

/// Sentence of a report on a search: that of [`search_in_words`], and the seeds on which the chosen setting is
/// measured.
#[must_use]
pub fn sentence(it: &SearchResult) -> String {
    let words = search_in_words(it);
    let schedule = it.schedule();
    let schedule = if schedule.is_empty() {
        String::new()
    } else {
        let words = schedule_in_words(&schedule, it.search.generation_ends());
        format!(". The schedule: {words}")
    };
    let rest = match it.chosen {
        Some(_) => format!(
            "{schedule}. What is shown of {} is measured on other seeds than these.",
            it.search.agent
        ),
        None => format!(". Nothing of {} is shown before.", it.search.agent),
    };
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect::<String>() + &rest
    })
}
