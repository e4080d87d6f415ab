//! The order of nodes, and the folding of their flow.

use contract::drawing::Graph;
use std::{collections::BTreeSet, ops::Range};

/// Least number of ranks in a stack; stacks are not shortened further to save width.
const SHORTEST: usize = 4;

/// Widths of the text in boxes, in points. The second width is used if it saves a longer fold.
const TEXT_WIDTHS: [f64; 2] = [84.0, 50.0];

/// Direction of the flow on paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Flow {
    Right,
    Down,
}

/// A group of nodes with its first and last rank.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Group {
    pub name: String,
    pub nodes: Vec<usize>,
    pub first: usize,
    pub last: usize,
    /// Whether no other group has nodes beside it.
    pub alone: bool,
}

/// Nodes in ranks along the flow and in lanes across it, and the flow in stacks.
#[derive(Debug, Clone)]
pub(super) struct Arrangement {
    pub flow: Flow,
    /// Width of the widest line of text in a box, in points.
    pub text_width: f64,
    /// The rank of each node: the place of its column among the columns in use.
    pub ranks: Vec<usize>,
    /// The lane of each node, among those of its stack.
    pub lanes: Vec<usize>,
    /// Consecutive ranks, a range for each stack.
    pub stacks: Vec<Range<usize>>,
    pub groups: Vec<Group>,
}

impl Arrangement {
    /// All arrangements from the preferred one to the narrowest: in a line to the right, then downwards in fewer and
    /// fewer stacks.
    pub(super) fn all(graph: &Graph) -> impl Iterator<Item = Self> {
        let ranks = ranks(graph);
        let groups = groups(graph, &ranks);
        let count = ranks.iter().max().map_or(0, |last| last + 1);
        let units = units(&groups, count);
        let longest = units.iter().map(ExactSizeIterator::len).max().unwrap_or(0);
        let mut folds: Vec<Vec<Range<usize>>> = (longest.max(SHORTEST)..=count.max(longest).max(SHORTEST))
            .map(|most| folded(&units, most))
            .collect();
        folds.dedup();
        let line = std::iter::once((Flow::Right, std::iter::once(0..count).collect()));
        let down = folds.into_iter().map(|stacks| (Flow::Down, stacks));
        let folds = line.chain(down);
        let folds = folds.flat_map(|(flow, stacks)| TEXT_WIDTHS.map(|width| (flow, stacks.clone(), width)));
        folds.map(move |(flow, stacks, text_width)| Self {
            flow,
            text_width,
            lanes: lanes(graph, &ranks, &stacks),
            ranks: ranks.clone(),
            groups: groups.clone(),
            stacks,
        })
    }

    /// The stack that a node stands in.
    pub(super) fn stack(&self, node: usize) -> usize {
        let holds = |stack: &Range<usize>| stack.contains(&self.ranks[node]);
        self.stacks.iter().position(holds).unwrap_or(0)
    }

    /// The nodes of a rank.
    pub(super) fn at(&self, rank: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.ranks.len()).filter(move |node| self.ranks[*node] == rank)
    }

    /// Whether a rank has a node in one of some lanes.
    pub(super) fn has(&self, rank: usize, lanes: &Range<usize>) -> bool {
        self.at(rank).any(|node| lanes.contains(&self.lanes[node]))
    }
}

fn ranks(graph: &Graph) -> Vec<usize> {
    let columns: BTreeSet<u32> = graph.nodes.iter().map(|node| node.column).collect();
    let rank = |column: u32| columns.range(..column).count();
    graph.nodes.iter().map(|node| rank(node.column)).collect()
}

fn lanes(graph: &Graph, ranks: &[usize], stacks: &[Range<usize>]) -> Vec<usize> {
    let lane = |node: usize| {
        let stack = stacks.iter().find(|stack| stack.contains(&ranks[node]));
        let beside =
            (0..ranks.len()).filter(|other| stack.is_some_and(|stack| stack.contains(&ranks[*other])));
        let taken: BTreeSet<i32> = beside.map(|other| graph.nodes[other].lane).collect();
        taken.range(..graph.nodes[node].lane).count()
    };
    (0..graph.nodes.len()).map(lane).collect()
}

/// The groups in the order of their first nodes.
fn groups(graph: &Graph, ranks: &[usize]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (node, group) in graph.nodes.iter().enumerate().map(|(node, it)| (node, &it.group)) {
        let rank = ranks[node];
        match groups.iter_mut().find(|known| known.name == *group) {
            _ if group.is_empty() => {}
            Some(known) => {
                known.nodes.push(node);
                (known.first, known.last) = (known.first.min(rank), known.last.max(rank));
            }
            None => groups.push(Group {
                name: group.clone(),
                nodes: vec![node],
                first: rank,
                last: rank,
                alone: true,
            }),
        }
    }
    let spans: Vec<(usize, usize)> = groups.iter().map(|group| (group.first, group.last)).collect();
    for (index, group) in groups.iter_mut().enumerate() {
        let beside = |(other, (first, last)): (usize, &(usize, usize))| {
            other != index && *first <= group.last && *last >= group.first
        };
        group.alone = !spans.iter().enumerate().any(beside);
    }
    groups
}

/// Ranges of ranks that stay together because a group holds them, and all other ranks one by one.
fn units(groups: &[Group], count: usize) -> Vec<Range<usize>> {
    let mut units: Vec<Range<usize>> = Vec::new();
    for rank in 0..count {
        let joined = groups
            .iter()
            .any(|group| group.first < rank && group.last >= rank);
        match units.last_mut() {
            Some(unit) if joined => unit.end = rank + 1,
            _ => units.push(rank..rank + 1),
        }
    }
    units
}

/// Stacks of at most `most` ranks.
fn folded(units: &[Range<usize>], most: usize) -> Vec<Range<usize>> {
    let mut stacks: Vec<Range<usize>> = Vec::new();
    for unit in units {
        match stacks.last_mut() {
            Some(stack) if unit.end - stack.start <= most => stack.end = unit.end,
            _ => stacks.push(unit.clone()),
        }
    }
    stacks
}
