//! A view as one self-contained page, which a browser reloads by itself.

use super::{Panel, SeedLine, StudyView, View, in_words, short::shortened};
use contract::{Better, Error};
use document::plain_text::printable;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use presentation::figure::{self, Chart, Point, Scale, Series, Shape, Style};

/// Width of a name in the legend, in columns.
const NAME: usize = 60;
/// Panels in a row.
const COLUMNS: usize = 2;
const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;\
color:#1a1a1a;background:#fff}h1{font-size:1.3rem}h2{font-size:1.1rem;margin-top:2rem}table{border-collapse:collapse}\
td,th{padding:.1rem 1rem .1rem 0;text-align:left;font-weight:normal}td.n{text-align:right;font-variant-numeric:\
tabular-nums}progress{width:12rem}p.at,td.by{color:#666}p.note{color:#a00}svg{max-width:100%;height:auto}";

/// The page. With `refresh_s`, the browser reloads it after this number of seconds.
///
/// # Errors
/// [`Error::Render`] where a drawing is refused.
pub fn page(view: &View, refresh_s: Option<u64>) -> Result<String, Error> {
    let names: Vec<&str> = view.studies.iter().map(|study| study.name.as_str()).collect();
    let title = names.join(", ");
    let sections = view.studies.iter().map(|study| section(view, study));
    let sections: Vec<Markup> = sections.collect::<Result<_, _>>()?;
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                @if let Some(seconds) = refresh_s { meta http-equiv="refresh" content=(seconds); }
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                p.at { "Seen at " (view.at) "." }
                @for section in &sections { (section) }
            }
        }
        "\n"
    };
    Ok(printable(&page.0).into_owned())
}

fn section(view: &View, study: &StudyView) -> Result<Markup, Error> {
    let mut drawings = Vec::new();
    for metric in &view.metrics {
        let has_metric = |panel: &&Panel| panel.bounds(metric).is_some();
        let panels: Vec<&Panel> = study.panels.iter().filter(has_metric).collect();
        if !panels.is_empty() {
            drawings.push((metric, figure::svg(&chart(view, &panels, metric))?));
        }
    }
    let (done, trials) = (study.done(), study.trials);
    Ok(html! {
        section {
            h2 { (study.name) }
            p {
                progress value=(done) max=(trials.max(1)) {}
                " " (done) " of " (trials) " trials: " (study.summary())
            }
            @for note in &study.notes { p.note { (note) } }
            @for panel in &study.panels { (best(view, panel)) }
            (running(study, view.metrics.first().map_or("", String::as_str)))
            @for (metric, drawing) in &drawings {
                h3 { (metric) }
                (PreEscaped(drawing))
            }
        }
    })
}

/// The best agent of a panel so far in its first metric; empty if it has no metric.
fn best(view: &View, panel: &Panel) -> Markup {
    let mut metrics = view.metrics.iter();
    let best = metrics.find_map(|metric| Some((metric, view.best(panel, metric)?)));
    html! {
        @if let Some((metric, best)) = best {
            p { "Best so far in " (panel.title()) ": " b { (best.name) } ", " (metric) " " (best.in_words()) }
        }
    }
}

/// The running trials as a table with the last value of a metric; empty where none runs.
fn running(study: &StudyView, metric: &str) -> Markup {
    html! {
        @if !study.running.is_empty() {
            table {
                @for it in &study.running {
                    tr {
                        th scope="row" { (it.title) }
                        td { @if let Some(part) = it.part() { progress value=(format!("{part:.3}")) {} } }
                        td.n { (it.step) " of " (it.steps) " steps" }
                        td.n { @if let Some(value) = it.values.get(metric) { (metric) " " (in_words(*value)) } }
                        td.by { (it.by) }
                    }
                }
            }
        }
    }
}

