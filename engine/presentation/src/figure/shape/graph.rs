//! Boxes and arrows without axes: the design that a trial found.

use super::{Chart, Drawing, Form, Graph, Ground, Mark, NumberFormat, Panel, Position, Sheet, Style};
use crate::figure::graph_drawing;
use contract::drawing::{Edge, Node};

/// Columns of the data file.
const HEADER: [&str; 10] = [
    "panel", "part", "number", "label", "column", "lane", "group", "from", "to", "bypass",
];

impl<'a> Form<'a> for &'a Graph {
    fn has_axes(&self) -> bool {
        false
    }

    fn ground(&self) -> Ground {
        Ground::Boxes
    }

    fn paint(&self, chart: &Chart, asked: Option<f64>) -> Option<Drawing> {
        graph_drawing::draw(chart, asked)
    }

    fn sample(&self, _: Style, _: Position) -> Vec<Mark> {
        Vec::new()
    }

    fn in_words(&self, _: &Panel, _: NumberFormat) -> Option<String> {
        let name = |node: Option<&'a Node>| node.map_or("nothing", |node| node.label.as_str());
        Some(format!(
            "{} boxes and {} arrows, from {} to {}",
            self.nodes.len(),
            self.edges.len(),
            name(self.nodes.first()),
            name(self.nodes.last())
        ))
    }

    fn sheet(&self) -> Option<Sheet> {
        let none = || [const { String::new() }; 3];
        let line = |part: &str, number: usize, label: &str, fields: [[String; 3]; 2]| {
            let head = [part.to_owned(), number.to_string(), label.to_owned()];
            head.into_iter().chain(fields.into_iter().flatten()).collect()
        };
        let node = |(number, node): (usize, &Node)| {
            let place = [node.column.to_string(), node.lane.to_string(), node.group.clone()];
            line("node", number, &node.label, [place, none()])
        };
        let edge = |(number, edge): (usize, &Edge)| {
            let ends = [
                edge.from.to_string(),
                edge.to.to_string(),
                edge.bypass.to_string(),
            ];
            line("edge", number, &edge.label, [none(), ends])
        };
        let nodes = self.nodes.iter().enumerate().map(node);
        Some((
            &HEADER,
            nodes.chain(self.edges.iter().enumerate().map(edge)).collect(),
        ))
    }
}
