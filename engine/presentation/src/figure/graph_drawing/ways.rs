//! Routing of arrows, before any box has a place.

use super::arrangement::Arrangement;
use contract::drawing::Graph;
use std::collections::BTreeSet;

/// Routing of one arrow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ArrowRouting {
    /// Along the flow, changing its lane in the gap after this rank.
    Direct(usize),
    /// Around the boxes in its way, on this track beside its stack; inside the frame of its group or outside of all
    /// frames.
    Beside { track: usize, inside: bool },
    /// Into another stack.
    Over,
}

/// Routing of all arrows, and the room that they need.
#[derive(Debug)]
pub(super) struct Routing {
    pub ways: Vec<ArrowRouting>,
    /// Number of tracks beside each stack: inside frames, outside frames.
    pub beside: Vec<(usize, usize)>,
    /// Number of arrows along the gap after each stack.
    pub between: Vec<usize>,
    /// Ranks with an arrow that changes its lane in the gap after them.
    pub wide: BTreeSet<usize>,
    /// Whether arrows have names.
    pub named: bool,
}

impl Routing {
    pub(super) fn of(graph: &Graph, arrangement: &Arrangement) -> Self {
        let mut ways: Vec<ArrowRouting> = (0..graph.edges.len())
            .map(|edge| way(graph, arrangement, edge))
            .collect();
        let stacks = 0..arrangement.stacks.len();
        let beside = stacks
            .clone()
            .map(|stack| [true, false].map(|inside| assign(graph, arrangement, &mut ways, (stack, inside))))
            .map(|[inside, outside]| (inside, outside))
            .collect();
        let between = stacks.map(|stack| passing(graph, arrangement, stack)).collect();
        let mut result = Self {
            ways,
            beside,
            between,
            wide: BTreeSet::new(),
            named: graph.edges.iter().any(|edge| !edge.label.is_empty()),
        };
        result.wide = wide(graph, arrangement, &result.ways);
        result
    }
}

fn way(graph: &Graph, arrangement: &Arrangement, edge: usize) -> ArrowRouting {
    let edge = &graph.edges[edge];
    if arrangement.stack(edge.from) != arrangement.stack(edge.to) {
        return ArrowRouting::Over;
    }
    match direct(arrangement, edge.from, edge.to).filter(|_| !edge.bypass) {
        Some(rank) => ArrowRouting::Direct(rank),
        None => ArrowRouting::Beside {
            track: 0,
            inside: is_inside(graph, arrangement, (edge.from, edge.to)),
        },
    }
}

/// The rank after which an arrow can change its lane without meeting a node; `None` if there is none.
fn direct(arrangement: &Arrangement, from: usize, to: usize) -> Option<usize> {
    let (first, last) = (arrangement.ranks[from], arrangement.ranks[to]);
    let is_free = |node: usize| {
        let lane = arrangement.lanes[node];
        !(first + 1..last).any(|rank| arrangement.has(rank, &(lane..lane + 1)))
    };
    if is_free(to) {
        Some(first)
    } else if is_free(from) {
        Some(last - 1)
    } else {
        None
    }
}

/// Whether both ends are in one group that has no other group beside it.
fn is_inside(graph: &Graph, arrangement: &Arrangement, (from, to): (usize, usize)) -> bool {
    let group = &graph.nodes[from].group;
    let mut groups = arrangement.groups.iter();
    *group == graph.nodes[to].group && groups.any(|known| known.name == *group && known.alone)
}

/// Gives each arrow of a stack the nearest free track, short arrows first; returns the number of tracks.
fn assign(
    graph: &Graph,
    arrangement: &Arrangement,
    ways: &mut [ArrowRouting],
    (stack, side): (usize, bool),
) -> usize {
    let span = |edge: usize| {
        let edge = &graph.edges[edge];
        (arrangement.ranks[edge.from], arrangement.ranks[edge.to])
    };
    let is_here = |edge: &usize| {
        let here = matches!(ways[*edge], ArrowRouting::Beside { inside, .. } if inside == side);
        here && arrangement.stack(graph.edges[*edge].from) == stack
    };
    let mut edges: Vec<usize> = (0..ways.len()).filter(is_here).collect();
    edges.sort_by_key(|edge| (span(*edge).1 - span(*edge).0, span(*edge).0, *edge));
    let mut tracks: Vec<Vec<(usize, usize)>> = Vec::new();
    for edge in edges {
        let (first, last) = span(edge);
        let fits = |taken: &Vec<(usize, usize)>| taken.iter().all(|it| it.1 <= first || last <= it.0);
        let track = tracks.iter().position(fits).unwrap_or_else(|| {
            tracks.push(Vec::new());
            tracks.len() - 1
        });
        tracks[track].push((first, last));
        ways[edge] = ArrowRouting::Beside { track, inside: side };
    }
    tracks.len()
}

/// Number of arrows along the gap after a stack: arrows that leave it for another stack, and arrows from further away
/// into the next one.
fn passing(graph: &Graph, arrangement: &Arrangement, stack: usize) -> usize {
    let runs = |edge: &&contract::drawing::Edge| {
        let (from, to) = (arrangement.stack(edge.from), arrangement.stack(edge.to));
        from != to && (from == stack || to == stack + 1)
    };
    graph.edges.iter().filter(runs).count()
}

fn wide(graph: &Graph, arrangement: &Arrangement, ways: &[ArrowRouting]) -> BTreeSet<usize> {
    let mut wide = BTreeSet::new();
    for (edge, way) in graph.edges.iter().zip(ways) {
        let lanes = (arrangement.lanes[edge.from], arrangement.lanes[edge.to]);
        match way {
            ArrowRouting::Direct(rank) if lanes.0 != lanes.1 => drop(wide.insert(*rank)),
            ArrowRouting::Direct(_) => {}
            // An arrow without a direct route out of its rank leaves through the gap.
            ArrowRouting::Beside { .. } | ArrowRouting::Over => {
                let (from, to) = (arrangement.ranks[edge.from], arrangement.ranks[edge.to]);
                if arrangement.at(from).count() > 1 {
                    wide.insert(from);
                }
                if arrangement.at(to).count() > 1 && to > 0 {
                    wide.insert(to - 1);
                }
            }
        }
    }
    wide
}
