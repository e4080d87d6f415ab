//! One page over many studies: the outcome of each, its verdicts, its figures at small size, and its cost. It contains
//! only facts from the files that reports wrote into their folders.

use super::{
    Verdicts, answered, families, open,
    page::{Extra, counted, document},
    passed::words,
    sheet::{NONE, Sheet, SheetEntry},
};
use document::count::duration;
use maud::{Markup, html};
use presentation::table::prose;

const STYLE: &str = include_str!("index.css");

/// A study in the index.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct IndexEntry {
    /// Folder of results, relative to the index.
    pub folder: String,
    /// Verdicts of its report.
    pub verdicts: Verdicts,
    /// Paths of its drawings, relative to its folder, as `figures/voltages.svg`.
    pub drawings: Vec<String>,
}

const TITLE: &str = "Results of all studies";

/// The page. `options` are the options of the command line that all the studies share; `unread` are folders without
/// readable verdicts.
#[must_use]
pub fn index(entries: &[IndexEntry], options: &[String], unread: &[String]) -> String {
    let body = html! {
        (header(entries, options, unread))
        (answers(entries))
        (by_family(entries))
        @for entry in entries { (study(entry)) }
        (still_open(entries))
        section #cost {
            h2 { "Cost by study" }
            (cost(entries).html())
        }
    };
    let extra = Extra {
        style: STYLE.into(),
        ..Extra::default()
    };
    document(TITLE, &body, &extra)
}

fn header(entries: &[IndexEntry], options: &[String], unread: &[String]) -> Markup {
    let all = entries.iter().flat_map(|entry| &entry.verdicts.verdicts);
    let times = entries.iter().filter_map(|entry| entry.verdicts.trial_time_s);
    let trials: usize = entries.iter().filter_map(|entry| entry.verdicts.trials).sum();
    html! {
        header {
            h1 { (TITLE) }
            @if !options.is_empty() { p { strong { "Computed with " (options.join(", ")) "." } } }
            p {
                "Verdicts are those of a family of studies, or of one study, taken together (Holm). Values and claims \
                 that are exploratory are counted apart."
            }
            @if !unread.is_empty() {
                p { "Not shown, because their reports are older than this page: " (unread.join(", ")) "." }
            }
            div.summary {
                div { h2 { "Studies" } p { (entries.len()) } }
                (counts(all))
                div { h2 { "Time" } p { (duration(times.sum())) " in " (trials) " trials" } }
            }
        }
    }
}

fn study(entry: &IndexEntry) -> Markup {
    let it = &entry.verdicts;
    let heading = if it.title.is_empty() { &it.study } else { &it.title };
    let counts = counts(it.verdicts.iter());
    html! {
        section.study id=(entry.folder) {
            h2 { a href=(page(entry)) { (heading) } }
            p.source { code { (it.study) } " · " (took(it)) }
            @if let Some(sentence) = &it.summary { p { (prose::html(sentence)) } }
            p.quiet { (prose::html(&it.basis)) }
            @if !counts.0.is_empty() { div.summary { (counts) } }
            (drawings(entry))
        }
    }
}

/// Path of the page of a study, relative to the index.
fn page(entry: &IndexEntry) -> String {
    format!("{}/index.html", entry.folder)
}

/// The answers by family; empty where no study has one.
fn answers(entries: &[IndexEntry]) -> Markup {
    let studies = entries.iter().map(|entry| (page(entry), &entry.verdicts));
    let studies: Vec<(String, &Verdicts)> = studies.collect();
    html! {
        @for (family, sheet) in answered::sheets(&studies) {
            section {
                h2 { @if family.is_empty() { "Answers" } @else { (family) } }
                (sheet.html())
            }
        }
    }
}

/// The counts by family; empty without families.
fn by_family(entries: &[IndexEntry]) -> Markup {
    let studies: Vec<Verdicts> = entries.iter().map(|entry| entry.verdicts.clone()).collect();
    html! {
        @if let Some(sheet) = families::sheet(&families::families(&studies)) {
            section #families {
                h2 { "Counts by family" }
                (sheet.html())
            }
        }
    }
}

/// Open verdicts of all studies; empty where there is none.
fn still_open(entries: &[IndexEntry]) -> Markup {
    let studies = || entries.iter().map(|entry| &entry.verdicts);
    html! {
        @if let Some(sheet) = open::sheet(&open::still_open(studies())) {
            section #open {
                h2 { "What is open" }
                p { (open::Decided::of(studies()).in_words()) }
                (sheet.html())
            }
        }
    }
}

fn took(verdicts: &Verdicts) -> String {
    match (verdicts.trial_time_s, verdicts.trials) {
        (Some(time), Some(trials)) => format!("{} in {trials} trials", duration(time)),
        _ => "time not noted".into(),
    }
}

/// Lines of counted words: published values, claims, and exploratory ones; lines without counts are left out.
fn counts<'a>(passed: impl Iterator<Item = &'a super::Passed> + Clone) -> Markup {
    let is_claim = |it: &super::Passed| it.about.starts_with("claim ");
    let groups: [(&str, &dyn Fn(&super::Passed) -> bool); 3] = [
        ("Published values", &|it| !it.exploratory && !is_claim(it)),
        ("Claims", &|it| !it.exploratory && is_claim(it)),
        ("Exploratory", &|it| it.exploratory),
    ];
    let groups = groups.map(|(what, belongs)| {
        let number = |word| {
            let having = passed.clone().filter(|it| belongs(it) && it.in_all() == word);
            (word, having.count())
        };
        let mut words: Vec<(&str, usize)> = words().into_iter().map(number).collect();
        words.retain(|(_, number)| *number > 0);
        (what, words)
    });
    html! {
        @for (what, words) in groups {
            @if !words.is_empty() { (counted(what, &words)) }
        }
    }
}

