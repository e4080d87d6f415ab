//! Graphs of designs: marks lie on the paper, and no line meets a box.

use super::{
    DOUBLE, MARGIN, SINGLE, Sketch,
    arrangement::{Arrangement, Flow},
    places::{NodeBox, Places, Span},
    routes::{self, Route},
    ways::{ArrowRouting, Routing},
};
use crate::figure::paint::Mark;
use contract::drawing::{Edge, Graph, Node};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// A graph that grows along its flow.
#[derive(Default)]
struct GraphBuilder(Graph);

impl GraphBuilder {
    fn node(&mut self, label: &str, group: &str) -> usize {
        let column = u32::try_from(self.0.nodes.len()).unwrap();
        self.0.nodes.push(Node {
            label: label.into(),
            column,
            lane: 0,
            group: group.into(),
        });
        self.0.nodes.len() - 1
    }

    /// A node behind the last one.
    fn then(&mut self, label: &str, group: &str) -> usize {
        let from = self.0.nodes.len() - 1;
        let to = self.node(label, group);
        self.edge(from, to, "", false);
        to
    }

    fn edge(&mut self, from: usize, to: usize, label: &str, bypass: bool) {
        self.0.edges.push(Edge {
            from,
            to,
            label: label.into(),
            bypass,
        });
    }
}

/// A generator of three cells, each twice an upsampling, a convolution, batch normalisation and a rectifier,
/// with a shortcut, and a skip from the first cell to the third.
pub(in crate::figure) fn generator() -> Graph {
    let mut graph = GraphBuilder::default();
    graph.node("z", "");
    let mut last = graph.then("linear 4×4", "");
    let mut sums = Vec::new();
    for cell in ["cell 1", "cell 2", "cell 3"] {
        for _ in 0..2 {
            for label in ["up 2×", "conv 3×3", "BN", "ReLU"] {
                graph.then(label, cell);
            }
        }
        let sum = graph.then("+", cell);
        graph.edge(last, sum, "", true);
        sums.push(sum);
        last = sum;
    }
    graph.edge(sums[0], sums[2], "", true);
    for label in ["BN", "ReLU", "conv 3×3", "tanh"] {
        graph.then(label, "head");
    }
    graph.0
}

/// A cell with branches side by side, named shortcuts, and an entry of its own: it fits into one line.
pub(in crate::figure) fn cell() -> Graph {
    let mut graph = GraphBuilder::default();
    let input = graph.node("in", "");
    for label in ["conv 3×3", "BN", "ReLU"] {
        graph.then(label, "cell");
    }
    let sum = graph.then("+", "cell");
    graph.edge(input + 1, sum, "1×1", true);
    let side = graph.0.nodes.len();
    graph.0.nodes.push(Node {
        label: "conv 5×5".into(),
        column: 2,
        lane: 1,
        group: "cell".into(),
    });
    graph.edge(input + 1, side, "", false);
    graph.edge(side, sum, "", false);
    let out = graph.node("out", "");
    graph.edge(sum, out, "", false);
    graph.edge(input, out, "", true);
    graph.0
}

/// Cells with an entry, branches side by side and shortcuts of their own, and named skips between them: folded, with
/// every kind of routing.
pub(in crate::figure) fn branched() -> Graph {
    let mut graph = GraphBuilder::default();
    let mut last = graph.node("x", "");
    let mut sums = Vec::new();
    for cell in ["cell 1", "cell 2", "cell 3"] {
        let entry = graph.then("up 2×", cell);
        for label in ["conv 3×3", "BN", "ReLU", "conv 3×3", "BN"] {
            graph.then(label, cell);
        }
        let sum = graph.then("+", cell);
        graph.edge(entry, sum, "1×1", true);
        let side = graph.0.nodes.len();
        graph.0.nodes.push(Node {
            label: "dilated conv 5×5, separable".into(),
            column: graph.0.nodes[entry + 2].column,
            lane: 1,
            group: cell.into(),
        });
        graph.edge(entry + 1, side, "", false);
        graph.edge(side, sum, "", false);
        last = graph.node("ReLU", cell);
        graph.edge(sum, last, "", false);
        sums.push(last);
    }
    graph.edge(sums[0], sums[2], "skip", true);
    graph.edge(0, last, "long skip", true);
    graph.0
}

