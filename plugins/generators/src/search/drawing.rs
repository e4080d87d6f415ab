//! Drawing of a generator as a graph: its operations one after the other, shortcuts and skips beside them.

use crate::architecture::{CellArchitecture, N_CELLS, Normalisation, Order, Upsampling};
use contract::drawing::{Edge, Graph, Node};

/// Kinds of boxes in the drawing. Those that an architecture decides come first; the others stay grey.
const OPERATIONS: [&str; 9] = [
    "conv", "BN", "IN", "bilinear", "nearest", "deconv", "ReLU", "linear", "tanh",
];

/// The graph of a generator with these cells.
pub(super) fn graph(cells: &[CellArchitecture; N_CELLS]) -> Graph {
    let mut drawn = GraphBuilder::default();
    drawn.graph.operations = OPERATIONS.map(String::from).to_vec();
    let mut end = drawn.node("linear", "");
    let mut skip_outputs = Vec::new();
    for (at, cell) in cells.iter().enumerate() {
        let (name, input) = (format!("cell {}", at + 1), end);
        end = drawn.chain(end, &block(cell, true), &name);
        let skips: Vec<usize> = (0..at).filter(|earlier| cell.skips[*earlier]).collect();
        if !skips.is_empty() {
            end = drawn.chain(end, &["+"], &name);
            skips
                .iter()
                .for_each(|earlier| drawn.edge(skip_outputs[*earlier], end, true));
        }
        skip_outputs.push(end);
        end = drawn.chain(end, &block(cell, false), &name);
        if cell.shortcut {
            end = drawn.chain(end, &["+"], &name);
            drawn.edge(input, end, true);
        }
    }
    drawn.chain(end, &["BN", "ReLU", "conv 3×3", "tanh"], "head");
    drawn.graph
}

/// The operations of a block, in order; the first block of a cell enlarges.
fn block(cell: &CellArchitecture, enlarges: bool) -> Vec<&'static str> {
    let upsampling = match cell.upsampling {
        Upsampling::Bilinear => "bilinear 2×",
        Upsampling::Nearest => "nearest 2×",
        Upsampling::Deconvolution => "deconv 2×",
    };
    let norm = match cell.normalisation {
        Normalisation::None => None,
        Normalisation::Batch => Some("BN"),
        Normalisation::Instance => Some("IN"),
    };
    let up = enlarges.then_some(upsampling);
    let operations = match cell.order {
        Order::ConvolutionFirst => [up, Some("conv 3×3"), norm, Some("ReLU")],
        Order::NormalisationFirst => [norm, Some("ReLU"), up, Some("conv 3×3")],
    };
    operations.into_iter().flatten().collect()
}

#[derive(Default)]
struct GraphBuilder {
    graph: Graph,
}

impl GraphBuilder {
    fn node(&mut self, label: &str, group: &str) -> usize {
        let at = self.graph.nodes.len();
        #[allow(
            clippy::cast_possible_truncation,
            reason = "a generator has a few dozen operations"
        )]
        self.graph.nodes.push(Node {
            label: label.into(),
            column: at as u32,
            lane: 0,
            group: group.into(),
        });
        at
    }

    /// Adds operations one after the other, after a node; returns the last of them.
    fn chain(&mut self, from: usize, labels: &[&str], group: &str) -> usize {
        labels.iter().fold(from, |before, label| {
            let node = self.node(label, group);
            self.edge(before, node, false);
            node
        })
    }

    fn edge(&mut self, from: usize, to: usize, bypass: bool) {
        self.graph.edges.push(Edge {
            from,
            to,
            label: String::new(),
            bypass,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::architecture::{AUTOGAN, E2GAN};

    fn bypasses(graph: &Graph) -> Vec<(usize, usize)> {
        let bypasses = graph.edges.iter().filter(|edge| edge.bypass);
        bypasses.map(|edge| (edge.from, edge.to)).collect()
    }

    #[test]
    fn the_published_generator() {
        let graph = graph(&E2GAN.cells);
        graph.check().unwrap();
        // A stem, cells of four and three operations and a sum, the third with a skip, a head of four.
        assert_eq!(graph.nodes.len(), 1 + 8 + 8 + 9 + 4);
        let labels: Vec<&str> = graph.nodes[1..9].iter().map(|node| node.label.as_str()).collect();
        assert_eq!(
            labels,
            [
                "bilinear 2×",
                "conv 3×3",
                "BN",
                "ReLU",
                "conv 3×3",
                "BN",
                "ReLU",
                "+"
            ]
        );
        assert_eq!(graph.nodes[9].label, "deconv 2×");
        // Shortcuts, and the skip from the first block of cell 1 to the sum before the second block of cell 3.
        assert_eq!(bypasses(&graph), [(0, 8), (8, 16), (4, 21), (16, 25)]);
    }

    #[test]
    fn every_box_is_one_of_the_operations() {
        for cells in [&E2GAN.cells, &AUTOGAN.cells] {
            let graph = graph(cells);
            assert_eq!(graph.operations, OPERATIONS);
            let boxes = graph.nodes.iter().filter(|node| node.label != "+");
            for word in boxes.filter_map(|node| node.label.split(' ').next()) {
                assert!(OPERATIONS.contains(&word), "{word}");
            }
        }
    }

    #[test]
    fn blocks_stand_in_the_order_of_the_architecture() {
        let graph = graph(&AUTOGAN.cells);
        graph.check().unwrap();
        let labels: Vec<&str> = graph.nodes[1..4].iter().map(|node| node.label.as_str()).collect();
        assert_eq!(labels, ["ReLU", "nearest 2×", "conv 3×3"]);
        // Two shortcuts; one skip into cell 2, which is a sum by then, and two into cell 3.
        assert_eq!(bypasses(&graph).len(), 5);
    }
}