/// The figures at small size, each linked to its place on the study's page; empty without figures.
fn drawings(entry: &IndexEntry) -> Markup {
    html! {
        @if !entry.drawings.is_empty() {
            div.drawings {
                @for path in &entry.drawings {
                    @let name = path.rsplit('/').next().unwrap_or(path).trim_end_matches(".svg");
                    a href={ (page(entry)) "#" (name) } {
                        img loading="lazy" src={ (entry.folder) "/" (path) }
                            alt={ "Figure " (name) "; described on the page of the study" };
                    }
                }
            }
        }
    }
}

fn cost(entries: &[IndexEntry]) -> Sheet {
    let head = ["study", "trials", "time", "judged", "decided", "differing"];
    let row = |entry: &IndexEntry| {
        let it = &entry.verdicts;
        let time = it.trial_time_s.map_or(NONE.into(), duration);
        let trials = it.trials.map_or(NONE.into(), |trials| trials.to_string());
        let counts = [it.judged, it.decided, it.differing].map(|count| count.to_string());
        [entry.folder.clone(), trials, time]
            .into_iter()
            .chain(counts)
            .map(SheetEntry::plain)
            .collect()
    };
    let mut rows: Vec<&IndexEntry> = entries.iter().collect();
    let time = |entry: &IndexEntry| entry.verdicts.trial_time_s.unwrap_or(-1.0);
    rows.sort_by(|one, other| {
        time(other)
            .total_cmp(&time(one))
            .then(one.folder.cmp(&other.folder))
    });
    Sheet {
        head: head.map(String::from).into(),
        words: 1,
        rows: rows.into_iter().map(row).collect(),
        notes: vec![
            "Times are wall-clock times of trials, each on one core. A trial that several studies share is counted \
             in each of them."
                .into(),
        ],
        ..Sheet::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Effort, Passed};

    fn passed(about: &str, verdict: &str, together: Option<&str>) -> Passed {
        Passed {
            about: about.into(),
            verdict: verdict.into(),
            together: together.map(Into::into),
            ..Passed::default()
        }
    }

    fn entry() -> IndexEntry {
        let verdicts = vec![
            passed("t: a", "REPRODUCED", Some("INCONCLUSIVE")),
            passed("t: b", "DIFFERS", None),
            passed("claim 1: a.x > b.x", "SUPPORTED", None),
            Passed {
                would_decide: Some(Effort {
                    seeds: 40,
                    trial_time_s: 61.0,
                }),
                ..passed("claim 2: a.x > c.x", "INCONCLUSIVE", None)
            },
        ];
        IndexEntry {
            folder: "small".into(),
            verdicts: Verdicts {
                study: "small".into(),
                title: "Cells <two>".into(),
                summary: Some("A `rule` lives 3 h.".into()),
                basis: "3 seeds.".into(),
                trials: Some(7),
                trial_time_s: Some(12.4),
                judged: 4,
                decided: 3,
                verdicts,
                ..Verdicts::default()
            },
            drawings: vec!["figures/voltages.svg".into()],
        }
    }

    #[test]
    fn a_study_is_shown_with_its_sentence_verdicts_figures_and_cost() {
        let page = index(&[entry()], &[], &[]);
        for part in [
            "<h2><a href=\"small/index.html\">Cells &lt;two&gt;</a></h2>",
            "<p>A <code>rule</code> lives 3 h.</p>",
            "<h2>Published values</h2><ul><li><b>1</b> <span class=\"word differs\">DIFFERS</span></li><li><b>1</b> \
             <span class=\"word inconclusive\">INCONCLUSIVE</span></li></ul>",
            "<h2>Claims</h2><ul><li><b>1</b> <span class=\"word inconclusive\">INCONCLUSIVE</span></li><li><b>1</b> <span \
             class=\"word supported\">",
            "<a href=\"small/index.html#voltages\"><img loading=\"lazy\" src=\"small/figures/voltages.svg\"",
            "<code>small</code> · 12 s in 7 trials",
            "<h2>What is open</h2><p>2 of 4 values and claims that are judged are decided (50 %).</p>",
            "<code>claim 2: a.x &gt; c.x</code></td><td class=\"value\">40</td><td class=\"value\">61 s</td>",
        ] {
            assert!(page.contains(part), "{part}\n{page}");
        }
        assert!(
            !page.contains("Exploratory") && !page.contains("Computed with") && !page.contains("Not shown")
        );
    }

    #[test]
    fn the_dearest_study_stands_first_in_the_costs_and_one_without_a_time_last() {
        let named = |folder: &str, trial_time_s| IndexEntry {
            folder: folder.into(),
            verdicts: Verdicts {
                trial_time_s,
                ..Verdicts::default()
            },
            drawings: Vec::new(),
        };
        let entries = [
            named("none", None),
            named("less", Some(3.0)),
            named("more", Some(9000.0)),
        ];
        let names: Vec<String> = cost(&entries)
            .rows
            .iter()
            .map(|row| row[0].text.clone())
            .collect();
        assert_eq!(names, ["more", "less", "none"]);
        let page = index(&entries, &["--seeds 2".into()], &["old".into()]);
        assert!(page.contains("Computed with --seeds 2.") && page.contains("older than this page: old."));
        assert!(page.contains("<p>2.5 h in 0 trials</p>") && page.contains("time not noted"));
    }
}
