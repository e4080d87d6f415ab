//! The report as one page: style sheet and drawings inside, nothing loaded from elsewhere.

use super::{
    FigureFacts, Parts, answers, by_seed, files,
    interactive::{self, Lines},
    kept::ENDINGS,
    legend,
    markdown::{NO_SETTINGS, SETTINGS, provenance, title},
    on_paper::{self, PaperFit},
    sheet::Sheet,
    stages,
};
use document::plain_text::printable;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use presentation::{
    figure::{Chart, FigureSpec, Shades, on_dark},
    table::{html, prose, verdict_word},
};

const STYLE: &str = include_str!("page.css");

/// Headings of the sections that are not folded.
const OPEN: [&str; 5] = ["Tables", "Figures", "Claims", "Confirmations", "Deviations"];

/// The whole page.
pub(super) fn page(parts: &Parts<'_>) -> String {
    let study = parts.study;
    let profiles = study.profiles.iter().map(|it| (it.name(), it.sentence()));
    let mut sections = vec![
        ("Tables", tables(parts)),
        ("Figures", figures(parts)),
        ("Claims", sheets(&parts.claims)),
        ("Confirmations", sheets(&parts.confirmed)),
        ("Deviations", list(&study.deviations)),
        (
            "Meaning of the verdicts",
            definitions(legend::entries(parts.contents)),
        ),
        ("Stages", graph(parts)),
        ("Budgets", sheets(&parts.budgets)),
        ("Settings that differ", settings(parts)),
        ("Values by seed", values_by_seed(parts)),
        ("What was run", runs(parts)),
        ("Profiles", definitions(profiles)),
        ("Provenance", definitions(provenance(parts))),
    ];
    sections.retain(|(_, body)| !body.0.is_empty());
    let body = html! {
        (header(parts))
        nav { @for (heading, _) in &sections { (link_to(heading, heading)) } }
        @for (heading, body) in &sections {
            section id=(anchor(heading)) {
                @if OPEN.contains(heading) {
                    h2 { (heading) }
                    (body)
                } @else {
                    details {
                        summary { h2 { (heading) } }
                        (body)
                    }
                }
            }
        }
    };
    let charts: Vec<&Chart> = charts(parts).collect();
    let plotted = charts.iter().any(|chart| Lines::of(chart).is_some());
    let mut extra = Extra {
        style: dark_figures(parts, &charts),
        ..Extra::default()
    };
    if plotted {
        extra.style += interactive::STYLE;
        extra.script = interactive::script();
    }
    document(title(parts), &body, &extra)
}

/// The charts that are drawn on the page.
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

/// The id of a section, different from those of tables and figures.
fn anchor(heading: &str) -> String {
    format!("section-{}", heading.to_lowercase().replace(' ', "-"))
}

fn link_to(heading: &str, text: &str) -> Markup {
    html! { a href={ "#" (anchor(heading)) } { (text) } }
}

/// Parts of a page besides its body and the common style sheet.
#[derive(Default)]
pub(super) struct Extra {
    /// Rules of a style sheet.
    pub(super) style: String,
    /// A script at the end.
    pub(super) script: Markup,
}

/// A complete page around a body. The page forbids the browser to load anything but images beside it.
pub(super) fn document(title: &str, body: &Markup, extra: &Extra) -> String {
    const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src 'self' file: data:";
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(&extra.style)) }
            }
            body {
                main { (body) }
                (extra.script)
            }
        }
        "\n"
    };
    printable(&page.0).into_owned()
}

fn header(parts: &Parts<'_>) -> Markup {
    let study = parts.study;
    let answers = sheets(&parts.answers);
    html! {
        header {
            h1 { (title(parts)) }
            p.source {
                code { (study.name) }
                @if !study.source.is_empty() { " · " (prose::html(&study.source)) }
            }
            @for sentence in study.asked_with().into_iter().chain(study.outdated()) {
                p { strong { (sentence) } }
            }
            @if let Some(text) = study.rehearsal() { p.banner { (prose::html(text)) } }
            // Answers in words replace the sentence, and precede the verdicts behind them.
            @if let Some(answered) = &parts.answered {
                (answered.html())
                @if parts.answers.is_some() {
                    details {
                        summary { "Every value and claim" }
                        (answers)
                    }
                }
            } @else {
                @if let Some(sentence) = &parts.sentence { p { (prose::html(sentence)) } }
                (answers)
            }
            (first_deviations(&study.deviations))
            p { (prose::html(&parts.basis)) }
            div.summary {
                @for counts in &parts.head { (counted(&counts.what, &counts.words)) }
                div { h2 { "Trials" } p { (parts.ran.sentence()) } }
                div { h2 { "Time" } p { (parts.contents.cost(parts.results).sentence()) } }
            }
        }
    }
}

/// Words of verdicts with their numbers, under the counted quantity.
pub(super) fn counted(what: &str, words: &[(&str, usize)]) -> Markup {
    html! {
        div {
            h2 { (what) }
            ul { @for (word, number) in words { li { b { (number) } " " (verdict_word(word, word)) } } }
        }
    }
}