/// Arrangement, routing, places and routes of a graph as it is drawn.
fn placed(graph: &Graph) -> (Arrangement, Routing, Places, Vec<Route>) {
    let fits =
        |arrangement: &Arrangement| Sketch::arranged(graph, arrangement).width <= DOUBLE - 2.0 * MARGIN;
    let mut last = None;
    for arrangement in Arrangement::all(graph) {
        let found = fits(&arrangement);
        last = Some(arrangement);
        if found {
            break;
        }
    }
    let arrangement = last.unwrap();
    let ways = Routing::of(graph, &arrangement);
    let places = Places::of(graph, &arrangement, &ways);
    let routes = routes::all(graph, &arrangement, &ways, &places);
    (arrangement, ways, places, routes)
}

fn overlap(one: Span, other: Span) -> bool {
    one.low < other.high - 0.01 && other.low < one.high - 0.01
}

/// Whether a line runs through the inside of a box.
fn meets(route: &Route, node: &NodeBox) -> bool {
    let inside = |along: f64, across: f64| {
        let within = |span: Span, at: f64| at > span.low + 0.05 && at < span.high - 0.05;
        within(node.along, along) && within(node.across, across)
    };
    route.points.windows(2).any(|ends| {
        (0..=64).any(|step| {
            let t = f64::from(step) / 64.0;
            let mix = |from: f64, to: f64| from + (to - from) * t;
            inside(mix(ends[0].0, ends[1].0), mix(ends[0].1, ends[1].1))
        })
    })
}

fn hold(graph: &Graph) {
    let (_, _, places, routes) = placed(graph);
    for (one, node) in places.boxes.iter().enumerate() {
        for (other, beside) in places.boxes.iter().enumerate().skip(one + 1) {
            assert!(
                !(overlap(node.along, beside.along) && overlap(node.across, beside.across)),
                "boxes {one} and {other} overlap"
            );
        }
        for (edge, route) in routes.iter().enumerate() {
            let ends = &graph.edges[edge];
            assert!(
                one == ends.from || one == ends.to || !meets(route, node),
                "edge {edge} runs through box {one}: {route:?}"
            );
        }
    }
    let sketch = Sketch::of(graph, DOUBLE - 2.0 * MARGIN);
    assert!(sketch.width <= DOUBLE - 2.0 * MARGIN + 0.01 && sketch.height <= 640.01);
}

#[test]
fn a_generator_is_folded_into_its_cells() {
    let graph = generator();
    graph.check().unwrap();
    let (arrangement, ways, ..) = placed(&graph);
    let lengths: Vec<usize> = arrangement.stacks.iter().map(ExactSizeIterator::len).collect();
    assert_eq!((arrangement.flow, lengths), (Flow::Down, vec![2, 9, 9, 9, 4]));
    // Shortcuts lead into the next stack, the skip around the second cell.
    assert_eq!(
        ways.ways.iter().filter(|way| **way == ArrowRouting::Over).count(),
        4 + 3 + 1
    );
    hold(&graph);
}

#[test]
fn a_cell_fits_into_one_line_of_one_column() {
    let graph = cell();
    graph.check().unwrap();
    let (arrangement, ways, places, _) = placed(&graph);
    assert_eq!(arrangement.flow, Flow::Right);
    assert_eq!(ways.beside, [(1, 1)]);
    assert!(places.frames[0].across.low < places.beside(0, 0, true));
    assert!(places.frames[0].across.low > places.beside(0, 0, false));
    assert!(Sketch::of(&graph, DOUBLE - 2.0 * MARGIN).width > SINGLE);
    hold(&graph);
}

#[test]
fn branches_and_skips_keep_apart_where_the_flow_is_folded() {
    let graph = branched();
    graph.check().unwrap();
    let (arrangement, ways, ..) = placed(&graph);
    assert_eq!((arrangement.flow, arrangement.stacks.len()), (Flow::Down, 4));
    assert_eq!(ways.beside, [(0, 0), (1, 0), (1, 0), (1, 0)]);
    hold(&graph);
}

