//! The report as one page: style sheet and drawings inside, nothing loaded from elsewhere.

use super::{
    FigureFacts, Parts, answers, by_seed, files, head,
    interactive::{self, Lines},
    kept::ENDINGS,
    legend,
    markdown::{NO_SETTINGS, SETTINGS, provenance, title},
    on_paper::{self, OnPaper},
    sheet::Sheet,
    stages,
};
use presentation::{
    figure::{Chart, FigureSpec, Shades, on_dark},
    table::{Grid, escape_html as escape, html, prose, verdict_word},
};

const STYLE: &str = include_str!("page.css");

/// The sections that are not folded.
const OPEN: [&str; 5] = ["Tables", "Figures", "Claims", "Confirmations", "Deviations"];

/// The whole page.
pub(super) fn page(parts: &Parts<'_>) -> String {
    let title = escape(title(parts));
    let sections = [
        ("Tables", tables(parts)),
        ("Figures", figures(parts)),
        ("Claims", parts.claims.iter().map(Sheet::html).collect()),
        ("Confirmations", parts.confirmed.iter().map(Sheet::html).collect()),
        ("Deviations", list(&parts.study.deviations)),
        ("Meaning of the verdicts", definitions(meanings(parts))),
        ("Stages", graph(parts)),
        ("Budgets", parts.budgets.iter().map(Sheet::html).collect()),
        ("Settings that differ", settings(parts)),
        ("Values by seed", values_by_seed(parts)),
        ("What was run", runs(parts)),
        ("Profiles", profiles(parts)),
        ("Provenance", entries(parts)),
    ];
    let present: Vec<_> = sections.iter().filter(|(_, body)| !body.is_empty()).collect();
    let link = |(heading, _): &&(&str, String)| format!("<a href=\"#{}\">{heading}</a>\n", anchor(heading));
    let links: String = present.iter().map(link).collect();
    let section = |(heading, body): &&(&str, String)| {
        let (open, close) = if OPEN.contains(heading) {
            (format!("<h2>{heading}</h2>"), "")
        } else {
            (
                format!("<details>\n<summary><h2>{heading}</h2></summary>"),
                "</details>\n",
            )
        };
        format!(
            "<section id=\"{}\">\n{open}\n{body}{close}</section>\n",
            anchor(heading)
        )
    };
    let sections: String = present.iter().map(section).collect();
    let body = format!("{}<nav>\n{links}</nav>\n{sections}", header(parts, &title));
    let charts: Vec<&Chart> = charts(parts).collect();
    let plotted = charts.iter().any(|chart| Lines::of(chart).is_some());
    let extra = Extra {
        style: dark_figures(parts, &charts) + if plotted { interactive::STYLE } else { "" },
        script: if plotted {
            interactive::script()
        } else {
            String::new()
        },
    };
    document_with(&title, &body, &extra)
}

/// The charts that are drawn.
fn charts<'a>(parts: &Parts<'a>) -> impl Iterator<Item = &'a Chart> {
    parts
        .contents
        .figures
        .iter()
        .filter_map(|(_, chart)| chart.as_ref().ok())
}

/// The rules for figures on a dark page.
fn dark_figures(parts: &Parts<'_>, charts: &[&Chart]) -> String {
    let kept = parts.contents.kept.values().map(|kept| kept.facts.shades.clone());
    let shades: Vec<Shades> = charts.iter().map(|chart| Shades::of(chart)).chain(kept).collect();
    match on_dark(&shades) {
        rules if rules.is_empty() => rules,
        rules => format!("@media screen and (prefers-color-scheme: dark) {{\n{rules}}}\n"),
    }
}

/// The id of a section, which no table or figure has.
fn anchor(heading: &str) -> String {
    format!("section-{}", heading.to_lowercase().replace(' ', "-"))
}

/// What a page has beside its body and the style sheet of all pages.
#[derive(Default)]
pub(super) struct Extra {
    /// Rules of a style sheet.
    pub(super) style: String,
    /// A script at the end.
    pub(super) script: String,
}

/// A page of its own around a body; `title` is escaped already.
pub(super) fn document(title: &str, body: &str) -> String {
    document_with(title, body, &Extra::default())
}

/// The same with rules and scripts of its own. The browser is told to load nothing but images that lie beside the
/// page.
pub(super) fn document_with(title: &str, body: &str, extra: &Extra) -> String {
    const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src 'self' file: data:";
    let Extra { style, script } = extra;
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>\n{STYLE}{style}</style>\n</head>\n<body>\n<main>\n{body}</main>\n{script}</body>\n</html>\n"
    )
}

