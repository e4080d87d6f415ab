//! One page over many studies: what each came to, its verdicts, its figures small, and what it took. It is made of
//! what reports wrote into their folders, so it says nothing that no report says.

use super::{
    Verdicts, answered, families, open,
    page::{Extra, document_with},
    passed::words,
    sheet::{Entry, NONE, Sheet},
};
use document::count::duration;
use presentation::table::{escape_html as escape, prose, verdict_word};

const STYLE: &str = include_str!("index.css");

/// A study as the index shows it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct IndexEntry {
    /// Its folder of results, seen from the index.
    pub folder: String,
    /// What its report passes a verdict on.
    pub verdicts: Verdicts,
    /// Its drawings, seen from its folder, as `figures/voltages.svg`.
    pub drawings: Vec<String>,
}

/// The page. `options` are those of the command line that all the studies were asked for with; `unread` are folders
/// whose reports left nothing to read here.
#[must_use]
pub fn index(entries: &[IndexEntry], options: &[String], unread: &[String]) -> String {
    let studies: String = entries.iter().map(study).collect();
    let cost = format!(
        "<section id=\"cost\">\n<h2>Cost by study</h2>\n{}</section>\n",
        cost(entries).html()
    );
    let body = format!(
        "{}{}{}{studies}{}{cost}",
        header(entries, options, unread),
        answers(entries),
        by_family(entries),
        still_open(entries)
    );
    let extra = Extra {
        style: STYLE.into(),
        ..Extra::default()
    };
    document_with("Results of all studies", &body, &extra)
}

fn header(entries: &[IndexEntry], options: &[String], unread: &[String]) -> String {
    let all = || entries.iter().flat_map(|entry| &entry.verdicts.verdicts);
    let time: f64 = entries
        .iter()
        .filter_map(|entry| entry.verdicts.trial_time_s)
        .sum();
    let trials: usize = entries.iter().filter_map(|entry| entry.verdicts.trials).sum();
    let options = match options {
        [] => String::new(),
        options => format!(
            "<p><strong>Computed with {}.</strong></p>\n",
            escape(&options.join(", "))
        ),
    };
    let unread = match unread {
        [] => String::new(),
        folders => format!(
            "<p>Not shown, because their reports are older than this page: {}.</p>\n",
            escape(&folders.join(", "))
        ),
    };
    format!(
        "<header>\n<h1>Results of all studies</h1>\n{options}<p>Verdicts are those of a \
         family of studies, or of one study, taken together (Holm). Values and claims that are exploratory are counted \
         apart.</p>\n{unread}<div class=\"summary\">\n<div><h2>Studies</h2><p>{}</p></div>\n{}<div><h2>Time</h2>\
         <p>{} in {trials} trials</p></div>\n</div>\n</header>\n",
        entries.len(),
        counts(all()),
        duration(time),
    )
}

fn study(entry: &IndexEntry) -> String {
    let Verdicts {
        study,
        title,
        summary,
        basis,
        verdicts,
        ..
    } = &entry.verdicts;
    let page = format!("{}/index.html", escape(&entry.folder));
    let heading = if title.is_empty() { study } else { title };
    let text = |text: &str, class: &str| format!("<p{class}>{}</p>\n", prose::html(text));
    let sentence = summary
        .as_deref()
        .map_or(String::new(), |sentence| text(sentence, ""));
    let counts = counts(verdicts.iter());
    let counts = if counts.is_empty() {
        counts
    } else {
        format!("<div class=\"summary\">\n{counts}</div>\n")
    };
    format!(
        "<section class=\"study\" id=\"{}\">\n<h2><a href=\"{page}\">{}</a></h2>\n<p class=\"source\"><code>{}</code> \
         · {}</p>\n{sentence}{}{counts}{}</section>\n",
        escape(&entry.folder),
        escape(heading),
        escape(study),
        took(&entry.verdicts),
        text(basis, " class=\"quiet\""),
        drawings(entry, &page)
    )
}

