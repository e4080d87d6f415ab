//! The report as one page: style sheet and drawings inside, nothing loaded from elsewhere.

use super::{
    Parts, files,
    markdown::{end_states, failure, provenance, title},
};
use crate::{
    figure::{Chart, FigureSpec},
    table::{Grid, escape_html as escape, html, verdict_word},
};

const STYLE: &str = include_str!("page.css");

/// The whole page.
pub(super) fn page(parts: &Parts<'_>) -> String {
    let title = escape(title(parts));
    let sections = [
        header(parts, &title),
        section("Tables", &tables(parts)),
        section("Figures", &figures(parts)),
        section("Claims", &claims(parts)),
        section("Departures", &list(&parts.study.departures)),
        section("What was run", &runs(parts)),
        section("Provenance", &entries(parts)),
    ];
    document(&title, &sections.concat())
}

/// A page of its own around a body; `title` is escaped already.
pub(super) fn document(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n"
    )
}

fn header(parts: &Parts<'_>, title: &str) -> String {
    let source = escape(&parts.study.source);
    let note = |options: String| format!("<p><strong>Computed {}.</strong></p>\n", escape(&options));
    let options = parts.study.asked_with().map_or_else(String::new, note);
    let chips = |what: &str, counts: &[(&str, usize)]| {
        let chip = |(word, n): &(&str, usize)| format!("<li><b>{n}</b> {}</li>", verdict_word(word));
        let present: String = counts.iter().filter(|(_, n)| *n > 0).map(chip).collect();
        if present.is_empty() { String::new() } else { format!("<div><h2>{what}</h2><ul>{present}</ul></div>\n") }
    };
    format!(
        "<header>\n<h1>{title}</h1>\n<p class=\"source\"><code>{}</code>{}{source}</p>\n{options}<div class=\"summary\">\n{}{}\
         <div><h2>Trials</h2><p>{}</p></div>\n</div>\n</header>\n",
        escape(&parts.study.name),
        if source.is_empty() { "" } else { " · " },
        chips("Published values", &parts.contents.verdicts()),
        chips("Claims", &parts.contents.outcomes()),
        escape(&end_states(parts)),
    )
}

fn section(heading: &str, body: &str) -> String {
    if body.is_empty() { String::new() } else { format!("<section>\n<h2>{heading}</h2>\n{body}</section>\n") }
}

fn tables(parts: &Parts<'_>) -> String {
    let table = |(name, grid): &(String, Result<Grid, String>)| {
        let body = match grid {
            Ok(grid) => format!("<div class=\"wide\">\n{}</div>\n{}", html(grid), links("tables", name, &["csv", "tex", "md"])),
            Err(reason) => format!("<p class=\"problem\">Could not be made: {}</p>\n", escape(reason)),
        };
        format!("<article id=\"{}\">\n<h3>{}</h3>\n{body}</article>\n", files::slug(name), escape(name))
    };
    parts.contents.tables.iter().map(table).collect()
}

fn figures(parts: &Parts<'_>) -> String {
    let pairs = parts.contents.figures.iter().zip(&parts.study.figures);
    pairs.map(|((name, chart), (_, spec))| figure(parts, name, chart, spec)).collect()
}

fn figure(parts: &Parts<'_>, name: &str, chart: &Result<Chart, String>, spec: &FigureSpec) -> String {
    let body = match (chart, parts.drawings.get(name)) {
        (Ok(chart), Some(svg)) => {
            let caption = escape(&format!("{} {}", spec.caption, chart.notes.join(" ")));
            let width = if chart.columns > 1 { "double" } else { "single" };
            let drawing = inline(svg, if spec.caption.is_empty() { name } else { &spec.caption });
            format!(
                "<figure class=\"{width}\">\n{drawing}<figcaption>{}</figcaption>\n</figure>\n{}",
                caption.trim(),
                links("figures", name, &["svg", "png", "csv"])
            )
        }
        (Err(reason), _) => format!("<p class=\"problem\">Could not be drawn: {}</p>\n", escape(reason)),
        (Ok(_), None) => String::new(),
    };
    format!("<article id=\"{}\">\n<h3>{}</h3>\n{body}</article>\n", files::slug(name), escape(name))
}

/// A drawing that fills its column, with a name for readers who cannot see it.
fn inline(svg: &str, label: &str) -> String {
    let sized = svg.find(" viewBox").map_or(svg, |start| &svg[start..]);
    format!("<svg role=\"img\" aria-label=\"{}\" stroke-linejoin=\"round\"{sized}", escape(label))
}

fn links(folder: &str, name: &str, extensions: &[&str]) -> String {
    let link = |extension: &&str| format!("<a href=\"{folder}/{}\">{extension}</a>", files::name(name, extension));
    format!("<p class=\"links\">{}</p>\n", extensions.iter().map(link).collect::<Vec<_>>().join(" · "))
}

fn claims(parts: &Parts<'_>) -> String {
    if parts.contents.claims.is_empty() {
        return String::new();
    }
    let head = ["claim", "environment", "verdict", "left minus right", "notes"]
        .map(|cell| format!("<th scope=\"col\">{cell}</th>"))
        .concat();
    let row = |line: &super::ClaimLine| {
        let cells = [
            format!("<code>{}</code>", escape(&line.text)),
            escape(&line.place),
            verdict_word(line.word()),
            escape(&line.numbers()),
            escape(&line.notes().join("; ")),
        ];
        format!("<tr>{}</tr>\n", cells.map(|cell| format!("<td>{cell}</td>")).concat())
    };
    let rows: String = parts.contents.claims.iter().map(row).collect();
    format!(
        "<div class=\"wide\">\n<table class=\"text\">\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n"
    )
}

fn list(items: &[String]) -> String {
    if items.is_empty() {
        return String::new();
    }
    format!("<ul>\n{}</ul>\n", items.iter().map(|item| format!("<li>{}</li>\n", escape(item))).collect::<String>())
}

fn runs(parts: &Parts<'_>) -> String {
    let failed = parts.results.trials.iter().filter(|trial| trial.end.is_some() && !trial.is_ok());
    format!("<p>{}.</p>\n{}", escape(&end_states(parts)), list(&failed.map(failure).collect::<Vec<_>>()))
}

fn entries(parts: &Parts<'_>) -> String {
    let entry = |(what, value): (&str, String)| format!("<dt>{what}</dt><dd>{}</dd>\n", escape(&value));
    format!("<dl>\n{}</dl>\n", provenance(parts).into_iter().map(entry).collect::<String>())
}
