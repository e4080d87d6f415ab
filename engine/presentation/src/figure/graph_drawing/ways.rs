//! Which way each arrow takes, before anything has a place.

use super::arrangement::Arrangement;
use contract::drawing::Graph;
use std::collections::BTreeSet;

/// The way of an arrow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// Along the flow, changing its lane in the gap after this rank.
    Direct(usize),
    /// Around what it passes, on this track beside its stack; inside the frame of its group or outside of all.
    Beside { track: usize, inside: bool },
    /// Into another stack.
    Over,
}

/// The ways of all arrows, and the room that they need.
#[derive(Debug)]
pub(super) struct Ways {
    pub ways: Vec<Way>,
    /// Tracks beside each stack: inside of frames, outside of them.
    pub beside: Vec<(usize, usize)>,
    /// Arrows that run along the gap after each stack.
    pub between: Vec<usize>,
    /// Gaps after these ranks have an arrow that changes its lane.
    pub wide: BTreeSet<usize>,
    /// Arrows that have a name.
    pub named: bool,
}

impl Ways {
    pub(super) fn of(graph: &Graph, arrangement: &Arrangement) -> Self {
        let mut ways: Vec<Way> = (0..graph.edges.len())
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

fn way(graph: &Graph, arrangement: &Arrangement, edge: usize) -> Way {
    let edge = &graph.edges[edge];
    if arrangement.stack(edge.from) != arrangement.stack(edge.to) {
        return Way::Over;
    }
    match direct(arrangement, edge.from, edge.to).filter(|_| !edge.bypass) {
        Some(rank) => Way::Direct(rank),
        None => Way::Beside {
            track: 0,
            inside: is_inside(graph, arrangement, (edge.from, edge.to)),
        },
    }
}

/// The rank after which an arrow can change its lane so that it meets no node.
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

/// True where both ends stand in one group that has no other one beside it.
fn is_inside(graph: &Graph, arrangement: &Arrangement, (from, to): (usize, usize)) -> bool {
    let group = &graph.nodes[from].group;
    let mut groups = arrangement.groups.iter();
    *group == graph.nodes[to].group && groups.any(|known| known.name == *group && known.alone)
}

/// Gives each arrow of a stack the nearest track that is free, short arrows first; returns how many tracks
/// there are.
fn assign(graph: &Graph, arrangement: &Arrangement, ways: &mut [Way], (stack, side): (usize, bool)) -> usize {
    let span = |edge: usize| {
        let edge = &graph.edges[edge];
        (arrangement.ranks[edge.from], arrangement.ranks[edge.to])
    };
    let is_here = |edge: &usize| {
        let here = matches!(ways[*edge], Way::Beside { inside, .. } if inside == side);
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
        ways[edge] = Way::Beside { track, inside: side };
    }
    tracks.len()
}

/// How many arrows run along the gap after a stack: those that leave it for another one, and those that come
/// to the next from further away.
fn passing(graph: &Graph, arrangement: &Arrangement, stack: usize) -> usize {
    let runs = |edge: &&contract::drawing::Edge| {
        let (from, to) = (arrangement.stack(edge.from), arrangement.stack(edge.to));
        from != to && (from == stack || to == stack + 1)
    };
    graph.edges.iter().filter(runs).count()
}

fn wide(graph: &Graph, arrangement: &Arrangement, ways: &[Way]) -> BTreeSet<usize> {
    let mut wide = BTreeSet::new();
    for (edge, way) in graph.edges.iter().zip(ways) {
        let lanes = (arrangement.lanes[edge.from], arrangement.lanes[edge.to]);
        match way {
            Way::Direct(rank) if lanes.0 != lanes.1 => drop(wide.insert(*rank)),
            Way::Direct(_) => {}
            // An arrow whose way out of its rank is not free leaves through the gap.
            Way::Beside { .. } | Way::Over => {
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
