//! Interactive learning curves of a page: their lines as data, and the scripts that plot them. All of it is inside
//! the page, and the page is complete without it.

use maud::{Markup, PreEscaped, html};
use presentation::figure::{Chart, plot_data};
use serde_json::Value;

/// Rules of uPlot 1.6.32 as published.
pub(super) const STYLE: &str = concat!(include_str!("../assets/uplot/uPlot.min.css"), "\n");
const UPLOT: &str = include_str!("../assets/uplot/uPlot.iife.min.js");
const LICENCE: &str = include_str!("../assets/uplot/LICENSE.txt");
const OWN: &str = include_str!("page.js");

/// The lines of a chart as data.
pub(super) struct Lines(Value);

impl Lines {
    /// The lines of learning curves; `None` for any other chart.
    pub(super) fn of(chart: &Chart) -> Option<Self> {
        plot_data(chart).map(Self)
    }

    /// The element that holds the data. No text in the data can end it.
    pub(super) fn element(&self) -> Markup {
        let data = self.0.to_string().replace('<', "\\u003c");
        html! { script.lines type="application/json" { (PreEscaped(data)) } }
    }
}

/// uPlot with its licence, and the page's own script.
pub(super) fn script() -> Markup {
    // The first line of the published file is a comment with an address; the script states name and licence itself.
    let uplot = UPLOT.split_once('\n').map_or(UPLOT, |(_, code)| code);
    let code = format!("\n/* uPlot 1.6.32\n\n{LICENCE}\n*/\n{uplot}\n{OWN}");
    html! { script { (PreEscaped(code)) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_the_published_file() {
        let digests = [UPLOT, LICENCE].map(|text| contract::digest::of_bytes(text.as_bytes()));
        assert_eq!(
            digests,
            [
                "ea2d16ff65797375a846049c0f0a17f6",
                "80723da02446eaf6792b975295c3447a"
            ]
        );
        assert!(
            UPLOT.starts_with("/*! ") && UPLOT.lines().next().is_some_and(|line| line.contains("1.6.32"))
        );
    }

    #[test]
    fn no_script_ends_early_or_names_an_address() {
        let script = script().into_string();
        assert_eq!(
            (
                script.matches("<script").count(),
                script.matches("</script").count()
            ),
            (1, 1)
        );
        assert!(!script.contains("<!--") && !script.contains("http"));
        let lines = Lines(serde_json::json!({ "title": "</script><!--" }));
        let element = lines.element().into_string();
        assert_eq!(
            (
                element.matches("</script").count(),
                element.matches("<!--").count()
            ),
            (1, 0)
        );
    }
}
