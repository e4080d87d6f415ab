//! Figures of artifacts: their data by snapshot, their drawing by properties.

use super::{
    Chart, Context, FigureSpec, GraphFigure, Images, build,
    graph_drawing::tests::{branched, cell, generator},
    is_wide, layout,
    paint::Mark,
    png, svg,
    tests::{chart, names, with_options},
};
use analysis::results::Results;
use contract::drawing::{Drawings, Image};
use std::collections::BTreeMap;
use testing::synthetic::noise;
use testing::synthetic::study;

/// Figures for inspection by eye.
pub(super) fn pictures() -> [(&'static str, Chart); 4] {
    let results = with_drawings();
    [
        ("images", chart(&images(), &results)),
        ("graph", chart(&graph(&["equal"]), &results)),
        ("branched", chart(&graph(&["bound"]), &results)),
        ("graphs", chart(&graph(&["equal", "dsac"]), &results)),
    ]
}

/// Drawings of some agents that one seed left, in a study in which one agent's trial failed.
fn with_drawings() -> Results {
    let mut results = Results::of(
        study()
            .trials
            .into_iter()
            .filter(|trial| trial.trial.cell.environment == "eight_cells")
            .collect(),
    );
    for (index, agent) in ["equal", "dsac", "bound"].into_iter().enumerate() {
        let trial = results
            .trials
            .iter()
            .find(|it| it.trial.cell.agent == agent && it.trial.key.seed == 3);
        let drawings = Drawings {
            graph: [generator, cell, branched].map(|of| of()).into_iter().nth(index),
            images: (0..if index < 2 { 40 } else { 0 })
                .map(|number| scene(32, number, index as u64))
                .collect(),
            problem: None,
        };
        if let Some(trial) = trial.filter(|it| it.is_ok()) {
            results.drawings.insert(trial.trial.id.clone(), drawings);
        }
    }
    results
}

/// Ground and sky in two colours with a disc and a grain.
fn scene(side: u32, number: u64, kind: u64) -> Image {
    let draw = |what: u64| 0.5 + 0.5 * noise(number, kind, what);
    let color = |what: u64| [0, 1, 2].map(|channel| 255.0 * draw(10 * what + channel));
    let (sky, ground, disc) = (color(1), color(2), color(3));
    let of = |x: u32, y: u32| {
        let (u, v) = (f64::from(x) / f64::from(side), f64::from(y) / f64::from(side));
        let near = (u - draw(1)).hypot(v - draw(2)) < 0.1 + 0.2 * draw(3);
        let plain = if near {
            disc
        } else if v > 0.4 + 0.3 * draw(4) {
            ground
        } else {
            sky
        };
        plain.map(|value| (value + 20.0 * noise(u64::from(x), u64::from(y), number)).clamp(0.0, 255.0) as u8)
    };
    let pixels = (0..side).flat_map(|y| (0..side).flat_map(move |x| of(x, y)));
    Image {
        width: side,
        height: side,
        pixels: pixels.collect(),
    }
}

fn images() -> FigureSpec {
    let kind = Images {
        agents: names(&["equal", "dsac", "ddpg", "bound"]),
        seed: Some(3),
        ..Images::default()
    };
    FigureSpec::of(kind)
}

fn graph(agents: &[&str]) -> FigureSpec {
    let kind = GraphFigure {
        agents: names(agents),
        seed: Some(3),
        ..GraphFigure::default()
    };
    FigureSpec::of(kind)
}

#[test]
fn images_are_shown_with_what_is_missing() {
    let spec = images();
    let results = with_drawings();
    let all = chart(&spec, &results);
    assert_eq!((all.panels.len(), all.columns), (2, 2));
    assert_eq!(all.panels[1].title, "dsac");
    assert_eq!(
        all.notes,
        [
            "The first 36 of 40 images of seed 3 in eight_cells.",
            "ddpg is missing: its trial ended as oom.",
            "bound is missing: its trial left no images."
        ]
    );
    let csv = all.csv().unwrap();
    assert_eq!(csv.lines().count(), 1 + 2 * 36);
    insta::assert_snapshot!("images", csv.lines().step_by(12).collect::<Vec<_>>().join("\n"));
    let larger = with_options(&spec, |kind: &mut Images| (kind.rows, kind.columns) = (9, 5));
    assert_eq!(
        chart(&larger, &results).notes[0],
        "All images of seed 3 in eight_cells."
    );
}

#[test]
fn pixels_of_images_stay_squares_in_both_formats() {
    let results = with_drawings();
    let chart = chart(&images(), &results);
    let text = svg(&chart).unwrap();
    assert_eq!(text.matches("image-rendering:pixelated").count(), 72);
    assert!(text.ends_with("</svg>\n") && !super::tests::has_nan(&text));
    let drawing = layout::draw(&chart);
    let first = drawing.marks.iter().find_map(|mark| match mark {
        Mark::Image { corner, side, image } => Some((*corner, *side, image)),
        _ => None,
    });
    let (corner, side, image) = first.unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("images.png");
    png(&chart, &path).unwrap();
    let mut reader = png::Decoder::new(std::fs::File::open(&path).unwrap())
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let whole = |length: f64| (4.0 * length).round() as usize;
    let (left, top, times) = (whole(corner.0), whole(corner.1), whole(side) / 32);
    assert!(times > 1 && whole(side) == 32 * times);
    for (x, y) in (0..32 * times).flat_map(|x| (0..32 * times).map(move |y| (x, y))) {
        let drawn = 3 * ((top + y) * info.width as usize + left + x);
        let from = 3 * (y / times * 32 + x / times);
        assert_eq!(pixels[drawn..drawn + 3], image.pixels[from..from + 3], "{x} {y}");
    }
}

#[test]
fn a_graph_is_drawn_with_its_nodes_and_edges_as_data() {
    let results = with_drawings();
    let one = chart(&graph(&["equal"]), &results);
    assert_eq!(
        one.notes,
        ["The design of seed 3 in eight_cells. Dashed arrows bypass what lies between their ends."]
    );
    insta::assert_snapshot!("graph", chart(&graph(&["dsac"]), &results).csv().unwrap());
    let both = layout::draw(&chart(&graph(&["equal", "dsac"]), &results));
    assert!(both.height > layout::draw(&one).height && is_wide(&one));
    let texts: Vec<&str> = both
        .marks
        .iter()
        .filter_map(|mark| match mark {
            Mark::Text { text, .. } => Some(text.as_str()),
            _ => None,
        })
        .collect();
    for (text, times) in [("equal", 1), ("dsac", 1), ("cell 2", 1), ("up 2×", 6), ("1×1", 1)] {
        assert_eq!(texts.iter().filter(|it| **it == text).count(), times, "{text}");
    }
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let mut results = with_drawings();
    let dsac = results
        .trials
        .iter()
        .find(|it| it.trial.cell.agent == "dsac" && it.trial.key.seed == 3);
    let id = dsac.unwrap().trial.id.clone();
    let drawings = Drawings {
        problem: Some("`graph.json` is damaged".into()),
        ..Drawings::default()
    };
    results.drawings.insert(id, drawings);
    let chart = chart(&graph(&["equal", "dsac"]), &results);
    assert_eq!(chart.notes[1], "dsac is missing: `graph.json` is damaged.");
}

#[test]
fn nothing_to_draw_is_said() {
    let (results, units) = (study(), BTreeMap::new());
    let context = Context {
        results: &results,
        agents: &[],
        units: &units,
        better: &BTreeMap::new(),
    };
    let message = build(&graph(&["dsac"]), context).unwrap_err().to_string();
    assert!(
        message.contains("no trial has left a graph: dsac is missing: its trial left no graph."),
        "{message}"
    );
}