fn header(parts: &Parts<'_>, title: &str) -> String {
    let source = prose::html(&parts.study.source);
    let note = |options: String| format!("<p><strong>{}</strong></p>\n", escape(&options));
    let options = parts.study.asked_with().map_or_else(String::new, note);
    let strong = |sentence: &String| format!("<p><strong>{}</strong></p>\n", escape(sentence));
    let outdated: String = parts.study.outdated().iter().map(strong).collect();
    let options = options + &outdated;
    let banner = |text: &str| format!("<p class=\"banner\">{}</p>\n", prose::html(text));
    let banner = parts.study.rehearsal().map_or_else(String::new, banner);
    let paragraph = |text: &String| format!("<p>{}</p>\n", prose::html(text));
    let sentence = parts.sentence.as_ref().map_or_else(String::new, paragraph);
    let answers = parts.answers.as_ref().map_or_else(String::new, Sheet::html);
    // Answers in words stand for the sentence, and before what they rest on.
    let (sentence, answers) = match &parts.answered {
        Some(answered) => {
            let all = format!("<details>\n<summary>Every value and claim</summary>\n{answers}</details>\n");
            (answered.html(), if answers.is_empty() { answers } else { all })
        }
        None => (sentence, answers),
    };
    let deviations = first_deviations(&parts.study.deviations);
    let basis = paragraph(&parts.basis);
    let chips = |counts: &head::Line| {
        let chip = |(word, n): &(&str, usize)| format!("<li><b>{n}</b> {}</li>", verdict_word(word, word));
        format!(
            "<div><h2>{}</h2><ul>{}</ul></div>\n",
            counts.what,
            counts.words.iter().map(chip).collect::<String>()
        )
    };
    format!(
        "<header>\n<h1>{title}</h1>\n<p class=\"source\"><code>{}</code>{}{source}</p>\n{options}{}<div \
         class=\"summary\">\n{}\
         <div><h2>Trials</h2><p>{}</p></div>\n<div><h2>Time</h2><p>{}</p></div>\n</div>\n</header>\n",
        escape(&parts.study.name),
        if source.is_empty() { "" } else { " · " },
        [banner, sentence, answers, deviations, basis].concat(),
        parts.head.iter().map(chips).collect::<String>(),
        escape(&parts.ran.sentence()),
        parts.contents.cost(parts.results).sentence(),
    )
}

/// The deviations that matter most, where the section has more than these.
fn first_deviations(all: &[String]) -> String {
    let first = answers::FIRST_DEVIATIONS;
    if all.len() <= first {
        return String::new();
    }
    let link = format!(
        "<a href=\"#{}\">{first} of {}</a>",
        anchor("Deviations"),
        all.len()
    );
    format!(
        "<p>Deviations from the source, the first {link}:</p>\n{}",
        list(&all[..first])
    )
}

