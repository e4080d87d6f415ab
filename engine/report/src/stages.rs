//! The graph of a study whose trials take artifacts from each other: its entries, their artifacts, and a drawing.

use super::sheet::{NONE, Sheet, SheetEntry};
use document::count::count;
use maud::{Markup, html};
use serde::Serialize;
use std::collections::BTreeSet;

/// An entry of a study: an agent, an entry of `prepare`, or a play.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Stage {
    /// Name of the entry in the study.
    pub name: String,
    /// Number of its trials.
    pub trials: usize,
    /// Number of steps from the entries that take nothing: each stage comes after those that it takes from.
    pub depth: usize,
    /// Artifacts that it takes from other entries.
    pub takes: Vec<Take>,
}

/// An artifact that an entry takes from another one.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Take {
    /// The entry that leaves it.
    pub from: String,
    /// Name of the artifact.
    #[serde(rename = "product")]
    pub artifact: String,
}

/// The entries that take an artifact or leave one that is taken.
fn connected(stages: &[Stage]) -> Vec<&Stage> {
    let leaves = |name: &str| {
        stages
            .iter()
            .flat_map(|stage| &stage.takes)
            .any(|take| take.from == name)
    };
    stages
        .iter()
        .filter(|stage| !stage.takes.is_empty() || leaves(&stage.name))
        .collect()
}

/// The graph as a sheet; `None` where no entry takes an artifact.
pub(super) fn sheet(stages: &[Stage]) -> Option<Sheet> {
    let row = |stage: &&Stage| {
        let takes: Vec<String> = stage
            .takes
            .iter()
            .map(|take| format!("{} of {}", take.artifact, take.from))
            .collect();
        let takes = if takes.is_empty() {
            NONE.into()
        } else {
            takes.join(", ")
        };
        vec![
            SheetEntry::plain(stage.name.as_str()),
            SheetEntry::plain(takes),
            SheetEntry::plain(stage.trials.to_string()),
        ]
    };
    let rows: Vec<Vec<SheetEntry>> = connected(stages).iter().map(row).collect();
    let head = ["entry", "takes", "trials"].map(String::from).into();
    (!rows.is_empty()).then(|| Sheet {
        head,
        words: 2,
        rows,
        ..Sheet::default()
    })
}

/// Sizes of the drawing, in pixels of the page.
const BOX_HEIGHT: usize = 40;
const ROW: usize = 58;
const GAP: usize = 96;
const LETTER: usize = 8;
const MARGIN: usize = 6;

/// The graph as a drawing: a box per entry, with takers after leavers; empty where no entry takes an artifact.
pub(super) fn drawing(stages: &[Stage]) -> Markup {
    let Places { boxes, size } = Places::of(stages);
    let (width, height) = size;
    let from = |at: &Box<'_>, take: &Take| {
        let is_there = |other: &&Box<'_>| other.stage.name == take.from && other.x != at.x;
        boxes.iter().find(is_there)
    };
    html! {
        @if !boxes.is_empty() {
            svg.graph role="img" aria-label="What the trials of this study take from each other"
                viewBox={ "0 0 " (width) " " (height) } style={ "max-width: " (width) "px" } {
                defs {
                    marker #tip viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto" {
                        path.tip d="M0 0L8 4L0 8z" {}
                    }
                }
                @for at in &boxes {
                    @for from in at.stage.takes.iter().filter_map(|take| from(at, take)) { (arrow(from, at)) }
                    (artifacts(at))
                }
                @for at in &boxes { (rectangle(at)) }
            }
        }
    }
}

/// A stage with the position of its box.
struct Box<'a> {
    stage: &'a Stage,
    x: usize,
    y: usize,
    width: usize,
}

struct Places<'a> {
    boxes: Vec<Box<'a>>,
    size: (usize, usize),
}