/// The colours that fill the boxes with this label.
fn fills(graph: &Graph, label: &str) -> BTreeSet<(u8, u8, u8)> {
    let alone = |label: &str| {
        let kept = graph.nodes.iter().filter(|node| node.label == label).cloned();
        Graph {
            nodes: kept.collect(),
            edges: Vec::new(),
            operations: graph.operations.clone(),
        }
    };
    let marks = Sketch::of(&alone(label), DOUBLE).marks;
    let fills = marks.into_iter().filter_map(|mark| match mark {
        Mark::Fill { color, .. } => Some(color),
        _ => None,
    });
    fills.collect()
}

#[test]
fn an_operation_that_is_foreseen_has_one_colour_in_every_graph() {
    let row = |labels: &[&str]| {
        let mut graph = GraphBuilder::default();
        graph.node("start", "");
        labels.iter().for_each(|label| {
            graph.then(label, "");
        });
        graph.0.operations = ["conv", "BN", "IN"].map(String::from).to_vec();
        graph.0
    };
    let (often, rarely) = (
        row(&["BN", "BN", "conv 3×3"]),
        row(&["conv 3×3", "conv 3×3", "BN"]),
    );
    assert_eq!(fills(&often, "BN"), fills(&rarely, "BN"));
    assert_eq!(fills(&often, "conv 3×3"), fills(&rarely, "conv 3×3"));
    assert_ne!(fills(&often, "BN"), fills(&often, "conv 3×3"));
    assert_ne!(
        fills(&often, "BN"),
        fills(&often, "start"),
        "what is not foreseen is grey"
    );
}

#[test]
fn columns_and_lanes_count_by_their_order_alone() {
    let node = |column, lane| Node {
        label: "a".into(),
        column,
        lane,
        group: String::new(),
    };
    let graph = |nodes: Vec<Node>| Graph {
        nodes,
        edges: vec![Edge {
            to: 1,
            ..Edge::default()
        }],
        ..Graph::default()
    };
    let near = graph(vec![node(0, 0), node(1, 1)]);
    let far = graph(vec![node(7, -2_000_000_000), node(u32::MAX, 2_000_000_000)]);
    let widths = [near, far].map(|graph| Sketch::of(&graph, DOUBLE - 2.0 * MARGIN).width);
    assert_eq!(widths[0], widths[1]);
}

#[test]
fn what_fits_no_page_is_drawn_smaller() {
    let mut graph = GraphBuilder::default();
    for node in 0..40 {
        graph.node("a label of some length", "");
        graph.0.nodes[node].column = 0;
        graph.0.nodes[node].lane = i32::try_from(node).unwrap();
    }
    hold(&graph.0);
    let mut tall = GraphBuilder::default();
    tall.node("first", "one");
    for _ in 0..60 {
        tall.then("and the next", "one");
    }
    hold(&tall.0);
}

/// A graph of at most 24 nodes with arrows between any of them.
fn graphs() -> impl Strategy<Value = Graph> {
    let node = (0_u32..12, -2_i32..3, 0_usize..3, 0_usize..4);
    let nodes = proptest::collection::vec(node, 2..24);
    let edges = proptest::collection::vec((0_usize..24, 0_usize..24, any::<bool>(), any::<bool>()), 0..30);
    (nodes, edges).prop_map(|(nodes, edges)| {
        let mut taken = BTreeSet::new();
        let kept = nodes.into_iter().filter(|it| taken.insert((it.0, it.1)));
        let nodes: Vec<Node> = kept
            .map(|(column, lane, label, group)| Node {
                label: ["+", "conv 3×3", "a long label that is broken into lines"][label].into(),
                column,
                lane,
                // Groups of neighbouring columns, as designs have them.
                group: if group == 0 {
                    String::new()
                } else {
                    format!("cell {}", column / 4)
                },
            })
            .collect();
        let count = nodes.len();
        let edge = |(one, other, bypass, named): (usize, usize, bool, bool)| {
            let (one, other) = (one % count, other % count);
            let (from, to) = if nodes[one].column < nodes[other].column {
                (one, other)
            } else {
                (other, one)
            };
            (nodes[from].column < nodes[to].column).then(|| Edge {
                from,
                to,
                label: if named { "1×1".into() } else { String::new() },
                bypass,
            })
        };
        let edges = edges.into_iter().filter_map(edge).collect();
        Graph {
            nodes,
            edges,
            ..Graph::default()
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn boxes_stand_apart_and_arrows_run_around_them(graph in graphs()) {
        graph.check().unwrap();
        hold(&graph);
    }
}
