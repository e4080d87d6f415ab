//! Drawings on disk: written ones are read back, and files that are no drawings are refused by name.

use super::*;
use crate::{Environment, Rng, Seat, Step, protocol::leave_drawings};
use serde_json::{Value, json};

fn image(side: u32, value: u8) -> Image {
    let pixels = (0..3 * side * side)
        .map(|at| value.wrapping_add(at as u8))
        .collect();
    Image {
        width: side,
        height: side,
        pixels,
    }
}

fn graph() -> Graph {
    let node = |label: &str, column, lane| Node {
        label: label.into(),
        column,
        lane,
        group: "cell 1".into(),
    };
    let edge = |from, to, bypass| Edge {
        from,
        to,
        label: String::new(),
        bypass,
    };
    Graph {
        nodes: vec![node("conv 3×3", 2, 0), node("BN", 5, -1), node("+", 9, 0)],
        edges: vec![edge(0, 1, false), edge(1, 2, false), edge(0, 2, true)],
        operations: vec!["conv".into(), "BN".into()],
    }
}

#[test]
fn what_is_written_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let images = vec![image(5, 0), image(5, 90), image(5, 200)];
    graph().write(folder.path()).unwrap();
    Image::write_all(&images, folder.path()).unwrap();
    let mut drawings = Drawings::default();
    for kind in ArtifactKind::ALL {
        drawings.read(kind, folder.path()).unwrap();
    }
    let expected = Drawings {
        graph: Some(graph()),
        images,
        problem: None,
    };
    assert_eq!(drawings, expected);
    let bytes = || fs::read(folder.path().join(IMAGES_FILE)).unwrap();
    let first = bytes();
    Image::write_all(&expected.images, folder.path()).unwrap();
    assert!(first == bytes() && first.starts_with(b"\x89PNG"));
}

#[test]
fn a_graph_that_cannot_be_drawn_is_refused() {
    let changed = |change: fn(&mut Graph)| {
        let mut graph = graph();
        change(&mut graph);
        graph.check().unwrap_err()
    };
    assert_eq!(changed(|graph| graph.nodes.clear()), DrawingError::NoNode);
    let missing = changed(|graph| graph.edges[1].to = 3);
    let expected = DrawingError::NoSuchNode {
        edge: 1,
        node: 3,
        nodes: 3,
    };
    assert_eq!(missing, expected);
    assert_eq!(
        missing.to_string(),
        "edge 1 names node 3, but the nodes are 0 to 2"
    );
    let back = changed(|graph| graph.edges[2].from = 2);
    assert!(matches!(
        back,
        DrawingError::AgainstTheFlow {
            edge: 2,
            from: 9,
            to: 9
        }
    ));
    let same = changed(|graph| (graph.nodes[1].column, graph.nodes[1].lane) = (2, 0));
    assert!(matches!(
        same,
        DrawingError::SamePlace {
            one: 0,
            other: 1,
            column: 2,
            lane: 0
        }
    ));
}

#[test]
fn images_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |images: &[Image]| match Image::write_all(images, folder.path()) {
        Err(Error::Drawing(why)) => why,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&[]), DrawingError::NoPixel);
    assert_eq!(refused(&[image(0, 0)]), DrawingError::NoPixel);
    let unequal = refused(&[image(4, 0), image(3, 0)]);
    assert!(matches!(
        unequal,
        DrawingError::Size {
            number: 1,
            width: 3,
            side: 4,
            ..
        }
    ));
    let short = Image {
        pixels: vec![0; 47],
        ..image(4, 0)
    };
    assert!(matches!(
        refused(&[short]),
        DrawingError::Pixels {
            expected: 48,
            found: 47,
            ..
        }
    ));
    assert!(!folder.path().join(IMAGES_FILE).exists());
}

/// A PNG file of these pixels.
fn png_of(color: png::ColorType, (width, height): (u32, u32), pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(pixels).unwrap();
    writer.finish().unwrap();
    bytes
}

#[test]
fn a_file_of_another_form_is_refused_by_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8]| {
        fs::write(folder.path().join(name), bytes).unwrap();
        let mut drawings = Drawings::default();
        let kind = if name == GRAPH_FILE {
            ArtifactKind::Graph
        } else {
            ArtifactKind::Images
        };
        let error = drawings.read(kind, folder.path()).unwrap_err();
        assert!(
            matches!(error, Error::Damaged { .. }) && error.to_string().contains(name),
            "{error}"
        );
        error.to_string()
    };
    let whole = image(4, 7).png().unwrap();
    for (bytes, why) in [
        (&b"no picture"[..], "Invalid PNG signature"),
        (&whole[..whole.len() / 2], "is damaged"),
        (
            &png_of(png::ColorType::Grayscale, (2, 2), &[0; 4]),
            "not RGB of 8 bits",
        ),
        (
            &png_of(png::ColorType::Rgb, (2, 3), &[0; 18]),
            "no whole number of squares",
        ),
    ] {
        let message = refused(IMAGES_FILE, bytes);
        assert!(message.contains(why), "{message}");
    }
    let mut claims_much = png_of(png::ColorType::Rgb, (1, 1), &[0; 3]);
    claims_much[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    refused(IMAGES_FILE, &claims_much);
    let other_keys = json!({"nodes": [], "edges": [], "colour": 1}).to_string();
    for text in ["{", other_keys.as_str(), r#"{"nodes":[],"edges":[]}"#] {
        refused(GRAPH_FILE, text.as_bytes());
    }
    assert!(matches!(
        Graph::read(&folder.path().join("none")),
        Err(Error::File { .. })
    ));
}

#[test]
fn a_mean_colour_is_that_of_all_pixels() {
    let image = Image {
        width: 1,
        height: 2,
        pixels: vec![10, 0, 255, 20, 0, 0],
    };
    assert_eq!(image.mean_color(), [15.0, 0.0, 127.5]);
}

/// An environment with drawings, or none.
struct Drawer(Option<Graph>, Vec<Image>);

impl Environment for Drawer {
    fn seats(&self) -> &[Seat] {
        &[]
    }
    fn reset(&mut self, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        Ok(Vec::new())
    }
    fn step(&mut self, _: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        Err(Error::Stopped)
    }
    fn trace_channels(&self) -> Vec<crate::Channel> {
        Vec::new()
    }
    fn trace(&self) -> Vec<f64> {
        Vec::new()
    }
    fn graph(&self) -> Option<Graph> {
        self.0.clone()
    }
    fn images(&mut self) -> Result<Vec<Image>, Error> {
        Ok(self.1.clone())
    }
    fn snapshot(&self) -> Value {
        Value::Null
    }
    fn restore(&mut self, _: &Value) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn an_environment_leaves_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let left = |graph, images| leave_drawings(&mut Drawer(graph, images), folder.path());
    assert_eq!(left(None, Vec::new()).unwrap(), []);
    assert!(ArtifactKind::ALL.iter().all(|kind| !kind.lies_in(folder.path())));
    let both = left(Some(graph()), vec![image(3, 1)]).unwrap();
    assert_eq!(both, [ArtifactKind::Graph, ArtifactKind::Images]);
    assert!(both.iter().all(|kind| kind.lies_in(folder.path())));
    assert!(matches!(
        left(Some(Graph::default()), Vec::new()),
        Err(Error::Drawing(_))
    ));
    let nowhere = leave_drawings(
        &mut Drawer(Some(graph()), Vec::new()),
        &folder.path().join("none"),
    );
    assert!(matches!(nowhere, Err(Error::Store { .. })));
}
