//! Importance of the keys of a search.

use super::{
    Figure, FigureSpec,
    build::{Context, count, label, problem, spaced},
    chart::{Chart, Panel, Point, Scale, Series, Style},
    searched::{CompletedSettings, key_names},
    shape::Shape,
};
use crate::{
    kinds::KindSpec,
    names::{Names, Place},
    vocabulary::Vocabulary,
};
use analysis::search::importance::{FEWEST, Importance, TREES, importance};
use contract::Error;
use document::count::count as count_in_words;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Importance of each key of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportanceFigure {
    /// The search.
    pub search: String,
    /// Number of times that the values of each key are exchanged.
    #[serde(default = "twenty")]
    #[schemars(range(min = 2, max = 1000))]
    pub exchanges: usize,
}

fn twenty() -> usize {
    20
}

/// Share of the variance below which a forest explains too little for its importances to count.
const LITTLE: f64 = 0.2;

impl KindSpec for ImportanceFigure {
    fn name() -> &'static str {
        "importance"
    }

    fn about() -> &'static str {
        "How much each key of a search matters: what a forest's forecast loses without it."
    }

    fn example() -> &'static str {
        "{ search: learner_rates }"
    }
}

impl Figure for ImportanceFigure {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let Some(search) = names.search(&self.search, at) else {
            return;
        };
        if search.ends < FEWEST {
            let (name, ends) = (&search.name, count_in_words(search.ends, "setting"));
            let message =
                format!("`{name}` has at most {ends} that go to their ends; `importance` takes {FEWEST}");
            let help = "give the search more `settings`, in a profile too";
            names.say(at.value("search"), message, help);
        }
    }

    fn further_names(&self, vocabulary: &Vocabulary) -> Vec<String> {
        key_names(&self.search, vocabulary)
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let searched = CompletedSettings::of(&self.search, context)?;
        let found = importance(&searched.shares, &searched.values, self.exchanges, &self.search)?;
        let too_few = || {
            problem(&format!(
                "it takes at least {FEWEST} settings that went to their ends and differ"
            ))
        };
        Ok(chart(
            &searched,
            &found.ok_or_else(too_few)?,
            self.exchanges,
            spec,
        ))
    }
}

fn chart(searched: &CompletedSettings<'_>, found: &Importance, exchanges: usize, spec: &FigureSpec) -> Chart {
    let bar = |(place, (mean, deviation)): (usize, &(f64, f64))| Point {
        x: count(place),
        y: 100.0 * mean,
        interval: Some((100.0 * (mean - deviation), 100.0 * (mean + deviation))),
    };
    let panel = Panel {
        x: Scale {
            categories: searched.keys().iter().map(|key| label(spec, key)).collect(),
            ..Scale::default()
        },
        y: Scale {
            label: "loss (% of variance)".into(),
            includes: vec![0.0],
            ..Scale::default()
        },
        series: vec![Series {
            label: String::new(),
            seeds: None,
            style: Style::default(),
            shape: Shape::Bars(found.keys.iter().enumerate().map(bar).collect(), 0.6),
        }],
        ..Panel::default()
    };
    Chart {
        panels: vec![panel],
        columns: 1,
        notes: notes(searched, found, exchanges),
        ..Chart::default()
    }
}

fn notes(searched: &CompletedSettings<'_>, found: &Importance, exchanges: usize) -> Vec<String> {
    let (settings, by) = (searched.values.len(), spaced(&searched.result.search.metric));
    let explained = 100.0 * found.explained;
    let how = format!(
        "A forest of {TREES} trees forecasts the {by} of settings that it has not seen ({settings} settings, in \
         fifths); bars are what it loses \
         when the values of a key are exchanged, mean and standard deviation over {exchanges} exchanges."
    );
    let what = if found.explained < LITTLE {
        format!("It explains {explained:.0} % of the variance, too little for its importances to say much.")
    } else {
        format!("It explains {explained:.0} % of the variance.")
    };
    vec![how, what]
}
