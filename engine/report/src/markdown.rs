//! The report in Markdown.

use super::{Parts, Period, StudyInfo, answers, files, head, legend, sheet::Sheet, stages};
use analysis::results::Origin;
use contract::build::tally;
use presentation::{
    figure::{Chart, FigureSpec},
    table::{Grid, escape_markdown as escape, markdown, prose},
};

/// The whole report.
pub(super) fn report(parts: &Parts<'_>) -> String {
    let sections = sections(parts).into_iter();
    let sections = sections.filter_map(|(heading, items)| section(heading, &items));
    let blocks: Vec<String> = head_blocks(parts).into_iter().chain(sections).collect();
    blocks.join("\n\n") + "\n"
}

/// Everything above the first section.
fn head_blocks(parts: &Parts<'_>) -> Vec<String> {
    let study = parts.study;
    let strong = |text: String| format!("**{text}**");
    let mut blocks = vec![
        format!("# {}", escape(title(parts))),
        format!("Study `{}`. {}", study.name, prose::markdown(&study.source)),
    ];
    blocks.extend(study.asked_with().map(|options| strong(escape(&options))));
    blocks.extend(study.rehearsal().map(|banner| strong(prose::markdown(banner))));
    let outdated = study.outdated();
    blocks.extend(outdated.iter().map(|sentence| strong(escape(sentence))));
    blocks.extend(parts.sentence.as_deref().map(prose::markdown));
    blocks.extend(parts.answered.as_ref().map(Sheet::markdown));
    blocks.extend(parts.answers.as_ref().map(Sheet::markdown));
    blocks.extend(first_deviations(study));
    blocks.push(prose::markdown(&parts.basis));
    blocks.extend(parts.head.iter().map(counts));
    blocks
}

/// The sections in their order, each with its items; the report leaves out empty ones.
fn sections(parts: &Parts<'_>) -> [(&'static str, Vec<String>); 13] {
    let study = parts.study;
    let item = |name: &str, text: &str| format!("- {name}: {text}");
    let meanings = legend::entries(parts.contents).into_iter();
    let deviations = study.deviations.iter();
    let profiles = study.profiles.iter();
    let provenance = provenance(parts).into_iter();
    [
        ("Tables", tables(parts)),
        ("Figures", figures(parts)),
        ("Claims", parts.claims.iter().map(Sheet::markdown).collect()),
        (
            "Confirmations",
            parts.confirmed.iter().map(Sheet::markdown).collect(),
        ),
        (
            "Meaning of the verdicts",
            meanings
                .map(|(word, meaning)| item(&format!("**{word}**"), meaning))
                .collect(),
        ),
        (
            "Deviations",
            deviations
                .map(|it| format!("- {}", prose::markdown(it)))
                .collect(),
        ),
        (
            "Stages",
            stages::sheet(&study.stages).iter().map(Sheet::markdown).collect(),
        ),
        ("Budgets", parts.budgets.iter().map(Sheet::markdown).collect()),
        ("Settings that differ", settings(parts)),
        ("Values by seed", by_seed(parts)),
        ("What was run", runs(parts)),
        (
            "Profiles",
            profiles
                .map(|it| item(&escape(it.name()), &it.sentence()))
                .collect(),
        ),
        (
            "Provenance",
            provenance
                .map(|(what, value)| item(what, &escape(&value)))
                .collect(),
        ),
    ]
}

/// The most important deviations, where the section has more.
fn first_deviations(study: &StudyInfo) -> Vec<String> {
    let first = study.deviations.iter().take(answers::FIRST_DEVIATIONS);
    let lines: Vec<String> = first.map(|it| format!("- {}", prose::markdown(it))).collect();
    match study.deviations.len() {
        n if n <= answers::FIRST_DEVIATIONS => Vec::new(),
        n => vec![
            format!(
                "Deviations from the source, the first {} of {n}:",
                answers::FIRST_DEVIATIONS
            ),
            lines.join("\n"),
        ],
    }
}

/// The title of the study; its name where it has no title.
pub(super) fn title<'a>(parts: &Parts<'a>) -> &'a str {
    if parts.study.title.is_empty() {
        &parts.study.name
    } else {
        &parts.study.title
    }
}

fn section(heading: &str, items: &[String]) -> Option<String> {
    let joint = if items.iter().all(|item| item.starts_with("- ")) {
        "\n"
    } else {
        "\n\n"
    };
    (!items.is_empty()).then(|| format!("## {heading}\n\n{}", items.join(joint)))
}

fn counts(counts: &head::CountLine) -> String {
    let words: Vec<String> = counts
        .words
        .iter()
        .map(|(word, n)| format!("**{n} {word}**"))
        .collect();
    format!("{}: {}", counts.what, words.join(", "))
}

