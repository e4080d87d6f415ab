//! The report in Markdown.

use super::{Parts, files};
use crate::{
    build::tally,
    results::TrialResult,
    table::{escape_markdown as escape, markdown},
};

/// The whole report.
pub(super) fn report(parts: &Parts<'_>) -> String {
    let study = parts.study;
    let mut blocks = vec![format!("# {}", escape(title(parts))), format!("Study `{}`. {}", study.name, escape(&study.source))];
    blocks.extend(study.asked_with().map(|options| format!("**Computed {}.**", escape(&options))));
    blocks.extend(counts(parts));
    blocks.extend(section("Tables", tables(parts)));
    blocks.extend(section("Figures", figures(parts)));
    blocks.extend(section("Claims", claims(parts)));
    blocks.extend(section("Departures", study.departures.iter().map(|departure| format!("- {}", escape(departure))).collect()));
    blocks.extend(section("What was run", runs(parts)));
    blocks.extend(section(
        "Provenance",
        provenance(parts).into_iter().map(|(what, value)| format!("- {what}: {}", escape(&value))).collect(),
    ));
    blocks.join("\n\n") + "\n"
}

/// The title, or the name of a study without one.
pub(super) fn title<'a>(parts: &Parts<'a>) -> &'a str {
    if parts.study.title.is_empty() { &parts.study.name } else { &parts.study.title }
}

fn section(heading: &str, items: Vec<String>) -> Option<String> {
    let joint = if items.iter().all(|item| item.starts_with("- ")) { "\n" } else { "\n\n" };
    (!items.is_empty()).then(|| format!("## {heading}\n\n{}", items.join(joint)))
}

fn counts(parts: &Parts<'_>) -> Option<String> {
    let line = |what: &str, counts: &[(&str, usize)]| {
        let words: Vec<String> = counts.iter().filter(|(_, n)| *n > 0).map(|(word, n)| format!("**{n} {word}**")).collect();
        (!words.is_empty()).then(|| format!("{what}: {}", words.join(", ")))
    };
    let lines: Vec<String> = [line("Published values", &parts.contents.verdicts()), line("Claims", &parts.contents.outcomes())]
        .into_iter()
        .flatten()
        .collect();
    (!lines.is_empty()).then(|| lines.join("\n\n"))
}

fn tables(parts: &Parts<'_>) -> Vec<String> {
    let table = |(name, grid): &(String, Result<crate::table::Grid, String>)| match grid {
        Ok(grid) => format!("### {}\n\n{}", escape(name), markdown(grid).trim_end()),
        Err(reason) => format!("### {}\n\nCould not be made: {}", escape(name), escape(reason)),
    };
    parts.contents.tables.iter().map(table).collect()
}

fn figures(parts: &Parts<'_>) -> Vec<String> {
    let figure =
        |((name, chart), (_, spec)): (&(String, Result<crate::figure::Chart, String>), &(String, crate::figure::FigureSpec))| {
            let body = match chart {
                Ok(chart) => {
                    format!("![{}](figures/{})\n\n{}", escape(name), files::name(name, "svg"), escape(&chart.notes.join(" ")))
                }
                Err(reason) => format!("Could not be drawn: {}", escape(reason)),
            };
            format!("### {}\n\n{}\n\n{body}", escape(name), escape(&spec.caption))
        };
    parts.contents.figures.iter().zip(&parts.study.figures).map(figure).collect()
}

fn claims(parts: &Parts<'_>) -> Vec<String> {
    if parts.contents.claims.is_empty() {
        return Vec::new();
    }
    let mut lines = vec!["| claim | environment | verdict | difference | notes |".to_owned(), "|---|---|---|---|---|".into()];
    lines.extend(parts.contents.claims.iter().map(|line| {
        let cells = [&line.text, &line.place, line.word(), &line.numbers(), &line.notes().join("; ")].map(escape);
        format!("| {} |", cells.join(" | "))
    }));
    vec![lines.join("\n")]
}

fn runs(parts: &Parts<'_>) -> Vec<String> {
    let failed = parts.results.trials.iter().filter(|trial| trial.end.is_some() && !trial.is_ok());
    std::iter::once(format!("- {}", end_states(parts)))
        .chain(failed.map(|trial| format!("- {}", escape(&failure(trial)))))
        .collect()
}

/// How many trials ended in each way.
pub(super) fn end_states(parts: &Parts<'_>) -> String {
    let mut counts: std::collections::BTreeMap<_, usize> = std::collections::BTreeMap::new();
    for trial in &parts.results.trials {
        *counts.entry(trial.end.as_ref().map(|end| end.state)).or_default() += 1;
    }
    let not_run = counts.remove(&None);
    let ended = counts.into_iter().filter_map(|(state, n)| state.map(|state| format!("{n} {}", state.name())));
    let words: Vec<String> = ended.chain(not_run.map(|n| format!("{n} not run"))).collect();
    format!("{} trials: {}", parts.results.trials.len(), words.join(", "))
}

/// A failed trial in one line.
pub(super) fn failure(trial: &TrialResult) -> String {
    let (key, end) = (&trial.trial, trial.end.as_ref());
    let setting = if key.setting.is_empty() { String::new() } else { format!(", {}", key.setting) };
    let state = end.map_or("", |end| end.state.name());
    let reason = end.map_or("", |end| &end.reason);
    format!("{}, {}{setting}, seed {}: {state}: {reason}", key.environment, key.agent, key.key.seed)
}

/// What made the results, by name.
pub(super) fn provenance(parts: &Parts<'_>) -> Vec<(&'static str, String)> {
    let provenance = parts.provenance;
    let commit = provenance
        .commit
        .as_ref()
        .map(|commit| format!("{commit}{}", if provenance.dirty { ", with changed files" } else { "" }));
    let plugins: Vec<String> = provenance.plugins.iter().map(|(name, version)| format!("{name} {version}")).collect();
    let seeds: Vec<String> = provenance.seeds.iter().map(ToString::to_string).collect();
    let entries = [
        ("program", Some(provenance.program.clone())),
        ("source code", commit),
        ("computed by", Some(tally(&provenance.builds))),
        ("plugin versions", Some(plugins.join(", "))),
        ("profile", provenance.profile.clone()),
        ("seeds", Some(seeds.join(", "))),
        ("processor", Some(provenance.cpu.clone())),
        ("operating system", Some(provenance.operating_system.clone())),
        ("date", provenance.date.clone()),
    ];
    entries.into_iter().filter_map(|(what, value)| Some((what, value.filter(|value| !value.is_empty())?))).collect()
}
