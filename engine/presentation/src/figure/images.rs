//! Images: samples of generators, a grid of them per agent.

use super::{
    Figure, FigureSpec,
    build::{Context, problem},
    chart::Chart,
    drawn::{DrawnTrials, panel},
    shape::{Shape, Tiles},
};
use crate::kinds::KindSpec;
use crate::names::{Names, Place};
use contract::{ArtifactKind, Error, drawing::Drawings, trial_result::TrialResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Samples that trials left as images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Images {
    /// Agents to show, one panel each; all where empty.
    pub agents: Vec<String>,
    /// Environment to show; the first where absent.
    pub environment: Option<String>,
    /// Seed to show; the lowest where absent.
    pub seed: Option<u64>,
    /// Rows of images in a panel; fewer if a trial left fewer images.
    #[schemars(range(min = 1, max = 100))]
    pub rows: usize,
    /// Images in a row.
    #[schemars(range(min = 1, max = 100))]
    pub columns: usize,
    /// The side of an image on paper; as large as the room allows where absent.
    #[schemars(range(min = 1.0, max = 80.0), extend("x-unit" = "mm"))]
    pub size_mm: Option<f64>,
}

impl Default for Images {
    fn default() -> Self {
        Self {
            agents: Vec::new(),
            environment: None,
            seed: None,
            rows: 6,
            columns: 6,
            size_mm: None,
        }
    }
}

impl KindSpec for Images {
    fn name() -> &'static str {
        "images"
    }

    fn about() -> &'static str {
        "Samples that trials left as images, a grid of them per agent."
    }

    fn example() -> &'static str {
        "{ agents: [learner], environment: short, rows: 2, columns: 3 }"
    }
}

impl Figure for Images {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = names.pick(at).of_one_environment();
        names.leaves(ArtifactKind::Images, at, &picked);
        names.seed(self.seed, at);
    }

    fn shows(&self) -> Option<ArtifactKind> {
        Some(ArtifactKind::Images)
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let choice = DrawnTrials {
            agents: &self.agents,
            environment: self.environment.as_ref(),
            seed: self.seed,
        };
        let kind = ArtifactKind::Images;
        let found = choice.find(kind, spec, context, |drawings| !drawings.images.is_empty());
        if found.trials.is_empty() {
            return Err(problem(&format!(
                "no trial has left images: {}",
                found.missing.join(" ")
            )));
        }
        let titled = found.trials.len() > 1;
        let of_trial = |(name, trial, drawings): &(String, &TrialResult, &Drawings)| {
            let title = if titled { name.clone() } else { String::new() };
            panel(title, Shape::Images(self.tiles(trial, drawings)))
        };
        let panels: Vec<_> = found.trials.iter().map(of_trial).collect();
        let mut notes = vec![self.note(&found.place, &found.trials)];
        notes.extend(found.missing);
        Ok(Chart {
            columns: if panels.len() == 4 { 2 } else { panels.len().min(3) },
            panels,
            notes,
            ..Chart::default()
        })
    }
}

impl Images {
    fn tiles(&self, trial: &TrialResult, drawings: &Drawings) -> Tiles {
        let shown = drawings.images.iter().take(self.rows * self.columns);
        Tiles {
            trial: trial.trial.id.clone(),
            images: shown.cloned().collect(),
            columns: self.columns,
            size_mm: self.size_mm,
        }
    }

    /// Sentence on the number of images that are shown, as in `The first 36 of 100 images of seed 0 in short.`
    fn note(&self, place: &str, trials: &[(String, &TrialResult, &Drawings)]) -> String {
        let counts = || trials.iter().map(|(.., drawings)| drawings.images.len());
        let (low, high) = (counts().min().unwrap_or(0), counts().max().unwrap_or(0));
        let shown = self.rows * self.columns;
        match (low == high, high <= shown) {
            (_, true) => format!("All images of {place}."),
            (true, false) => format!("The first {shown} of {high} images of {place}."),
            (false, false) => format!("At most the first {shown} images of {place}."),
        }
    }
}
