//! What a search for a setting came to, in words.

use crate::count::count;
use crate::results::SearchResult;
use crate::search::schedule_in_words;
use std::collections::BTreeSet;

/// How many settings were tried, which one is the best, and on what it was compared.
#[must_use]
pub fn search_in_words(it: &SearchResult) -> String {
    let (search, n) = (&it.search, it.tried.len());
    let ended = it.tried.iter().filter(|tried| tried.missing == 0).count();
    let best = it.best().map(|place| &it.tried[place]);
    let best = best.map_or_else(
        || "none has ended well".to_owned(),
        |tried| {
            let value = tried.value().unwrap_or(f64::NAN);
            format!(
                "the best is {} with a {} of {value:.4}",
                tried.setting,
                search.by.replace('_', " ")
            )
        },
    );
    let seeds = match search.seeds.len() {
        1 => "one seed".to_owned(),
        n => count(n, "seed"),
    };
    let early = it.tried.iter().filter(|tried| tried.stop.is_some()).count();
    let early = if early > 0 && it.chosen.is_some() {
        format!(", of which {early} were stopped early")
    } else {
        String::new()
    };
    let different: BTreeSet<&str> = it.tried.iter().map(|tried| tried.setting.as_str()).collect();
    let among = if different.len() < n {
        format!("{n} ({} different)", different.len())
    } else {
        n.to_string()
    };
    let state = match it.chosen {
        _ if search.is_population() => population_in_words(it),
        Some(_) => format!("its setting was chosen among {among}{early}"),
        None if ended == search.settings => "no setting can be chosen".to_owned(),
        None => format!("{ended} of {} settings were tried", search.settings),
    };
    format!(
        "search {} of {}: {state}, in {} by {seeds} of its own; {best}",
        search.name, search.agent, search.environment
    )
}

/// How far a population is.
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

/// What a report says of a search: the same, and on what the chosen setting is measured.
#[must_use]
pub(super) fn sentence(it: &SearchResult) -> String {
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