/// The answers, family by family; empty where no study has one.
fn answers(entries: &[IndexEntry]) -> String {
    let page = |entry: &IndexEntry| format!("{}/index.html", entry.folder);
    let studies: Vec<(String, &Verdicts)> = entries
        .iter()
        .map(|entry| (page(entry), &entry.verdicts))
        .collect();
    let section = |(family, sheet): (String, Sheet)| {
        let heading = if family.is_empty() { "Answers" } else { &family };
        format!(
            "<section>\n<h2>{}</h2>\n{}</section>\n",
            escape(heading),
            sheet.html()
        )
    };
    answered::sheets(&studies).into_iter().map(section).collect()
}

/// The counts by family; empty where there is none.
fn by_family(entries: &[IndexEntry]) -> String {
    let studies: Vec<Verdicts> = entries.iter().map(|entry| entry.verdicts.clone()).collect();
    let sheet = families::sheet(&families::families(&studies));
    sheet.map_or_else(String::new, |sheet| {
        format!(
            "<section id=\"families\">\n<h2>Counts by family</h2>\n{}</section>\n",
            sheet.html()
        )
    })
}

/// What is open in any of the studies; empty where nothing is.
fn still_open(entries: &[IndexEntry]) -> String {
    let studies = || entries.iter().map(|entry| &entry.verdicts);
    let sheet = open::sheet(&open::still_open(studies()));
    sheet.map_or_else(String::new, |sheet| {
        format!(
            "<section id=\"open\">\n<h2>What is open</h2>\n<p>{}</p>\n{}</section>\n",
            escape(&open::Decided::of(studies()).in_words()),
            sheet.html()
        )
    })
}

fn took(verdicts: &Verdicts) -> String {
    match (verdicts.trial_time_s, verdicts.trials) {
        (Some(time), Some(trials)) => format!("{} in {trials} trials", duration(time)),
        _ => "time not noted".into(),
    }
}

/// Lines of counted words: published values, claims, and what is exploratory; none of what does not occur.
fn counts<'a>(passed: impl Iterator<Item = &'a super::Passed> + Clone) -> String {
    let is_claim = |it: &super::Passed| it.about.starts_with("claim ");
    let groups: [(&str, &dyn Fn(&super::Passed) -> bool); 3] = [
        ("Published values", &|it| !it.exploratory && !is_claim(it)),
        ("Claims", &|it| !it.exploratory && is_claim(it)),
        ("Exploratory", &|it| it.exploratory),
    ];
    let group = |(what, belongs): (&str, &dyn Fn(&super::Passed) -> bool)| {
        let chip = |word: &str| {
            let n = passed
                .clone()
                .filter(|it| belongs(it) && it.in_all() == word)
                .count();
            (n > 0).then(|| format!("<li><b>{n}</b> {}</li>", verdict_word(word, word)))
        };
        let chips: String = words().into_iter().filter_map(chip).collect();
        (!chips.is_empty()).then(|| format!("<div><h2>{what}</h2><ul>{chips}</ul></div>\n"))
    };
    groups.into_iter().filter_map(group).collect()
}

/// The figures, small, each of which leads to its place on the study's page.
fn drawings(entry: &IndexEntry, page: &str) -> String {
    let drawing = |path: &String| {
        let name = path.rsplit('/').next().unwrap_or(path).trim_end_matches(".svg");
        format!(
            "<a href=\"{page}#{0}\"><img loading=\"lazy\" src=\"{1}/{2}\" alt=\"Figure {0}; described on the page of \
             the study\"></a>\n",
            escape(name),
            escape(&entry.folder),
            escape(path)
        )
    };
    let all: String = entry.drawings.iter().map(drawing).collect();
    if all.is_empty() {
        all
    } else {
        format!("<div class=\"drawings\">\n{all}</div>\n")
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
            .map(Entry::plain)
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
            "<h2>What is open</h2>\n<p>3 of 4 values and claims that are judged are decided (75 %).</p>",
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