/// The most important deviations, where the section has more.
fn first_deviations(all: &[String]) -> Markup {
    let first = answers::FIRST_DEVIATIONS;
    let link = link_to("Deviations", &format!("{first} of {}", all.len()));
    html! {
        @if all.len() > first {
            p { "Deviations from the source, the first " (link) ":" }
            (list(&all[..first]))
        }
    }
}

fn tables(parts: &Parts<'_>) -> Markup {
    html! {
        @for (name, grid) in &parts.contents.tables {
            @let grid = grid.as_ref().map(|grid| (grid, PaperFit::of(&on_paper::columns(grid))));
            article id=(files::slug(name)) class=[grid.ok().and_then(|(_, paper)| paper.class())] {
                h3 { (name) }
                @match grid {
                    Ok((grid, paper)) => {
                        (paper.around(&html(grid)))
                        (links("tables", name, &["csv", "tex", "md"]))
                    }
                    Err(reason) => p.problem { "Could not be made: " (prose::html(reason)) }
                }
            }
        }
    }
}

fn figures(parts: &Parts<'_>) -> Markup {
    let figures = parts.contents.figures.iter().zip(&parts.study.figures);
    html! {
        @for ((name, chart), (_, spec)) in figures {
            article id=(files::slug(name)) {
                h3 { (name) }
                (figure(parts, name, chart, spec))
            }
        }
    }
}

fn figure(parts: &Parts<'_>, name: &str, chart: &Result<Chart, String>, spec: &FigureSpec) -> Markup {
    let drawn = |facts: &FigureFacts, svg: &str, lines: Option<Lines>, endings: &[&str]| {
        // A caption is a sentence, with or without its full stop.
        let stop = if spec.caption.is_empty() || spec.caption.ends_with(['.', '!', '?']) {
            ""
        } else {
            "."
        };
        let caption = format!("{}{stop} {}", spec.caption, facts.notes.join(" "));
        let width = if facts.is_wide { "double" } else { "single" };
        html! {
            figure.(width).(facts.shades.ground.class()) {
                (inline(svg, &facts.words))
                @if let Some(lines) = lines { (lines.element()) }
                figcaption { (prose::html(caption.trim())) }
            }
            (links("figures", name, endings))
        }
    };
    match (chart, parts.drawings.get(name), parts.contents.kept.get(name)) {
        (Ok(chart), Some(svg), _) => drawn(&FigureFacts::of(chart), svg, Lines::of(chart), &ENDINGS),
        (Err(_), _, Some(kept)) => drawn(&kept.facts, &kept.svg, None, &kept.endings),
        (Err(reason), _, None) => html! { p.problem { "Could not be drawn: " (prose::html(reason)) } },
        (Ok(_), None, _) => Markup::default(),
    }
}

/// A drawing that fills its column, with a label for readers who cannot see it.
fn inline(svg: &str, label: &str) -> Markup {
    let sized = svg.find(" viewBox").map_or(svg, |start| &svg[start..]);
    html! {
        (PreEscaped("<svg role=\"img\" aria-label=\"")) (label)
        (PreEscaped("\" stroke-linejoin=\"round\"")) (PreEscaped(sized))
    }
}

fn links(folder: &str, name: &str, extensions: &[&str]) -> Markup {
    html! {
        p.links {
            @for (index, extension) in extensions.iter().enumerate() {
                @if index > 0 { " · " }
                a href={ (folder) "/" (files::name(name, extension)) } { (extension) }
            }
        }
    }
}

/// The artifacts that trials take from each other, as a drawing and as a table.
fn graph(parts: &Parts<'_>) -> Markup {
    let stages = &parts.study.stages;
    html! {
        @if let Some(sheet) = stages::sheet(stages) {
            figure.double { (stages::drawing(stages)) }
            (sheet.html())
        }
    }
}

fn sheets<'a>(sheets: impl IntoIterator<Item = &'a Sheet>) -> Markup {
    html! { @for sheet in sheets { (sheet.html()) } }
}

fn list(items: &[String]) -> Markup {
    html! {
        @if !items.is_empty() {
            ul { @for item in items { li { (prose::html(item)) } } }
        }
    }
}

fn settings(parts: &Parts<'_>) -> Markup {
    let text = if parts.settings.is_empty() {
        NO_SETTINGS
    } else {
        SETTINGS
    };
    html! {
        p { (text) " The complete configs are in " a href="resolved.yaml" { "resolved.yaml" } "." }
        (sheets(&parts.settings))
    }
}

fn values_by_seed(parts: &Parts<'_>) -> Markup {
    html! {
        @for (name, grid) in &parts.contents.tables {
            @if let Ok(grid) = grid {
                details {
                    summary { (name) ": " (by_seed::count(grid)) " values" }
                    (by_seed::sheet(grid).html())
                    p.links { a href={ "tables/" (files::by_seed(name)) } { "all digits: csv" } }
                }
            }
        }
    }
}

fn runs(parts: &Parts<'_>) -> Markup {
    html! {
        p { (parts.ran.sentence()) "." }
        (list(&parts.ran.failures))
    }
}

fn definitions<'a>(entries: impl IntoIterator<Item = (&'a str, impl Render)>) -> Markup {
    let mut entries = entries.into_iter().peekable();
    html! {
        @if entries.peek().is_some() {
            dl { @for (what, value) in entries { dt { (what) } dd { (value) } } }
        }
    }
}