fn tables(parts: &Parts<'_>) -> Vec<String> {
    let table = |(name, grid): &(String, Result<Grid, String>)| match grid {
        Ok(grid) => format!("### {}\n\n{}", escape(name), markdown(grid).trim_end()),
        Err(reason) => format!(
            "### {}\n\nCould not be made: {}",
            escape(name),
            prose::markdown(reason)
        ),
    };
    parts.contents.tables.iter().map(table).collect()
}

fn figures(parts: &Parts<'_>) -> Vec<String> {
    let figure = |((name, chart), (_, spec)): (&(String, Result<Chart, String>), &(String, FigureSpec))| {
        let drawn = |words: &str, notes: &[String]| {
            format!(
                "![{}](figures/{})\n\n{}",
                escape(words),
                files::name(name, "svg"),
                prose::markdown(&notes.join(" "))
            )
        };
        let body = match (chart, parts.contents.kept.get(name)) {
            (Ok(chart), _) => drawn(&chart.in_words(), &chart.notes),
            (Err(_), Some(kept)) => drawn(&kept.facts.words, &kept.facts.notes),
            (Err(reason), None) => format!("Could not be drawn: {}", prose::markdown(reason)),
        };
        let caption = if spec.caption.is_empty() {
            String::new()
        } else {
            format!("{}\n\n", prose::markdown(&spec.caption))
        };
        format!("### {}\n\n{caption}{body}", escape(name))
    };
    parts
        .contents
        .figures
        .iter()
        .zip(&parts.study.figures)
        .map(figure)
        .collect()
}

fn settings(parts: &Parts<'_>) -> Vec<String> {
    let text = if parts.settings.is_empty() {
        NO_SETTINGS
    } else {
        SETTINGS
    };
    let text = format!("{text} The complete configs are in [resolved.yaml](resolved.yaml).");
    std::iter::once(text)
        .chain(parts.settings.iter().map(Sheet::markdown))
        .collect()
}

/// Text above the settings that differ.
pub(super) const SETTINGS: &str =
    "Keys that differ between agents, settings or environments, or from the default of their plugin.";
/// Text for a study with default settings alone.
pub(super) const NO_SETTINGS: &str = "None: every plugin has its defaults.";

fn by_seed(parts: &Parts<'_>) -> Vec<String> {
    let made = parts.contents.tables.iter().filter(|(_, grid)| grid.is_ok());
    made.map(|(name, _)| {
        format!(
            "- {}: [{1}]({1})",
            escape(name),
            format_args!("tables/{}", files::by_seed(name))
        )
    })
    .collect()
}

fn runs(parts: &Parts<'_>) -> Vec<String> {
    let failures = parts.ran.failures.iter().map(|failure| escape(failure));
    std::iter::once(parts.ran.sentence())
        .chain(failures)
        .map(|line| format!("- {line}"))
        .collect()
}

/// The imported runs, with their files and the hash of each.
fn imported(parts: &Parts<'_>) -> String {
    let entry = |origin: &Origin| {
        let files: Vec<String> = origin
            .files
            .iter()
            .map(|(file, sha256)| format!("{file} (SHA-256 {sha256})"))
            .collect();
        format!("{} {}: {}", origin.sentence, origin.name, files.join(", "))
    };
    parts
        .results
        .imported
        .iter()
        .map(entry)
        .collect::<Vec<_>>()
        .join("; ")
}

/// Programs, plugins and machine behind the results, by name.
pub(super) fn provenance(parts: &Parts<'_>) -> Vec<(&'static str, String)> {
    let provenance = parts.provenance;
    let plugins: Vec<String> = provenance
        .plugins
        .iter()
        .map(|(name, version)| format!("{name} {version}"))
        .collect();
    let seeds: Vec<String> = provenance.seeds.iter().map(ToString::to_string).collect();
    let entries = [
        ("program", Some(provenance.program.clone())),
        ("source code", provenance.build.as_ref().map(ToString::to_string)),
        ("computed by", Some(tally(&provenance.builds))),
        ("plugin versions", Some(plugins.join(", "))),
        ("profile", provenance.profile.clone()),
        ("seeds", Some(seeds.join(", "))),
        ("imported", Some(imported(parts))),
        ("trials ended", parts.study.ended.as_ref().map(Period::sentence)),
        ("processor", Some(provenance.cpu.clone())),
        ("operating system", Some(provenance.operating_system.clone())),
        ("date", provenance.date.clone()),
    ];
    entries
        .into_iter()
        .filter_map(|(what, value)| Some((what, value.filter(|value| !value.is_empty())?)))
        .collect()
}