/// A panel for each environment and search, with a line for each seed in the colour of its agent.
fn chart(view: &View, panels: &[&Panel], metric: &str) -> Chart {
    let panels = panels.iter().map(|panel| figure::Panel {
        title: panel.title(),
        x: Scale {
            label: "steps".into(),
            ..Scale::default()
        },
        y: Scale {
            label: metric.into(),
            ..Scale::default()
        },
        series: series(view, panel, metric),
    });
    let mut chart = Chart {
        panels: panels.collect(),
        columns: COLUMNS,
        ..Chart::default()
    };
    let better = if view.less_is_better.contains(metric) {
        Better::Lower
    } else {
        Better::Higher
    };
    figure::name_the_best(&mut chart, better);
    chart
}

/// The lines of a panel, each with the name and the standing of its agent.
fn series(view: &View, panel: &Panel, metric: &str) -> Vec<Series> {
    let standing = view.standing(panel, metric);
    let names = shortened(&standing.iter().map(|it| it.name).collect::<Vec<_>>(), NAME);
    let label = |agent: usize| {
        let found = standing.iter().zip(&names).find(|(it, _)| it.agent == agent);
        found.map_or_else(String::new, |(it, name)| format!("{name} {}", it.in_words()))
    };
    let lines = panel.lines.iter();
    let lines = lines.filter_map(|line| Some((line, line.curves.get(metric)?)));
    let one = |(line, curve): (&SeedLine, &Vec<(u64, f64)>)| {
        #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
        let point = |(step, y): &(u64, f64)| Point {
            x: *step as f64,
            y: *y,
            interval: None,
        };
        let points: Vec<Point> = curve.iter().map(point).collect();
        Series {
            label: label(line.agent),
            seeds: None,
            style: Style::of_agent(line.agent),
            shape: if points.len() > 1 {
                Shape::Line(points)
            } else {
                Shape::Points(points)
            },
        }
    };
    lines.map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{search, view};
    use super::*;

    #[test]
    fn the_page_holds_all_it_needs_and_asks_to_be_read_again() {
        let mut view = view();
        view.studies[0].name = "a <b>".into();
        view.studies[0].notes.push("one & all".into());
        let page = page(&view, Some(5)).unwrap();
        for part in [
            "<meta http-equiv=\"refresh\" content=\"5\">",
            "<title>a &lt;b&gt;</title>",
            "3 of 6 trials: 2 ok, 1 nan, 2 running, 1 missing",
            "<progress value=\"0.375\"></progress></td><td class=\"n\">300 of 800 steps</td>\
             <td class=\"n\">return 4.000",
            "Best so far in four_cells: <b>equal</b>, return 0.0 (1)",
            "one &amp; all",
            "<svg",
        ] {
            assert!(page.contains(part), "{part}\n{page}");
        }
        for outside in ["<script", "src=", "href=\"http", "@import", "url(http"] {
            assert!(!page.contains(outside), "{outside}");
        }
        assert!(!super::page(&view, None).unwrap().contains("http-equiv"));
    }

    #[test]
    fn every_seed_has_a_line_and_every_agent_one_entry_in_the_legend() {
        let view = view();
        let chart = chart(&view, &[&view.studies[0].panels[0]], "return");
        let series = &chart.panels[0].series;
        assert_eq!(series.len(), 4);
        assert_eq!(figure::legend_names(&chart), ["equal 0.0 (1)", "dsac 7.333 (3)"]);
        assert_eq!(series[1].style, series[3].style);
        assert!(series[0].style != series[1].style);
    }

    #[test]
    fn of_a_search_the_best_settings_are_named() {
        let view = search(9);
        let chart = chart(&view, &[&view.studies[0].panels[0]], "return");
        let names = figure::legend_names(&chart);
        assert_eq!((names.len(), names[5].as_str()), (6, "4 others"));
        assert!(names[0].starts_with("learner act"), "{names:?}");
        let page = page(&view, None).unwrap();
        assert!(
            page.contains("Best so far in four_cells, search rates: <b>learner"),
            "{page}"
        );
    }
}
