//! A generator as a graph: blocks from left to right, shortcuts and skips beside them.

use crate::architecture::{CellArchitecture, N_CELLS, Normalisation, Order, Upsampling};
use engine::drawing::{Edge, Graph, Node};

/// The graph of a generator with these cells.
pub(super) fn graph(cells: &[CellArchitecture; N_CELLS]) -> Graph {
    let mut drawn = Drawn::default();
    let mut from = drawn.node("linear".into(), 0, "");
    let mut skip_outputs = Vec::new();
    for (at, cell) in cells.iter().enumerate() {
        let name = format!("cell {}", at + 1);
        let first = drawn.node(block(cell, true), 0, &name);
        let sum = drawn.node(block(cell, false), 0, &name);
        drawn.edge(from, first, "", false);
        drawn.edge(first, sum, "", false);
        for (earlier, _) in cell
            .skips
            .iter()
            .enumerate()
            .filter(|(earlier, skip)| **skip && *earlier < at)
        {
            drawn.edge(skip_outputs[earlier], sum, "skip", true);
        }
        skip_outputs.push(first);
        if cell.shortcut {
            let end = drawn.node("+".into(), 0, &name);
            drawn.edge(sum, end, "", false);
            drawn.edge(from, end, "shortcut", true);
            from = end;
        } else {
            from = sum;
        }
    }
    let head = drawn.node("batch norm\nReLU\nconv 3x3\ntanh".into(), 0, "");
    drawn.edge(from, head, "", false);
    drawn.graph
}

/// What a block does, a line each, in its order; the first block of a cell enlarges.
fn block(cell: &CellArchitecture, enlarges: bool) -> String {
    let upsampling = match cell.upsampling {
        Upsampling::Bilinear => "bilinear x2",
        Upsampling::Nearest => "nearest x2",
        Upsampling::Deconvolution => "deconv x2",
    };
    let norm = match cell.normalisation {
        Normalisation::None => None,
        Normalisation::Batch => Some("batch norm"),
        Normalisation::Instance => Some("instance norm"),
    };
    let up = enlarges.then_some(upsampling);
    let lines = match cell.order {
        Order::ConvolutionFirst => [up, Some("conv 3x3"), norm, Some("ReLU")],
        Order::NormalisationFirst => [norm, Some("ReLU"), up, Some("conv 3x3")],
    };
    lines.into_iter().flatten().collect::<Vec<_>>().join("\n")
}

#[derive(Default)]
struct Drawn {
    graph: Graph,
}

impl Drawn {
    fn node(&mut self, label: String, lane: i32, group: &str) -> usize {
        let column = self.graph.nodes.len();
        #[allow(clippy::cast_possible_truncation, reason = "a generator has a dozen blocks")]
        self.graph.nodes.push(Node {
            label,
            column: column as u32,
            lane,
            group: group.into(),
        });
        column
    }

    fn edge(&mut self, from: usize, to: usize, label: &str, bypass: bool) {
        self.graph.edges.push(Edge {
            from,
            to,
            label: label.into(),
            bypass,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::architecture::{AUTOGAN, E2GAN};

    #[test]
    fn the_published_generator() {
        let graph = graph(&E2GAN.cells);
        graph.check().unwrap();
        // Stem, three blocks and sums of three nodes each, head.
        assert_eq!(graph.nodes.len(), 1 + 9 + 1);
        assert_eq!(graph.nodes[1].label, "bilinear x2\nconv 3x3\nbatch norm\nReLU");
        assert_eq!(graph.nodes[4].label, "deconv x2\nconv 3x3\nbatch norm\nReLU");
        let bypasses: Vec<(usize, usize, &str)> = graph
            .edges
            .iter()
            .filter(|edge| edge.bypass)
            .map(|edge| (edge.from, edge.to, edge.label.as_str()))
            .collect();
        // The skip leaves the first block of cell 1 and enters the second of cell 3.
        assert_eq!(
            bypasses,
            [
                (0, 3, "shortcut"),
                (3, 6, "shortcut"),
                (1, 8, "skip"),
                (6, 9, "shortcut")
            ]
        );
    }

    #[test]
    fn blocks_stand_in_the_order_of_the_architecture() {
        let graph = graph(&AUTOGAN.cells);
        graph.check().unwrap();
        assert_eq!(graph.nodes[1].label, "ReLU\nnearest x2\nconv 3x3");
        let skips = graph.edges.iter().filter(|edge| edge.label == "skip").count();
        assert_eq!(skips, 3);
    }
}
