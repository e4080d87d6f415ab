//! A view as one self-contained page, which a browser reads again by itself.

use super::{Panel, SeedLine, StudyView, View, in_words, short::shortened};
use contract::{Better, Error};
use presentation::{
    figure::{self, Chart, Point, Scale, Series, Shape, Style},
    table::escape_html,
};

/// Columns of a name in the legend.
const NAME: usize = 60;
/// Panels in a row.
const COLUMNS: usize = 2;
const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;\
color:#1a1a1a;background:#fff}h1{font-size:1.3rem}h2{font-size:1.1rem;margin-top:2rem}table{border-collapse:collapse}\
td,th{padding:.1rem 1rem .1rem 0;text-align:left;font-weight:normal}td.n{text-align:right;font-variant-numeric:\
tabular-nums}progress{width:12rem}p.at,td.by{color:#666}p.note{color:#a00}svg{max-width:100%;height:auto}";

/// The page. It asks to be read again after `refresh_s` seconds, where that is given.
///
/// # Errors
/// [`Error::Render`] where a drawing is refused.
pub fn page(view: &View, refresh_s: Option<u64>) -> Result<String, Error> {
    let refresh = refresh_s.map_or_else(String::new, |seconds| {
        format!("<meta http-equiv=\"refresh\" content=\"{seconds}\">\n")
    });
    let names: Vec<&str> = view.studies.iter().map(|study| study.name.as_str()).collect();
    let title = escape_html(&names.join(", "));
    let mut body = String::new();
    for study in &view.studies {
        body += &section(view, study)?;
    }
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n{refresh}<title>{title}</title>\n<style>{STYLE}</style>\n\
         </head>\n<body>\n<h1>{title}</h1>\n<p class=\"at\">Seen at {}.</p>\n{body}</body>\n</html>\n",
        escape_html(&view.at)
    ))
}

fn section(view: &View, study: &StudyView) -> Result<String, Error> {
    let name = escape_html(&study.name);
    let mut text = format!(
        "<section>\n<h2>{name}</h2>\n<p><progress value=\"{}\" max=\"{}\"></progress> {} of {} trials: {}</p>\n",
        study.done(),
        study.trials.max(1),
        study.done(),
        study.trials,
        escape_html(&study.summary())
    );
    for note in &study.notes {
        text += &format!("<p class=\"note\">{}</p>\n", escape_html(note));
    }
    text += &best(view, study);
    text += &running(study, view.metrics.first().map_or("", String::as_str));
    for metric in &view.metrics {
        let panels: Vec<&Panel> = study
            .panels
            .iter()
            .filter(|panel| panel.bounds(metric).is_some())
            .collect();
        if !panels.is_empty() {
            let chart = chart(view, &panels, metric);
            text += &format!("<h3>{}</h3>\n{}\n", escape_html(metric), figure::svg(&chart)?);
        }
    }
    Ok(text + "</section>\n")
}

/// The best of each panel so far in the first metric that it has.
fn best(view: &View, study: &StudyView) -> String {
    let of_panel = |panel: &Panel| {
        let of_metric = |metric: &'_ String| Some((metric.clone(), view.best(panel, metric)?));
        let (metric, best) = view.metrics.iter().find_map(of_metric)?;
        Some(format!(
            "<p>Best so far in {}: <b>{}</b>, {} {}</p>\n",
            escape_html(&panel.title()),
            escape_html(best.name),
            escape_html(&metric),
            best.in_words()
        ))
    };
    study.panels.iter().filter_map(of_panel).collect()
}

/// The running trials as a table with the last value of a metric; empty where none runs.
fn running(study: &StudyView, metric: &str) -> String {
    if study.running.is_empty() {
        return String::new();
    }
    let row = |it: &super::RunningView| {
        let bar = it.part().map_or_else(String::new, |part| {
            format!("<progress value=\"{part:.3}\"></progress>")
        });
        let value = it.values.get(metric);
        let value = value.map_or_else(String::new, |value| {
            format!("{} {}", escape_html(metric), in_words(*value))
        });
        format!(
            "<tr><th scope=\"row\">{}</th><td>{bar}</td><td class=\"n\">{} of {} steps</td><td class=\"n\">{value}</td>\
             <td class=\"by\">{}</td></tr>\n",
            escape_html(&it.title),
            it.step,
            it.steps,
            escape_html(&it.by)
        )
    };
    format!(
        "<table>\n{}</table>\n",
        study.running.iter().map(row).collect::<String>()
    )
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