impl<'a> Places<'a> {
    /// One column per depth, each as wide as its longest name.
    fn of(stages: &'a [Stage]) -> Self {
        let shown = connected(stages);
        let deepest = shown.iter().map(|stage| stage.depth).max().unwrap_or(0);
        let (mut boxes, mut x, mut rows) = (Vec::new(), MARGIN, 0);
        for depth in 0..=deepest {
            let column: Vec<&Stage> = shown
                .iter()
                .copied()
                .filter(|stage| stage.depth == depth)
                .collect();
            let longest = column
                .iter()
                .map(|stage| stage.name.chars().count().max(9))
                .max()
                .unwrap_or(0);
            let width = longest * LETTER + 20;
            boxes.extend(column.iter().enumerate().map(|(row, stage)| Box {
                stage,
                x,
                y: MARGIN + row * ROW,
                width,
            }));
            rows = rows.max(column.len());
            x += width + GAP;
        }
        Self {
            boxes,
            size: (x - GAP + MARGIN, rows * ROW + MARGIN),
        }
    }
}

fn rectangle(at: &Box<'_>) -> Markup {
    let Box { stage, x, y, width } = at;
    let middle = x + width / 2;
    html! {
        rect x=(x) y=(y) width=(width) height=(BOX_HEIGHT) rx="5" {}
        text x=(middle) y=(y + 17) { (stage.name) }
        text.small x=(middle) y=(y + 32) { (count(stage.trials, "trial")) }
    }
}

/// Names of the artifacts of an entry, above the tips of its arrows.
fn artifacts(at: &Box<'_>) -> Markup {
    let words: BTreeSet<&str> = at.stage.takes.iter().map(|take| take.artifact.as_str()).collect();
    let words = words.into_iter().collect::<Vec<_>>().join(", ");
    let (x, y) = (at.x.saturating_sub(12), at.y + BOX_HEIGHT / 2 - 6);
    html! { text.small.end x=(x) y=(y) { (words) } }
}

fn arrow(from: &Box<'_>, to: &Box<'_>) -> Markup {
    let (x1, y1) = (from.x + from.width, from.y + BOX_HEIGHT / 2);
    let (x2, y2) = (to.x - 2, to.y + BOX_HEIGHT / 2);
    let middle = x1.midpoint(x2);
    let curve = format!("M{x1} {y1}C{middle} {y1} {middle} {y2} {x2} {y2}");
    html! { path d=(curve) marker-end="url(#tip)" {} }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stages() -> Vec<Stage> {
        let stage = |name: &str, trials, depth, takes: &[(&str, &str)]| Stage {
            name: name.into(),
            trials,
            depth,
            takes: takes
                .iter()
                .map(|(artifact, from)| Take {
                    from: (*from).into(),
                    artifact: (*artifact).into(),
                })
                .collect(),
        };
        vec![
            stage("rules", 1, 0, &[]),
            stage("half", 3, 0, &[]),
            stage("gathered", 3, 1, &[("policy", "half")]),
            stage("clone", 6, 2, &[("dataset", "gathered"), ("dataset", "rules")]),
            stage("equal <split>", 2, 0, &[]),
        ]
    }

    #[test]
    fn the_graph_leaves_out_what_stands_alone() {
        let sheet = sheet(&stages()).unwrap();
        let text: Vec<Vec<&str>> = sheet
            .rows
            .iter()
            .map(|row| row.iter().map(|entry| entry.text.as_str()).collect())
            .collect();
        assert_eq!(text[2], ["gathered", "policy of half", "3"]);
        assert_eq!(
            (text.len(), text[0][1], text[3][1]),
            (4, NONE, "dataset of gathered, dataset of rules")
        );
        assert!(super::sheet(&stages()[..1]).is_none() && drawing(&stages()[..2]).0.is_empty());
    }

    #[test]
    fn boxes_do_not_overlap_and_stand_behind_their_sources() {
        let stages = stages();
        let places = Places::of(&stages);
        let at = |name: &str| places.boxes.iter().find(|it| it.stage.name == name).unwrap();
        assert!(
            at("clone").x > at("gathered").x + at("gathered").width
                && at("gathered").x > at("half").x + at("half").width
        );
        assert!(at("half").y >= at("rules").y + BOX_HEIGHT);
        let svg = drawing(&stages).into_string();
        assert_eq!(
            (svg.matches("<rect").count(), svg.matches("marker-end").count()),
            (4, 3),
            "{svg}"
        );
    }
}