fn meanings<'a>(parts: &Parts<'a>) -> impl Iterator<Item = (&'a str, String)> + use<'a> {
    let entries = legend::entries(parts.contents).into_iter();
    entries.map(|(word, meaning)| (word, meaning.to_owned()))
}

fn tables(parts: &Parts<'_>) -> String {
    let table = |(name, grid): &(String, Result<Grid, String>)| {
        let (class, body) = match grid {
            Ok(grid) => {
                let paper = OnPaper::of(&on_paper::columns(grid));
                let links = links("tables", name, &["csv", "tex", "md"]);
                (
                    paper.class(),
                    format!("{}\n{}</div>\n{links}", paper.open(), html(grid)),
                )
            }
            Err(reason) => (
                "",
                format!(
                    "<p class=\"problem\">Could not be made: {}</p>\n",
                    prose::html(reason)
                ),
            ),
        };
        format!(
            "<article id=\"{}\"{class}>\n<h3>{}</h3>\n{body}</article>\n",
            files::slug(name),
            escape(name)
        )
    };
    parts.contents.tables.iter().map(table).collect()
}

fn figures(parts: &Parts<'_>) -> String {
    let pairs = parts.contents.figures.iter().zip(&parts.study.figures);
    pairs
        .map(|((name, chart), (_, spec))| figure(parts, name, chart, spec))
        .collect()
}

fn figure(parts: &Parts<'_>, name: &str, chart: &Result<Chart, String>, spec: &FigureSpec) -> String {
    let drawn = |facts: &FigureFacts, svg: &str, lines: &str, endings: &[&str]| {
        // A caption is a sentence, with or without its full stop.
        let stop = if spec.caption.is_empty() || spec.caption.ends_with(['.', '!', '?']) {
            ""
        } else {
            "."
        };
        let caption = prose::html(&format!("{}{stop} {}", spec.caption, facts.notes.join(" ")));
        let width = if facts.is_wide { "double" } else { "single" };
        let ground = facts.shades.ground.class();
        format!(
            "<figure class=\"{width} {ground}\">\n{}{lines}<figcaption>{}</figcaption>\n</figure>\n{}",
            inline(svg, &facts.words),
            caption.trim(),
            links("figures", name, endings)
        )
    };
    let body = match (chart, parts.drawings.get(name), parts.contents.kept.get(name)) {
        (Ok(chart), Some(svg), _) => {
            let lines = Lines::of(chart).map_or(String::new(), |lines| lines.element());
            drawn(&FigureFacts::of(chart), svg, &lines, &ENDINGS)
        }
        (Err(_), _, Some(kept)) => drawn(&kept.facts, &kept.svg, "", &kept.endings),
        (Err(reason), _, None) => format!(
            "<p class=\"problem\">Could not be drawn: {}</p>\n",
            prose::html(reason)
        ),
        (Ok(_), None, _) => String::new(),
    };
    format!(
        "<article id=\"{}\">\n<h3>{}</h3>\n{body}</article>\n",
        files::slug(name),
        escape(name)
    )
}

/// A drawing that fills its column, with a name for readers who cannot see it.
fn inline(svg: &str, label: &str) -> String {
    let sized = svg.find(" viewBox").map_or(svg, |start| &svg[start..]);
    format!(
        "<svg role=\"img\" aria-label=\"{}\" stroke-linejoin=\"round\"{sized}",
        escape(label)
    )
}

fn links(folder: &str, name: &str, extensions: &[&str]) -> String {
    let link = |extension: &&str| {
        format!(
            "<a href=\"{folder}/{}\">{extension}</a>",
            files::name(name, extension)
        )
    };
    format!(
        "<p class=\"links\">{}</p>\n",
        extensions.iter().map(link).collect::<Vec<_>>().join(" · ")
    )
}

/// What the trials take from each other, drawn and as a table.
fn graph(parts: &Parts<'_>) -> String {
    let stages = &parts.study.stages;
    let sheet = |sheet: Sheet| {
        format!(
            "<figure class=\"double\">\n{}</figure>\n{}",
            stages::drawing(stages),
            sheet.html()
        )
    };
    stages::sheet(stages).map_or_else(String::new, sheet)
}

fn list(items: &[String]) -> String {
    if items.is_empty() {
        return String::new();
    }
    format!(
        "<ul>\n{}</ul>\n",
        items
            .iter()
            .map(|item| format!("<li>{}</li>\n", prose::html(item)))
            .collect::<String>()
    )
}

fn settings(parts: &Parts<'_>) -> String {
    const FILE: &str = "<a href=\"resolved.yaml\">resolved.yaml</a>";
    let sheets: String = parts.settings.iter().map(Sheet::html).collect();
    let text = if sheets.is_empty() { NO_SETTINGS } else { SETTINGS };
    format!("<p>{text} The complete configs are in {FILE}.</p>\n{sheets}")
}

fn values_by_seed(parts: &Parts<'_>) -> String {
    let made = parts
        .contents
        .tables
        .iter()
        .filter_map(|(name, grid)| Some((name, grid.as_ref().ok()?)));
    let table = |(name, grid): (&String, &Grid)| {
        let file = files::by_seed(name);
        format!(
            "<details>\n<summary>{}: {} values</summary>\n{}\
             <p class=\"links\"><a href=\"tables/{file}\">all digits: csv</a></p>\n</details>\n",
            escape(name),
            by_seed::count(grid),
            by_seed::sheet(grid).html()
        )
    };
    made.map(table).collect()
}

fn runs(parts: &Parts<'_>) -> String {
    format!(
        "<p>{}.</p>\n{}",
        escape(&parts.ran.sentence()),
        list(&parts.ran.failures)
    )
}

fn profiles(parts: &Parts<'_>) -> String {
    definitions(
        parts
            .study
            .profiles
            .iter()
            .map(|profile| (profile.name(), profile.sentence())),
    )
}

fn entries(parts: &Parts<'_>) -> String {
    definitions(provenance(parts).into_iter())
}

fn definitions<'a>(entries: impl Iterator<Item = (&'a str, String)>) -> String {
    let entry =
        |(what, value): (&str, String)| format!("<dt>{}</dt><dd>{}</dd>\n", escape(what), escape(&value));
    let entries: String = entries.map(entry).collect();
    if entries.is_empty() {
        entries
    } else {
        format!("<dl>\n{entries}</dl>\n")
    }
}
